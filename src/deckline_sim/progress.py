"""A progress bar on the screen."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, Task, TextColumn, TimeRemainingColumn
from rich.text import Text


@contextmanager
def progress(what: str, total: int, done: int = 0, unit: str = "") -> Iterator[Callable[..., None]]:
    """A bar on the screen; calling what it gives moves it on by one, or by the number that it is called with.

    Args:
        what: stands before the bar.
        total: at its end.
        done: where it begins.
        unit: of what is counted, for a rate behind the bar; empty: no rate.
    """
    rate = (_RateColumn(unit),) if unit else ()
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), *rate, TimeRemainingColumn()
    with Progress(*columns, console=Console(stderr=True)) as bars:
        task = bars.add_task(what, total=total, completed=done)
        yield lambda count=1: bars.advance(task, count)


class _RateColumn(ProgressColumn):
    """How fast it goes, such as 31.2 landings/s."""

    def __init__(self, unit: str) -> None:
        super().__init__()
        self._unit = unit

    def render(self, task: Task) -> Text:
        speed = task.finished_speed or task.speed
        return Text("" if speed is None else f"{speed:.3g} {self._unit}/s")
