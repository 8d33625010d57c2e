"""Numbered tasks over several processes, each on cores of its own, their results in order."""

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.sharedctypes import Synchronized
from typing import TypeVar

T = TypeVar("T")


def process_count(jobs: int) -> int:
    """Processes that `jobs` asks for, 0 meaning one for every core that this process may use.

    Raises:
        ValueError: negative jobs.
    """
    if jobs < 0:
        raise ValueError(f"--jobs must not be negative, got {jobs}")
    return jobs or len(os.sched_getaffinity(0))


def in_processes(task: Callable[[int], T], numbers: Sequence[int], count: int) -> Iterator[tuple[int, T]]:
    """`task(number)` of every number, in their order.

    Args:
        task: picklable.
        numbers: of the tasks.
        count: processes.

    Raises:
        OSError: a process died.
    """
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(count, context, _begin, (context.Value("i", 0), count))
    try:
        yield from zip(numbers, pool.map(task, numbers), strict=True)
    except BrokenProcessPool as error:
        raise OSError("a process died (out of memory?): give the command again to go on") from error
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _begin(started: "Synchronized[int]", count: int) -> None:
    """First thing in a process: keep to its share of the cores, as renderer and networks start a thread for each."""
    with started.get_lock():
        number = started.value % count
        started.value += 1
    cores = sorted(os.sched_getaffinity(0))
    mine = cores[number::count] or [cores[number % len(cores)]]
    os.sched_setaffinity(0, mine)
    os.environ.setdefault("LP_NUM_THREADS", str(len(mine)))
