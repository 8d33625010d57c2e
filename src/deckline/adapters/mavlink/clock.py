"""The autopilot's clock, from TIMESYNC."""

from collections import deque

KEPT = 16  # answers; three seconds at five a second
TOLERANCE_NS = 1_000_000  # between two answers besides their round trips: drift of the clocks


class ClockOffset:
    """The autopilot's clock minus this machine's: of the last answers the one of the shortest round trip counts.

    The clock was read between question and answer, so half a round trip bounds the error. Answers that contradict each
    other beyond that are of a clock that began anew, and only the newest counts.

    Attributes:
        offset_s: None: not known yet.

    Source: MAVLink, Time Synchronization Protocol v2; Mills, RFC 5905, section 10 (clock filter).
    """

    def __init__(self) -> None:
        self.offset_s: float | None = None
        self._asked: deque[int] = deque(maxlen=KEPT)
        self._answers: deque[tuple[int, int]] = deque(maxlen=KEPT)  # round trip, offset, ns

    def ask(self, now_ns: int) -> int:
        """`ts1` of a question."""
        self._asked.append(now_ns)
        return now_ns

    def take(self, tc1: int, ts1: int, now_ns: int) -> None:
        """An answer that arrived at `now_ns`; one to a question that nobody asked, or answered twice, is left out."""
        if ts1 not in self._asked:
            return
        self._asked.remove(ts1)
        trip, offset = now_ns - ts1, tc1 - (ts1 + now_ns) // 2
        if any(abs(offset - other) > (trip + its_trip) // 2 + TOLERANCE_NS for its_trip, other in self._answers):
            self._answers.clear()
        self._answers.append((trip, offset))
        self.offset_s = 1e-9 * min(self._answers)[1]
