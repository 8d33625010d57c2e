"""What each part of the dehazing network is worth."""
