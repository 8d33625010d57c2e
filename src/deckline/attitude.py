"""Whether the horizon in the pictures is turned as the attitude says: a measurement that owes nothing to the lines.

A camera that turned in its mount about its axis, a mirrored picture or a wrong attitude turn the horizon against what
the pose says of it. The excess over what a horizon may be off is summed from look to look and flagged when the sum is
large: Page, "Continuous inspection schemes", 1954. Its height is not used: in haze that thickens with range it can be
degrees off.
"""

from concurrent.futures import Future, ThreadPoolExecutor
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from deckline.dehaze.horizon import Horizon, NoHorizon, find_horizon
from deckline.types import Frame, Notice, Reason

ANSWER_S = 0.3  # after a picture, in which its horizon is found; later frames wait, so that replays agree
SIGMAS = 2.0  # of the horizon's own uncertainty, which was never off by more than one in rolls
TURNED_DEG = 1.0  # what attitude and lens may add
STEEPEST_DEG = 20.0  # of roll, in which a horizon is looked for
FLAGGED, MOST = 1.0, 2.0  # sum of the excess over the limits, in limits


class AttitudeCheck:
    """Called with every frame of a flight, in their order; `flag` is what the last looks at the horizon say.

    A look takes a tenth of a second, in a thread beside the flight. A frame that has no pose, or shows no horizon,
    changes nothing; distorted pictures are not looked at, as they bend the line.

    Args:
        every_s: from one look to the next; 0: none.
    """

    def __init__(self, every_s: float) -> None:
        self.every_s = every_s
        self.flag: Notice | None = None
        self._sum = 0.0
        self._pending: tuple[float, float, Future[Horizon | NoHorizon]] | None = None  # roll, fx over fy, answer
        self._last_s = -np.inf  # of the last picture looked at

    @cached_property
    def _thread(self) -> ThreadPoolExecutor:
        return ThreadPoolExecutor(1, "horizon")

    def __call__(self, frame: Frame) -> None:
        """Take the answer that is due, and begin the next look when it is time."""
        if not self._last_s <= frame.time_s:  # another flight, or not a number
            self._pending, self._last_s, self._sum, self.flag = None, -np.inf, 0.0, None
        if self._pending is not None and frame.time_s - self._last_s >= ANSWER_S:
            roll_deg, fx_over_fy, answer = self._pending
            self._pending = None
            self._judge(roll_deg, fx_over_fy, answer.result())
        is_due = self.every_s > 0 and frame.time_s - self._last_s >= self.every_s
        if is_due and self._pending is None and (expected_deg := expect_horizon(frame)) is not None:
            look = self._thread.submit(find_horizon, frame.image_rgb, rough=True)
            self._pending = expected_deg, frame.camera.fx / frame.camera.fy, look
            self._last_s = frame.time_s

    def _judge(self, expected_deg: float, fx_over_fy: float, horizon: Horizon | NoHorizon) -> None:
        if isinstance(horizon, NoHorizon):
            return
        turned_deg = float(np.rad2deg(np.arctan(horizon.slope * fx_over_fy))) - expected_deg
        excess = abs(turned_deg) / (TURNED_DEG + SIGMAS * float(np.rad2deg(horizon.slope_sigma))) - 1.0
        self._sum = min(max(self._sum + excess, 0.0), MOST)
        if self._sum < FLAGGED:
            self.flag = None
        elif excess > 0:
            message = f"the horizon in the picture is turned by {turned_deg:+.1f} degrees against the attitude"
            self.flag = Notice(Reason.ATTITUDE, message)


def expect_horizon(frame: Frame) -> float | None:
    """The roll that the attitude gives a level horizon in the image, degrees (+: down to the right).

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
    return roll_deg if 0 <= row <= camera.height - 1 else None
