"""The search for the horizon beside a flight: a tenth of a second of a core, once in a while, in its own thread."""

from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from deckline.dehaze.horizon import Horizon, NoHorizon, find_horizon

ANSWER_S = 0.3  # after a picture, when its horizon is used; a frame at that time waits for it, so that replays agree


class HorizonSearch:
    """One search at a time. Times are the frames', so that a replay gives the same answers at the same frames.

    Args:
        every_s: from one search to the next; 0: none.
    """

    def __init__(self, every_s: float) -> None:
        self.every_s = every_s
        self._thread: ThreadPoolExecutor | None = None
        self.reset()

    def reset(self) -> None:
        """Forget the search under way."""
        self._pending: Future[Horizon | NoHorizon] | None = None
        self._last_s = -np.inf  # time of the last picture that was searched

    def close(self) -> None:
        """End the thread; the next search starts another."""
        self.reset()
        if self._thread is not None:
            self._thread.shutdown(cancel_futures=True)
            self._thread = None

    def take(self, time_s: float) -> Horizon | NoHorizon | None:
        """The answer that is due at a frame's time, of the picture that was searched; None: there is none."""
        if self._pending is None or time_s - self._last_s < ANSWER_S:
            return None
        pending, self._pending = self._pending, None
        return pending.result()

    def is_due(self, time_s: float) -> bool:
        """Whether the next search should start."""
        return self._pending is None and self.every_s > 0 and time_s - self._last_s >= self.every_s

    def start(self, time_s: float, image_rgb: NDArray[np.uint8]) -> None:
        """Search a picture (H, W, 3)."""
        if self._thread is None:
            self._thread = ThreadPoolExecutor(1, "horizon")
        self._pending, self._last_s = self._thread.submit(find_horizon, image_rgb, rough=True), time_s
