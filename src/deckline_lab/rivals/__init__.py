"""Published methods that ours is compared with."""
