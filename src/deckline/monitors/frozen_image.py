"""Pictures that repeat while the aircraft moves."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from deckline.geometry import intersect_plane, rotation_matrix, undistort
from deckline.types import Detection, Diagnostic, Diagnostics, Frame, PixelLine, Reason, RunwayEstimate

SAMPLE_PX = 37  # every so many rows and columns of the picture are compared
MIN_TURN_RAD, MIN_MOVE_M = 1e-3, 0.1  # of the camera, which every picture shows
MIN_EXPECTED_MOTION_PX = 0.5  # of the lines in the image, above which their rest is a sign
MAX_REST_SHARE = 0.02  # of the expected motion, below which the lines rest
MIN_RESTING_FRAMES = 3  # in a row
MAX_SAME_S = 0.3  # that a camera may show the same picture; films repeat single ones
FROZEN = Diagnostic(Reason.FROZEN, "the camera shows the same picture while time goes on")


class FrozenImageMonitor:
    """Detects a picture that repeats while time goes on; a `Monitor`.

    Equal pixels decide where a picture has any contrast: at once when the pose moved, after `MAX_SAME_S` when it did
    not. The other sign: lines that rest in the image although the pose requires them to move.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget all frames."""
        self._sample: NDArray[np.uint8] | None = None  # of the last picture
        self._pose: RigidTransform | None = None  # world_from_camera of the last frame
        self._estimate: RunwayEstimate | None = None  # of the last frame
        self._resting = 0  # frames in a row in which lines rested though they should have moved
        self._new_s = 0.0  # time of the last picture that differed from the one before

    def close(self) -> None:
        """No threads to end."""

    def update(self, frame: Frame, estimate: RunwayEstimate, detection: Detection | None) -> Diagnostics:
        """Compare the frame with the one before."""
        sample = frame.image_rgb[::SAMPLE_PX, ::SAMPLE_PX].copy()
        same = bool(np.ptp(sample)) and self._sample is not None and bool(np.array_equal(self._sample, sample))
        self._new_s = self._new_s if same else frame.time_s
        stalled = same and (self._has_moved(frame.world_from_camera) or frame.time_s - self._new_s > MAX_SAME_S)
        is_first = self._sample is None or self._sample.shape != sample.shape
        self._resting = self._resting + 1 if not is_first and self._lines_rest(frame, estimate) else 0
        self._sample, self._pose, self._estimate = sample, frame.world_from_camera, estimate
        return (FROZEN,) if stalled or self._resting >= MIN_RESTING_FRAMES else ()

    def _has_moved(self, pose: RigidTransform | None) -> bool:
        """Whether the camera turned or moved by what every picture shows."""
        if self._pose is None or pose is None:
            return False
        turn = (self._pose.rotation.inv() * pose.rotation).magnitude()
        return bool(turn > MIN_TURN_RAD or np.linalg.norm(pose.translation - self._pose.translation) > MIN_MOVE_M)

    def _lines_rest(self, frame: Frame, estimate: RunwayEstimate) -> bool:
        """Whether all lines lie where they lay although they should have moved."""
        before, pose = self._pose, frame.world_from_camera
        if before is None or pose is None or self._estimate is None:
            return False
        sides = set(self._estimate.pixel_lines) & set(estimate.pixel_lines) & set(self._estimate.lines)
        if not sides:
            return False
        old, new = ([lines[side] for side in sides] for lines in (self._estimate.pixel_lines, estimate.pixel_lines))
        ends_px = np.concatenate([line.ends_px for line in old])
        heights_m = np.repeat([self._estimate.lines[side].height_m for side in sides], 2)
        rays = frame.camera.rays(ends_px) @ rotation_matrix(before).T
        on_deck = intersect_plane(before.translation, rays, heights_m)
        optical = np.where(np.isfinite(on_deck), on_deck - pose.translation, 0.0) @ rotation_matrix(pose)
        expected_px = _distances(undistort(frame.camera.project(optical), frame.camera), old)
        actual_px = _distances(undistort(ends_px, frame.camera), new)
        expected_px = expected_px[np.isfinite(expected_px)].max(initial=0.0)
        return bool(expected_px > MIN_EXPECTED_MOTION_PX and actual_px.max() < MAX_REST_SHARE * expected_px)


def _distances(ends_px: NDArray[np.float64], lines: list[PixelLine]) -> NDArray[np.float64]:
    """How far (2 L,) both ends (2 L, 2), without distortion, of every line lie from another line."""
    normals = np.repeat([line.coefficients for line in lines], 2, axis=0)
    return np.asarray(np.abs((ends_px * normals[:, :2]).sum(axis=1) + normals[:, 2]))
