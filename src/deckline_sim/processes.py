"""Work over several processes, each on cores of its own, with the results in order."""

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.sharedctypes import Synchronized
from typing import Any, TypeVar

X = TypeVar("X")
Y = TypeVar("Y")


def process_count(jobs: int) -> int:
    """Processes that `jobs` asks for; 0 means one for every core that this process may use.

    Raises:
        ValueError: negative jobs.
    """
    if jobs < 0:
        raise ValueError(f"jobs must not be negative, got {jobs}")
    return jobs or len(os.sched_getaffinity(0))


def map_ordered(task: Callable[[X], Y], items: Iterable[X], jobs: int = 1) -> Generator[Y, None, None]:
    """`task(item)` of every item, in their order.

    At most 2 * jobs items are in work or wait for their turn. Closing the generator, as an error or Ctrl-C does, stops
    the processes; they also end when this process is killed.

    Args:
        task: picklable when jobs is not 1, as are items and results.
        jobs: processes; 1: this process does the work, 0: one for every core.

    Raises:
        ValueError: negative jobs.
        OSError: a process died.
    """
    count = process_count(jobs)
    if count == 1:
        yield from map(task, items)
        return
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(count, context, _start_worker, (context.Value("i", 0), count))
    waiting: deque[Future[Y]] = deque()
    try:
        for item in items:
            waiting.append(_submit(pool, task, item))
            if len(waiting) == 2 * count:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    except BrokenProcessPool as error:
        raise OSError("a process died (out of memory?): give the command again to go on") from error
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _submit(pool: ProcessPoolExecutor, task: Callable[[X], Y], item: X) -> "Future[Y]":
    """Submit with Ctrl-C blocked: a process started here inherits that, so that only this process hears Ctrl-C."""
    mask: Any = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        return pool.submit(task, item)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def _start_worker(started: "Synchronized[int]", count: int) -> None:
    """Restrict a new process to its share of the cores: renderer and networks start a thread for each core."""
    with started.get_lock():
        number = started.value % count
        started.value += 1
    cores = sorted(os.sched_getaffinity(0))
    share = cores[number::count] or [cores[number % len(cores)]]
    os.sched_setaffinity(0, share)
    os.environ.setdefault("LP_NUM_THREADS", str(len(share)))  # of Mesa's software rasteriser
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
