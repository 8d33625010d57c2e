"""Work over several processes of this machine or over a Ray cluster; processes that die are replaced."""

import os
from collections.abc import Callable, Generator, Iterable
from contextlib import closing
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, TypeVar

from deckline.files import print_line

X = TypeVar("X")
Y = TypeVar("Y")
RETRIES = 3  # of a task whose process died; a task that dies more often dies of itself


@dataclass(frozen=True)
class RayCluster:
    """A Ray cluster that does the work."""

    address: str = ""
    """HOST:PORT, or `auto` for the one that runs on this machine; empty: start one here and end it with the work."""


Jobs = int | RayCluster  # who works: 1: this process, 0: a process for every core, more: so many processes


class Finished(NamedTuple):
    """A task that a pool is done with."""

    position: int
    """Of its item among all items, from 0."""
    result: Any
    """None where there is an error."""
    error: BaseException | None
    """What the task raised, or `ProcessDiedError`."""


class ProcessDiedError(OSError):
    """The process of a task ended before the task did."""


class Pool(Protocol):
    """What does tasks elsewhere."""

    size: int
    """Tasks that it takes at a time."""

    def submit(self, position: int, item: Any) -> None:
        """Begin a task; at most `size` may be unfinished."""
        ...

    def wait(self) -> list[Finished]:
        """The tasks that have ended since the last call; waits for one."""
        ...

    def close(self) -> None:
        """Stop all work, that of unfinished tasks included."""
        ...


def process_count(jobs: int) -> int:
    """Processes that `jobs` asks for; 0 means one for every core that this process may use.

    Raises:
        ValueError: negative jobs.
    """
    if jobs < 0:
        raise ValueError(f"jobs must not be negative, got {jobs}")
    return jobs or len(os.sched_getaffinity(0))


def works_here(jobs: Jobs) -> bool:
    """Whether this process does the work itself; errors as `process_count`."""
    return not isinstance(jobs, RayCluster) and process_count(jobs) == 1


def map_ordered(task: Callable[[X], Y], items: Iterable[X], jobs: Jobs = 1) -> Generator[Y, None, None]:
    """`task(item)` of every item, in their order.

    At most twice as many items as the pool takes are in work or wait for their turn. Otherwise as `map_finished`.
    """
    waiting: dict[int, Y] = {}
    turn = 0
    with closing(map_finished(task, items, jobs, ordered=True)) as results:
        for position, result in results:
            waiting[position] = result
            while turn in waiting:
                yield waiting.pop(turn)
                turn += 1


def map_finished(
    task: Callable[[X], Y],
    items: Iterable[X],
    jobs: Jobs = 1,
    name: Callable[[int], str] | None = None,
    ordered: bool = False,
) -> Generator[tuple[int, Y], None, None]:
    """Position of every item and `task(item)`, as they finish.

    A task whose process dies is begun again, up to `RETRIES` times, with a line on stderr. Closing the generator, as an
    error or Ctrl-C does, stops the processes; they also end when this process is killed.

    Args:
        task: picklable when jobs is not 1, as are items and results. It must not matter if it is begun twice.
        jobs: who works.
        name: of the item at a position, in messages; `task POSITION` when not given.
        ordered: begin no task that is more than twice the pool's size after the first unfinished one.

    Raises:
        ValueError: negative jobs.
        OSError: a task's process died again and again; names the item.
        ImportError: a Ray cluster is asked for, and Ray is not installed.
    """
    if works_here(jobs):
        for position, item in enumerate(items):
            yield position, task(item)
        return
    with closing(_open_pool(task, jobs)) as pool:
        yield from _run_in(pool, items, name, 2 * pool.size if ordered else None)


def _open_pool(task: Callable[[X], Y], jobs: Jobs) -> Pool:
    if isinstance(jobs, RayCluster):
        from deckline_sim.ray_tasks import RayPool

        return RayPool(task, jobs.address)
    from deckline_sim.local_tasks import LocalPool

    return LocalPool(task, process_count(jobs))


def _run_in(
    pool: Pool, items: Iterable[X], name: Callable[[int], str] | None, window: int | None
) -> Generator[tuple[int, Any], None, None]:
    """As `map_finished`; `window`: no task is begun that is so far after the first unfinished one."""
    left = enumerate(items)
    running: dict[int, X] = {}
    deaths: dict[int, int] = {}
    more = True
    while True:
        first = min(running, default=None)
        while more and len(running) < pool.size:
            if window is not None and first is not None and max(running) + 1 >= first + window:
                break
            taken = next(left, None)
            more = taken is not None
            if taken is not None:
                running[taken[0]] = taken[1]
                pool.submit(*taken)
                first = taken[0] if first is None else first
        if not running:
            return
        for position, result, error in pool.wait():
            if isinstance(error, ProcessDiedError):
                deaths[position] = deaths.get(position, 0) + 1
                _report_death(name(position) if name else f"task {position}", deaths[position], error)
                pool.submit(position, running[position])
            elif error is not None:
                raise error
            else:
                del running[position]
                yield position, result


def _report_death(what: str, deaths: int, error: ProcessDiedError) -> None:
    if deaths > RETRIES:
        raise OSError(f"{what}: a process died, {deaths} times ({error}; out of memory?)") from error
    print_line(f"{what}: a process died ({error}); retry {deaths} of {RETRIES}")
