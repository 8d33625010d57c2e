"""The autopilot's clock, from TIMESYNC."""

from collections import deque

ANSWERS = 16  # that are compared; three seconds at five a second
TOLERANCE_NS = 1_000_000  # between two answers beyond their round trips: drift of the clocks


class ClockOffset:
    """The autopilot's clock minus this machine's, from the answer with the shortest round trip of the last ones.

    The autopilot reads its clock between request and answer, so half a round trip bounds the error. An answer that
    differs from another by more means that the clock was reset: the older answers are dropped.

    Attributes:
        offset_s: None before the first answer.

    Source: MAVLink, Time Synchronization Protocol v2; Mills, RFC 5905, section 10 (clock filter).
    """

    def __init__(self) -> None:
        self.offset_s: float | None = None
        self._pending: deque[int] = deque(maxlen=ANSWERS)
        self._answers: deque[tuple[int, int]] = deque(maxlen=ANSWERS)  # round trip, offset, ns

    def request(self, now_ns: int) -> int:
        """`ts1` of a TIMESYNC request."""
        self._pending.append(now_ns)
        return now_ns

    def add_answer(self, tc1: int, ts1: int, now_ns: int) -> None:
        """Use an answer that arrived at `now_ns`; ignore one without a pending request."""
        if ts1 not in self._pending:
            return
        self._pending.remove(ts1)
        trip, offset = now_ns - ts1, tc1 - (ts1 + now_ns) // 2
        if any(abs(offset - other) > (trip + its_trip) // 2 + TOLERANCE_NS for its_trip, other in self._answers):
            self._answers.clear()
        self._answers.append((trip, offset))
        self.offset_s = 1e-9 * min(self._answers)[1]
