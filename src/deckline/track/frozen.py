"""Pictures that are shown again while the aircraft moves."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from deckline.geometry import intersect_plane
from deckline.types import Frame, RunwayEstimate

SAMPLE_PX = 37  # every so many rows and columns of the picture are compared
MIN_TURN_RAD, MIN_MOVE_M = 1e-3, 0.1  # of the camera, which every picture shows
MIN_EXPECTED_MOTION_PX = 0.5  # of the lines in the image, before their rest means anything
MAX_REST_SHARE = 0.02  # of the expected motion, below which the lines rest
MIN_RESTING_FRAMES = 3  # in a row
MAX_SAME_S = 0.3  # that a camera may show the same picture; films repeat single ones


@dataclass(frozen=True, eq=False)
class FrozenImageMonitor:
    """Memory of the last picture, to notice one that is shown again while the aircraft moves.

    Equal pixels decide where a picture has any contrast: at once where the pose moved, after `MAX_SAME_S` where the
    pose stands still as well. Lines that rest in the image although the pose says they must
    move are the other sign.
    """

    sample: NDArray[np.uint8] | None = None
    pose: RigidTransform | None = None  # world_from_camera of the last frame
    estimate: RunwayEstimate | None = None
    resting: int = 0  # frames in a row in which lines rested though they should have moved
    new_s: float | None = None  # time of the last picture that differed from the one before
    is_frozen: bool = False

    def update(self, frame: Frame, estimate: RunwayEstimate) -> "FrozenImageMonitor":
        """After one more frame."""
        sample = frame.image_rgb[::SAMPLE_PX, ::SAMPLE_PX].copy()
        pose = frame.world_from_camera
        if self.sample is None or self.sample.shape != sample.shape:
            return FrozenImageMonitor(sample, pose, estimate, new_s=frame.time_s)
        same = bool(np.ptp(sample)) and bool(np.array_equal(self.sample, sample))
        new_s = self.new_s if same and self.new_s is not None else frame.time_s
        stalled = same and (self._has_moved(pose) or frame.time_s - new_s > MAX_SAME_S)
        resting = self.resting + 1 if self._lines_rest(frame, estimate) else 0
        return FrozenImageMonitor(sample, pose, estimate, resting, new_s, stalled or resting >= MIN_RESTING_FRAMES)

    def _has_moved(self, pose: RigidTransform | None) -> bool:
        """Whether the camera turned or moved by what every picture shows."""
        if self.pose is None or pose is None:
            return False
        turn = (self.pose.rotation.inv() * pose.rotation).magnitude()
        return bool(turn > MIN_TURN_RAD or np.linalg.norm(pose.translation - self.pose.translation) > MIN_MOVE_M)

    def _lines_rest(self, frame: Frame, estimate: RunwayEstimate) -> bool:
        """Whether all lines lie where they lay although they should have moved."""
        before, pose = self.pose, frame.world_from_camera
        if before is None or pose is None or self.estimate is None:
            return False
        sides = set(self.estimate.pixel_lines) & set(estimate.pixel_lines) & set(self.estimate.lines)
        expected_px, actual_px = 0.0, 0.0
        for side in sides:
            line = self.estimate.pixel_lines[side]
            rays = before.rotation.apply(frame.camera.rays(line.ends_px))
            on_deck = intersect_plane(before.translation, rays, self.estimate.lines[side].height_m)
            optical = pose.inv().apply(np.where(np.isfinite(on_deck), on_deck, pose.translation))
            a, b, c = line.coefficients
            expected = frame.camera.project(optical) @ [a, b] + c
            a, b, c = estimate.pixel_lines[side].coefficients
            if np.isfinite(expected).any():
                expected_px = max(expected_px, float(np.nanmax(np.abs(expected))))
            actual_px = max(actual_px, float(np.max(np.abs(line.ends_px @ [a, b] + c))))
        return expected_px > MIN_EXPECTED_MOTION_PX and actual_px < MAX_REST_SHARE * expected_px
