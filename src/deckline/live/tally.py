"""Counts what a flight loses, and reports it while it flies."""

import threading
import time
from collections.abc import Callable

REPORT_EVERY_S = 5.0  # between two lines of a tally

Log = Callable[[str], None]  # takes lines for people


class Tally:
    """Counts losses of a kind: one line for the first, then at most one every `REPORT_EVERY_S`; for any thread.

    Args:
        what: is counted, such as "poses refused".
        log: receives the lines.

    Attributes:
        count: losses so far.
        reason: of the last one; empty: there was none.
    """

    def __init__(self, what: str, log: Log) -> None:
        self.count, self.reason = 0, ""
        self._what, self._log = what, log
        self._reported, self._reported_s = 0, 0.0  # losses that the last line counts, and when it went out
        self._lock = threading.Lock()

    def add(self, reason: str) -> None:
        """Count a loss."""
        with self._lock:
            self.count, self.reason = self.count + 1, reason
            if self.count > 1 and time.monotonic() - self._reported_s < REPORT_EVERY_S:
                return
            line = self._report()
        self._log(line)  # without the lock: a slow log delays nobody who counts

    def close(self) -> None:
        """Report what no line has counted yet."""
        with self._lock:
            line = self._report() if self.count > self._reported else ""
        if line:
            self._log(line)

    def _report(self) -> str:
        self._reported, self._reported_s = self.count, time.monotonic()
        return f"{self.count} {self._what}; the last one: {self.reason}"
