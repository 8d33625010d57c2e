"""What threads hand to each other: the newest item only, or a bounded queue to a slow writer."""

import queue
import threading
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class Mailbox(Generic[T]):
    """One slot. A newer item replaces one that nobody took.

    Attributes:
        dropped: items that were replaced.
    """

    def __init__(self) -> None:
        self.dropped = 0
        self._item: T | None = None
        self._changed = threading.Condition()

    def put(self, item: T) -> None:
        with self._changed:
            self.dropped += self._item is not None
            self._item = item
            self._changed.notify_all()

    def put_last(self, item: T, timeout_s: float) -> None:
        """Put an item once the one before is taken, or after a time."""
        with self._changed:
            self._changed.wait_for(lambda: self._item is None, timeout_s)
        self.put(item)

    def take(self, timeout_s: float) -> T | None:
        """The newest item, waited for; None when there is none in time."""
        with self._changed:
            self._changed.wait_for(lambda: self._item is not None, timeout_s)
            item, self._item = self._item, None
            self._changed.notify_all()
            return item


class BackgroundWriter(Generic[T]):
    """Calls `write` in a thread of its own, so that a slow disk delays nobody. What does not fit is lost.

    Args:
        write: writes an item; its OSError or ValueError counts the item as lost.
        limit: items that wait, at most.

    Attributes:
        lost: items that were not written.
        error: why the last one of those that `write` refused was not written; empty: none was refused.
    """

    def __init__(self, write: Callable[[T], None], limit: int) -> None:
        self.lost = 0
        self.error = ""
        self._write = write
        self._queue: queue.Queue[T | None] = queue.Queue(limit)
        self._thread = threading.Thread(target=self._work, name="write", daemon=True)
        self._thread.start()

    def offer(self, item: T) -> None:
        try:
            self._queue.put_nowait(item)
        except queue.Full:
            self.lost += 1

    def close(self) -> None:
        """Wait until all that is queued is written."""
        self._queue.put(None)
        self._thread.join()

    def _work(self) -> None:
        while (item := self._queue.get()) is not None:
            try:
                self._write(item)
            except (OSError, ValueError) as error:
                self.lost += 1
                self.error = str(error)
