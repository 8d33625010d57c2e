"""What Ctrl-C and SIGTERM do while something runs."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def on_first_signal(action: Callable[[], None], *numbers: signal.Signals) -> Iterator[None]:
    """Call `action` at the first of these signals; a second one acts as it does outside. Main thread only."""
    before = {number: signal.getsignal(number) for number in numbers}

    def restore() -> None:
        for number, handler in before.items():
            signal.signal(number, handler)

    def act(_number: int, _frame: FrameType | None) -> None:
        restore()
        action()

    for number in numbers:
        signal.signal(number, act)
    try:
        yield
    finally:
        restore()
