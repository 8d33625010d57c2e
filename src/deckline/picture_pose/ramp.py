"""The near end of the lines in one picture, as a sight of the ramp."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deckline.config import RunConfig
from deckline.localize.line_fit import LineFit, NearEnds, check_near_ends, find_near_ends
from deckline.localize.localizer import locate_inliers
from deckline.picture_pose.answer import with_pose
from deckline.picture_pose.states import ACCELERATION_M_S15, Belief, States
from deckline.types import SIDES, DepthMode, Detection, Diagnostic, Frame, Reason, RunwayEstimate

Array = NDArray[np.float64]
SPAN_S = 1.0  # over which the ramp's approach is compared with the closing speed
CONTRADICTED_SIGMA = 4.0  # of that comparison


@dataclass(frozen=True, eq=False)
class RampSight:
    """Where both lines begin."""

    ray: Array
    """(3,) to the middle between both near ends, optical frame, z = 1."""
    sigma_m: float
    """1-sigma along the deck."""


@dataclass(frozen=True)
class RampFix:
    """The ramp in one picture, and how fast the track closes at that time."""

    time_s: float
    distance_m: float  # by this picture's ramp
    sigma_m: float
    closing_m_s: float
    closing_sigma_m_s: float


def check_closing(first: RampFix, last: RampFix) -> Diagnostic | None:
    """Contradict a ramp that comes nearer much faster or slower than the aircraft flies: the camera zooms."""
    span_s = last.time_s - first.time_s
    nearer_m, expected_m = first.distance_m - last.distance_m, first.closing_m_s * span_s
    wander_m = float(ACCELERATION_M_S15[0]) * span_s**1.5 / np.sqrt(3)
    sigma_m = np.linalg.norm([first.sigma_m, last.sigma_m, first.closing_sigma_m_s * span_s, wander_m])
    if abs(nearer_m - expected_m) <= CONTRADICTED_SIGMA * sigma_m:
        return None
    message = f"the ramp came nearer by {nearer_m:.0f} m in {span_s:.1f} s, expected {expected_m:.0f} m: a zoom?"
    return Diagnostic(Reason.FOCAL, message)


def sight_ramp(
    frame: Frame, detection: Detection, estimate: RunwayEstimate, belief: Belief, config: RunConfig
) -> RampSight | None:
    """The near ends of both lines on the deck of a belief; None where they are not in view or contradict each other."""
    if not set(SIDES) <= set(estimate.pixel_lines):
        return None
    placed = with_pose(frame, belief)
    points = {"left": detection.left, "right": detection.right}
    on_deck = {
        side: locate_inliers(placed, points[side], estimate.pixel_lines[side], DepthMode.COARSE, config.noise)
        for side in SIDES
    }
    if not all(len(part) for part in on_deck.values()):
        return None
    nothing = np.zeros((3, 0))
    middle = np.array([-belief.mean[States.DISTANCE], 0.0, 0.0])
    centre = LineFit(middle, 0.0, nothing, nothing, nothing)
    ends = find_near_ends(placed, points, on_deck, centre, detection.region_px)
    if not isinstance(ends, NearEnds) or check_near_ends(ends, centre, centre) is not None:
        return None
    ahead = float(ends.along_m.mean())
    camera = placed.world_from_camera
    if camera is None or ahead <= 0:
        return None
    ray = camera.inv().apply(middle + np.array([ahead, 0.0, 0.0]))
    if ray[2] <= 0:
        return None
    return RampSight(ray / ray[2], float(np.sqrt(ends.variance.sum() / 4 + (ends.separation_m / 2) ** 2)))
