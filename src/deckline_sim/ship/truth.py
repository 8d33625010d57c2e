"""The true lines of a ship's runway."""

from deckline.types import Segment
from deckline_sim.ship.layout import Layout, world_points


def truth_segments(layout: Layout) -> tuple[Segment, Segment]:
    """Middle of the left and of the right edge marking in the world, ramp end first."""
    left, right = world_points(layout, layout.left_m), world_points(layout, layout.right_m)
    return Segment(left[0], left[1]), Segment(right[0], right[1])
