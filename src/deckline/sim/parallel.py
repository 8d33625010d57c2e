"""Renders frames over several processes and hands the results back in order."""

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from itertools import groupby
from typing import TypeVar

from deckline.extras import needs_extra
from deckline.processes import process_count
from deckline.types import Frame

with needs_extra("sim"):
    from deckline.sim import RendererError, SimConfig, open_simulator
    from deckline.sim.simulate import block_of

CHUNK = 4  # most frames that a process is given at a time; results waiting for their turn stay below 2 * CHUNK * jobs
T = TypeVar("T")
Item = tuple[SimConfig, int]  # a recording and the index of one of its frames


class RenderingError(OSError):
    """Rendering stopped: no OpenGL on this machine, or a process that died."""


def map_frames(task: Callable[[Frame], T], items: Sequence[Item], jobs: int = 1) -> Generator[T, None, None]:
    """`task(frame)` of every item, in their order and the same whatever `jobs` is.

    Closing the iterator, as an error or Ctrl-C does, stops the processes; they also end when this one is killed.

    Args:
        task: what is done to a frame where it is rendered; must be picklable when jobs is not 1.
        items: frames; neighbours that share a ship are rendered by one process.
        jobs: processes; 1 renders in this one, 0 takes as many as there are cores.

    Raises:
        ValueError: negative jobs.
        RenderingError: no OpenGL on this machine, or a process died.
    """
    count = process_count(jobs)
    try:
        if count == 1:
            yield from _here(task, items)
        else:
            yield from _spread(task, _chunks(items), count)
    except RendererError as error:
        raise RenderingError(str(error)) from error
    except BrokenProcessPool as error:
        raise RenderingError("a rendering process died (out of memory?): give the command again to go on") from error


class _Stage:
    """Renders items; keeps the simulator of the last one."""

    def __init__(self) -> None:
        self._config: SimConfig | None = None
        self._open = ExitStack()

    def frame(self, config: SimConfig, index: int) -> Frame:
        if config != self._config:
            self._open.close()
            self._config, self._simulator = config, self._open.enter_context(open_simulator(config))
        return self._simulator.frame(index)

    def close(self) -> None:
        self._open.close()


def _here(task: Callable[[Frame], T], items: Iterable[Item]) -> Iterator[T]:
    stage = _Stage()
    try:
        for config, index in items:
            yield task(stage.frame(config, index))
    finally:
        stage.close()


def _chunks(items: Sequence[Item]) -> Iterator[list[Item]]:
    """Neighbours of one recording and one ship, at most CHUNK of them."""
    for _, group in groupby(items, key=lambda item: (id(item[0]), block_of(*item))):
        whole = list(group)
        for first in range(0, len(whole), CHUNK):
            yield whole[first : first + CHUNK]


def _spread(task: Callable[[Frame], T], chunks: Iterator[list[Item]], count: int) -> Iterator[T]:
    threads = max(1, process_count(0) // count)
    pool = ProcessPoolExecutor(count, multiprocessing.get_context("spawn"), _begin, (threads,))
    waiting: deque[Future[list[T]]] = deque()
    try:
        for chunk in chunks:
            waiting.append(_submit(pool, task, chunk))
            if len(waiting) == 2 * count:
                yield from waiting.popleft().result()
        while waiting:
            yield from waiting.popleft().result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _submit(pool: ProcessPoolExecutor, task: Callable[[Frame], T], chunk: list[Item]) -> "Future[list[T]]":
    """Submit with Ctrl-C blocked: processes started now inherit that, and it is this process alone that stops."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        return pool.submit(_work, task, chunk)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


_stage = _Stage()  # of a rendering process


def _begin(threads: int) -> None:
    """First thing in a rendering process: share the cores out, and end with the parent."""
    os.environ.setdefault("LP_NUM_THREADS", str(threads))  # Mesa's software rasteriser would start one for every core
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _work(task: Callable[[Frame], T], chunk: list[Item]) -> list[T]:
    return [task(_stage.frame(config, index)) for config, index in chunk]
