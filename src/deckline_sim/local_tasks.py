"""Tasks in processes of this machine, each on cores of its own."""

import multiprocessing
import os
import signal
import threading
import traceback
from collections.abc import Callable
from contextlib import suppress
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any

from deckline_sim.processes import Finished, ProcessDiedError

EXIT_S = 5.0  # that an idle process has to end by itself


class LocalPool:
    """Processes that do one task each at a time.

    Args:
        task: picklable, as are items and results.
        count: of processes; they are started as they are needed.
    """

    def __init__(self, task: Callable[[Any], Any], count: int) -> None:
        self.size = count
        self._task = task
        self._workers: list[_Worker | None] = [None] * count
        self._running: dict[int, int] = {}  # process -> position of its task

    def submit(self, position: int, item: Any) -> None:
        """Begin a task in a process that has none."""
        number = next(k for k in range(self.size) if k not in self._running)
        worker = self._workers[number]
        if worker is None or not worker.process.is_alive():
            if worker is not None:
                worker.stop(busy=True)
            worker = self._workers[number] = _Worker(self._task, number, self.size)
        self._running[number] = position
        worker.begin(item)

    def wait(self) -> list[Finished]:
        """The tasks that have ended; waits for one."""
        busy = {worker.connection: k for k, worker in enumerate(self._workers) if worker and k in self._running}
        finished = []
        for connection in wait(list(busy)):
            number = busy[connection]  # type: ignore[index]
            worker = self._workers[number]
            if worker is None:
                raise AssertionError("unreachable: a task runs in a process")
            position = self._running.pop(number)
            try:
                finished.append(Finished(position, *worker.connection.recv()))
            except (EOFError, OSError):  # the second one: it died in the middle of a message
                worker.process.kill()  # one that lives, with a broken connection, would never be joined
                worker.process.join()
                finished.append(Finished(position, None, ProcessDiedError(f"exit code {worker.process.exitcode}")))
        return finished

    def close(self) -> None:
        """Stop the processes: those that work at once."""
        for number, worker in enumerate(self._workers):
            if worker is not None:
                worker.stop(number in self._running)
        self._workers = [None] * self.size


class _Worker:
    """A process and the connection to it."""

    def __init__(self, task: Callable[[Any], Any], number: int, count: int) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.process: BaseProcess = context.Process(target=_work, args=(theirs, task, number, count), daemon=True)
        # A process started with Ctrl-C blocked inherits that, so that only this process hears Ctrl-C. The tracker is
        # started before: its start lets Ctrl-C through again (cpython, Lib/multiprocessing/resource_tracker.py).
        resource_tracker.ensure_running()
        mask: Any = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            self.process.start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
            theirs.close()

    def begin(self, item: Any) -> None:
        """Send an item; that its process has died shows when its result is waited for."""
        try:
            self.connection.send(item)
        except (BrokenPipeError, ConnectionResetError):
            return

    def stop(self, busy: bool) -> None:
        """End the process; one that is busy is killed."""
        if busy:
            self.process.kill()
        self.connection.close()  # an idle process ends by that
        self.process.join(EXIT_S)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()
        self.process.close()


def _work(connection: Connection, task: Callable[[Any], Any], number: int, count: int) -> None:
    """A process: do tasks until the connection is closed."""
    _take_cores(number, count)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    while True:
        try:
            item = connection.recv()
        except (EOFError, OSError):
            return
        try:
            connection.send((task(item), None))
        except Exception as error:
            error.add_note(traceback.format_exc())
            with suppress(BrokenPipeError, ConnectionResetError):  # the work was stopped: nobody hears
                connection.send((None, error))


def _take_cores(number: int, count: int) -> None:
    """Restrict a new process to its share of the cores: renderer and networks start a thread for each core."""
    cores = sorted(os.sched_getaffinity(0))
    share = cores[number::count] or [cores[number % len(cores)]]
    os.sched_setaffinity(0, share)
    os.environ.setdefault("LP_NUM_THREADS", str(len(share)))  # of Mesa's software rasteriser


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
