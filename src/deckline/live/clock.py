"""When a picture was taken, on this machine's monotonic clock, which never jumps."""

import time
from collections import deque

LARGEST_STEP_S = 1.0  # between presentation times; a larger one, or one back, is a clock that was reset
PICTURES = 8  # whose least delay is used
LEAST_STEP_S = 1e-4  # between two captures


class WallClock:
    """Unix time from the monotonic clock since construction: setting the wall clock changes no ages."""

    def __init__(self) -> None:
        self._offset_s = time.time() - time.monotonic()

    def at(self, monotonic_s: float) -> float:
        return self._offset_s + monotonic_s


class StreamClock:
    """Capture times of a stream's pictures.

    A picture that the receiver waited for is new. Another one has waited in a buffer, and its presentation time gives
    for how long: its delay minus the least delay of the last pictures that were waited for. These are few, so that the
    clock follows a stream that states a wrong frame rate. A delay that all pictures share (exposure, coding, network)
    cannot be observed here.

    Attributes:
        is_set: whether a picture was waited for; earlier pictures have waited for an unknown time.
    """

    def __init__(self) -> None:
        self.is_set = False
        self._offsets_s: deque[float] = deque(maxlen=PICTURES)  # arrival minus presentation
        self._presented_s = self._captured_s = -float("inf")

    def capture_time(self, presented_s: float | None, arrival_s: float, waited: bool) -> float:
        """When the picture was taken, s: after the previous one and not after its arrival.

        Args:
            presented_s: presentation time on the stream's clock; None: the stream has none.
            arrival_s: when its data arrived, monotonic clock.
            waited: whether the receiver waited for them.
        """
        self.is_set |= waited
        captured_s = arrival_s
        if presented_s is not None:
            if not 0.0 < presented_s - self._presented_s < LARGEST_STEP_S:
                self._offsets_s.clear()
            offset_s, self._presented_s = arrival_s - presented_s, presented_s
            if waited or offset_s < min(self._offsets_s, default=float("inf")):
                self._offsets_s.append(offset_s)
            captured_s = presented_s + min(self._offsets_s)
        self._captured_s = min(max(captured_s, self._captured_s + LEAST_STEP_S), arrival_s)
        return self._captured_s
