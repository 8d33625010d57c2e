"""The simulated time: it runs with the wall clock, stands still, or runs for so many seconds."""

import math
import time
from collections.abc import Callable


class Clock:
    """Seconds since it was made; every thread may read it.

    Args:
        ticks: a clock that never runs back, s.
        epoch_ns: when it was made, ns since 1970; None: now.
    """

    def __init__(self, ticks: Callable[[], float] = time.monotonic, epoch_ns: int | None = None) -> None:
        self._ticks = ticks
        self._epoch_ns = time.time_ns() if epoch_ns is None else epoch_ns
        self._run = (0.0, ticks(), math.inf)  # seconds at the start of this run, its tick, how long it may last

    def seconds(self) -> float:
        """Simulated seconds."""
        begun, tick, most = self._run
        return begun + min(self._ticks() - tick, most)

    def nanoseconds(self, seconds: float) -> int:
        """A simulated time as a time stamp, ns since 1970."""
        return self._epoch_ns + round(seconds * 1e9)

    @property
    def paused(self) -> bool:
        """Whether it stands still."""
        _, tick, most = self._run
        return self._ticks() - tick >= most

    def pause(self, paused: bool) -> None:
        """Stand still, or run on."""
        self.run_for(0.0 if paused else math.inf)

    def run_for(self, seconds: float) -> None:
        """Run on, and stand still after so many seconds."""
        self._run = (self.seconds(), self._ticks(), seconds)
