"""Counts what a flight loses, and says so while it flies."""

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
        self._told, self._told_s = 0, 0.0  # losses that the last line counts, and when it went out
        self._lock = threading.Lock()

    def add(self, reason: str) -> None:
        """Count a loss."""
        with self._lock:
            self.count, self.reason = self.count + 1, reason
            if self.count > 1 and time.monotonic() - self._told_s < REPORT_EVERY_S:
                return
            self._tell()

    def close(self) -> None:
        """Say what no line has counted yet."""
        with self._lock:
            if self.count > self._told:
                self._tell()

    def _tell(self) -> None:
        self._told, self._told_s = self.count, time.monotonic()
        self._log(f"{self.count} {self._what}; the last one: {self.reason}")
