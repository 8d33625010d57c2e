"""Renders frames over several processes and hands the results back in order."""

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, closing
from functools import partial
from itertools import groupby
from typing import TypeVar

from deckline.extras import needs_extra
from deckline.processes import map_ordered, process_count
from deckline.types import Frame

with needs_extra("sim"):
    from deckline.sim import SimConfig, open_simulator
    from deckline.sim.simulate import ship_block

CHUNK = 4  # most frames that a process is given at a time; results waiting for their turn stay below 2 * CHUNK * jobs
T = TypeVar("T")
Item = tuple[SimConfig, int]  # a recording and the index of one of its frames


def map_frames(task: Callable[[Frame], T], items: Sequence[Item], jobs: int = 1) -> Generator[T, None, None]:
    """`task(frame)` of every item, in their order and the same whatever `jobs` is; see `map_ordered`.

    Args:
        task: what is done to a frame where it is rendered; picklable when jobs is not 1.
        items: frames; neighbours that share a ship are rendered by one process.
        jobs: processes; 1 renders in this process, 0 takes as many as there are cores.

    Raises:
        ValueError: negative jobs.
        OSError: no OpenGL on this machine, or a process died.
    """
    if process_count(jobs) == 1:
        with closing(_Stage()) as stage:
            for config, index in items:
                yield task(stage.frame(config, index))
        return
    with closing(map_ordered(partial(_render_chunk, task), _split_chunks(items), jobs)) as chunks:
        for results in chunks:
            yield from results


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


_stage = _Stage()  # of a rendering process


def _render_chunk(task: Callable[[Frame], T], chunk: list[Item]) -> list[T]:
    return [task(_stage.frame(config, index)) for config, index in chunk]


def _split_chunks(items: Sequence[Item]) -> Iterator[list[Item]]:
    """Neighbours of one recording and one ship, at most CHUNK of them."""
    for _, group in groupby(items, key=lambda item: (id(item[0]), ship_block(*item))):
        same_ship = list(group)
        for first in range(0, len(same_ship), CHUNK):
            yield same_ship[first : first + CHUNK]
