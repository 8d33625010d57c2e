"""The horizon in the picture against the attitude of the pose: a test that is independent of the lines.

A camera that turned in its mount, a mirrored picture or a wrong attitude turns, raises or lowers the horizon against
the pose. The excess over the horizon's tolerance is summed over the searches and flagged when the sum is large (CUSUM).
Source: Page, "Continuous inspection schemes", 1954.
"""

from typing import NamedTuple

import numpy as np

from deckline.dehaze.horizon import Horizon, NoHorizon
from deckline.dehaze.horizon_search import HorizonSearch
from deckline.dehaze.sea_view import EARTH_RADIUS_M
from deckline.geometry import Camera, rectify, rotation_matrix
from deckline.types import Detection, Diagnostic, Diagnostics, Frame, Reason, RunwayEstimate

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

    A search for the horizon takes a tenth of a second, in a thread beside the flight, without lens distortion, which
    bends the horizon. A frame without a pose or without a horizon changes nothing.

    Args:
        every_s: from one search to the next; 0: none.
    """

    def __init__(self, every_s: float) -> None:
        self._search = HorizonSearch(every_s)
        self.reset()

    def reset(self) -> None:
        """Forget all frames, and the search under way."""
        self._search.reset()
        self._flags: Diagnostics = ()
        self._sum = 0.0
        self._searched: tuple[Camera, ExpectedHorizon] | None = None

    def close(self) -> None:
        """End the thread; the next update starts another."""
        self.reset()
        self._search.close()

    def update(self, frame: Frame, estimate: RunwayEstimate, detection: Detection | None) -> Diagnostics:
        """Take the result that is due, and start the next search when it is time."""
        if detection is None:
            return self._flags
        found = self._search.take(frame.time_s)
        if found is not None and self._searched is not None:
            self._compare(*self._searched, found)
        if self._search.is_due(frame.time_s) and (expected := expect_horizon(frame)) is not None:
            self._searched = frame.camera, expected
            self._search.start(frame.time_s, rectify(frame.image_rgb, frame.camera))
        return self._flags

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
    """Where the attitude puts a level horizon in the image without lens distortion.

    None without pose or camera, in a steep roll, or where the horizon is outside of the image.
    """
    pose, camera = frame.world_from_camera, frame.camera
    if frame.missing is not None or pose is None:
        return None
    down = rotation_matrix(pose)[2]  # optical frame
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
