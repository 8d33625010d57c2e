"""Published methods that ours is compared with."""

from pathlib import Path

LAB_WEIGHTS = Path(__file__).parent.parent / "weights"  # of rivals, with a manifest of their own
