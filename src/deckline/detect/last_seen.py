"""What the last good estimate of a flight lets expect in the next frame."""

from dataclasses import dataclass

import numpy as np

from deckline.detect.looks import Box
from deckline.geometry import intersect_plane
from deckline.types import SIDES, Detection, ExpectedRunway, Frame, RunwayEstimate, RunwayLine, Status

DRIFT_M_S = 15.0  # a ship at 30 knots, whose motion a world fixed to the ground does not follow
ATTITUDE_RAD = np.deg2rad(0.5)  # 1-sigma of how two frames' poses differ in direction, beyond what the line's own says
TURN_RAD_S = np.deg2rad(5.0)  # 1-sigma of a ship's turning
IMAGE_MARGIN = 0.5  # of the last picture's box on every side, without a pose: what an aircraft turns between frames


@dataclass(frozen=True, eq=False)
class _Seen:
    """One good estimate."""

    time_s: float
    size_px: tuple[int, int]  # of the image
    box: Box  # around the points of both lines
    runway: ExpectedRunway | None  # None: it could not be localized


class LastSeen:
    """Carries the last estimate with both lines forward, for frames of one flight in their order. Constant memory.

    Args:
        max_age_s: an estimate older than this is forgotten; so it is when time runs backwards.
    """

    def __init__(self, max_age_s: float = 5.0) -> None:
        self.max_age_s = max_age_s
        self._seen: _Seen | None = None

    def expected(self, frame: Frame) -> ExpectedRunway | None:
        """Where the runway should be at this frame's time; None when it was not localized lately."""
        seen = self._fresh(frame)
        if seen is None or seen.runway is None:
            return None
        age_s = frame.time_s - seen.time_s
        sigma_m = float(np.hypot(seen.runway.sigma_m, DRIFT_M_S * age_s))
        turned = float(np.hypot(seen.runway.azimuth_sigma_rad, TURN_RAD_S * age_s))
        return ExpectedRunway(seen.runway.left_m, seen.runway.right_m, sigma_m, turned)

    def image_box(self, frame: Frame) -> Box | None:
        """Where the runway was in the last picture, with a margin, for frames without a pose; None without one."""
        seen = self._fresh(frame)
        if seen is None or seen.size_px != (frame.camera.width, frame.camera.height):
            return None
        u0, v0, u1, v1 = seen.box
        aside = IMAGE_MARGIN * max(u1 - u0, v1 - v0)
        return u0 - aside, v0 - aside, u1 + aside, v1 + aside

    def update(self, frame: Frame, detection: Detection, estimate: RunwayEstimate) -> None:
        """Remember what was seen in a frame, if both lines were and agree."""
        if estimate.status is not Status.OK:
            return
        corners = np.concatenate([getattr(detection, side).points_px for side in SIDES])
        (u0, v0), (u1, v1) = corners.min(axis=0), corners.max(axis=0)
        box = (float(u0), float(v0), float(u1), float(v1))
        self._seen = _Seen(frame.time_s, (frame.camera.width, frame.camera.height), box, _runway(frame, estimate))

    def _fresh(self, frame: Frame) -> _Seen | None:
        if self._seen is not None and not 0 <= frame.time_s - self._seen.time_s <= self.max_age_s:
            self._seen = None
        return self._seen


def _runway(frame: Frame, estimate: RunwayEstimate) -> ExpectedRunway | None:
    """The seen part of both lines in the world; None where they were not localized."""
    if set(SIDES) - set(estimate.lines) or frame.world_from_camera is None:
        return None
    ends = [_ends(frame, estimate, side) for side in SIDES]
    if not np.isfinite(ends).all():
        return None
    origin = frame.world_from_camera.translation
    ranges = np.linalg.norm(np.stack(ends) - origin, axis=2)
    lines = [estimate.lines[side] for side in SIDES]
    sigma_m = max(float(np.sqrt(_covariance(line)[0, 0])) for line in lines) + ATTITUDE_RAD * float(ranges.min())
    turned = max(float(np.sqrt(_covariance(line)[1, 1])) for line in lines)
    return ExpectedRunway(ends[0], ends[1], sigma_m, float(np.hypot(turned, ATTITUDE_RAD)))


def _covariance(line: RunwayLine) -> np.ndarray:
    return line.covariance if line.relative_covariance is None else line.relative_covariance


def _ends(frame: Frame, estimate: RunwayEstimate, side: str) -> np.ndarray:
    """Where the ends of the seen part of a line meet its height, (2, 3) world; NaN where they do not."""
    pose = frame.world_from_camera
    if pose is None:
        return np.full((2, 3), np.nan)
    rays = pose.rotation.apply(frame.camera.rays(estimate.pixel_lines[side].ends_px))
    return intersect_plane(pose.translation, rays, estimate.lines[side].height_m)
