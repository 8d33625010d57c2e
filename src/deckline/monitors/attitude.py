"""The horizon in the picture against the attitude of the pose: a test that is independent of the lines.

A camera that turned in its mount, a mirrored picture or a wrong attitude turns, raises or lowers the horizon against
the pose. The excess over the horizon's tolerance is summed over the searches and flagged when the sum is large (CUSUM).
Source: Page, "Continuous inspection schemes", 1954.
"""

from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from deckline.dehaze.horizon import Horizon, NoHorizon, find_horizon
from deckline.dehaze.sea_view import EARTH_RADIUS_M
from deckline.types import Camera, Detection, Diagnostic, Diagnostics, Frame, Reason, RunwayEstimate

ANSWER_S = 0.3  # after a picture, when its horizon is used; a frame at that time waits for it, so that replays agree
OFF_DEG = 1.0  # tolerance of attitude and lens
SIGMAS = 2.0  # of the horizon's own uncertainty, added: haze that thickens with range lowers it by up to 2.7 of them
SIGMAS_UP = 1.0  # the same for a horizon that is too high, which haze does not cause
STEEPEST_DEG = 20.0  # of roll, up to which the horizon is searched
FLAGGED, MOST = 1.0, 2.0  # sum of the excess over the limits, in limits


class ExpectedHorizon(NamedTuple):
    """Where the attitude puts a level horizon in the image."""

    roll_deg: float  # + down to the right
    row_px: float  # in the image's middle column
    dip_deg: float | None  # of the sea's below the horizontal; None without the water's height: hills may raise it


class AttitudeMonitor:
    """Compares the horizon in the picture with the attitude of the pose; a `Monitor`.

    A search for the horizon takes a tenth of a second, in a thread beside the flight. A frame without a pose or without
    a horizon changes nothing. Distorted pictures are not searched, as distortion bends the horizon.

    Args:
        every_s: from one search to the next; 0: none.
    """

    def __init__(self, every_s: float) -> None:
        self.every_s = every_s
        self._thread: ThreadPoolExecutor | None = None
        self.reset()

    def reset(self) -> None:
        """Forget all frames, and the search under way."""
        self._flags: Diagnostics = ()
        self._sum = 0.0
        self._pending: tuple[Camera, ExpectedHorizon, Future[Horizon | NoHorizon]] | None = None
        self._last_s = -np.inf  # time of the last picture that was searched

    def close(self) -> None:
        """End the thread; the next update starts another."""
        self.reset()
        if self._thread is not None:
            self._thread.shutdown(cancel_futures=True)
            self._thread = None

    def update(self, frame: Frame, estimate: RunwayEstimate, detection: Detection | None) -> Diagnostics:
        """Take the result that is due, and start the next search when it is time."""
        if detection is None:
            return self._flags
        if not self._last_s <= frame.time_s:  # another flight, or not a number
            self.reset()
        if self._pending is not None and frame.time_s - self._last_s >= ANSWER_S:
            camera, expected, result = self._pending
            self._pending = None
            self._compare(camera, expected, result.result())
        is_due = self.every_s > 0 and frame.time_s - self._last_s >= self.every_s
        if is_due and self._pending is None and (expected_now := expect_horizon(frame)) is not None:
            self._pending = frame.camera, expected_now, self._submit(frame.image_rgb)
            self._last_s = frame.time_s
        return self._flags

    def _submit(self, image_rgb: NDArray[np.uint8]) -> "Future[Horizon | NoHorizon]":
        if self._thread is None:
            self._thread = ThreadPoolExecutor(1, "horizon")
        return self._thread.submit(find_horizon, image_rgb, rough=True)

    def _compare(self, camera: Camera, expected: ExpectedHorizon, seen: Horizon | NoHorizon) -> None:
        if isinstance(seen, NoHorizon):
            return
        turned_deg = float(np.rad2deg(np.arctan(seen.slope * camera.fx / camera.fy))) - expected.roll_deg
        elevation_rad = np.arctan((camera.cy - np.array([seen.middle_px, expected.row_px])) / camera.fy)
        raised_deg = float(np.rad2deg(elevation_rad[0] - elevation_rad[1])) + (expected.dip_deg or 0.0)
        sigmas = SIGMAS_UP if raised_deg > 0 else SIGMAS
        turned = abs(turned_deg) / (OFF_DEG + SIGMAS * float(np.rad2deg(seen.slope_sigma)))
        raised = abs(raised_deg) / (OFF_DEG + sigmas * float(np.rad2deg(seen.middle_sigma_px / camera.fy)))
        by_roll = expected.dip_deg is None or turned > raised
        excess = (turned if by_roll else raised) - 1.0
        self._sum = min(max(self._sum + excess, 0.0), MOST)
        if self._sum < FLAGGED:
            self._flags = ()
        elif excess > 0:
            raised_or_lowered = f"{'raised' if raised_deg > 0 else 'lowered'} by {abs(raised_deg):.1f}"
            how = f"turned by {turned_deg:+.1f}" if by_roll else raised_or_lowered
            message = f"the horizon in the picture is {how} degrees against the attitude"
            self._flags = (Diagnostic(Reason.ATTITUDE, message),)


def expect_horizon(frame: Frame) -> ExpectedHorizon | None:
    """Where the attitude puts a level horizon in the image.

    None without pose or camera, with distortion, in a steep roll, or where the horizon is outside of the image.
    """
    pose, camera = frame.world_from_camera, frame.camera
    if frame.missing is not None or pose is None or camera.has_distortion:
        return None
    down: NDArray[np.float64] = pose.rotation.inv().apply([0.0, 0.0, 1.0])  # optical frame
    roll_deg = float(np.rad2deg(np.arctan2(-down[0], down[1])))
    if not abs(roll_deg) <= STEEPEST_DEG:
        return None
    aside = ((camera.width - 1) / 2 - camera.cx) / camera.fx
    row = float(camera.cy - camera.fy * (down[2] + down[0] * aside) / down[1])
    if not 0 <= row <= camera.height - 1:
        return None
    height_m = np.nan if frame.sea_z_m is None else frame.sea_z_m - float(pose.translation[2])
    dip_deg = float(np.rad2deg(np.sqrt(2 * max(height_m, 0.0) / EARTH_RADIUS_M)))
    return ExpectedHorizon(roll_deg, row, dip_deg if np.isfinite(height_m) else None)
