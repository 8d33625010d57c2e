"""Files made by a pure function, over processes or a Ray cluster; those that are there are not made again."""

from collections.abc import Callable, Mapping
from contextlib import closing
from pathlib import Path
from typing import TypeVar

from deckline.atomic import write_atomic
from deckline_sim.processes import Jobs, map_finished

X = TypeVar("X")


def write_missing(
    task: Callable[[X], bytes], files: Mapping[Path, X], jobs: Jobs = 1, advance: Callable[[X], None] | None = None
) -> None:
    """Write `task(item)` into the file of every item that has none yet. Every file is whole or absent.

    Args:
        task: the bytes of a file, the same whoever makes them; picklable, as are the items.
        files: item of every file; their folders exist. This process writes the files.
        jobs: who does the tasks.
        advance: called with the item of each file that was written.

    Raises:
        ValueError: as the task.
        OSError: as the task; the disk refuses; the process of a task died again and again.
    """
    missing = [(path, item) for path, item in files.items() if not path.exists()]
    items = [item for _, item in missing]
    with closing(map_finished(task, items, jobs, name=lambda position: str(missing[position][0]))) as results:
        for position, data in results:
            path, item = missing[position]
            write_atomic(path, data)
            if advance is not None:
                advance(item)
