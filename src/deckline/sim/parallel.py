"""Renders frames over several processes and hands the results back in order."""

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from functools import partial
from itertools import groupby
from operator import itemgetter
from typing import TypeVar

from deckline.extras import needs_extra
from deckline.processes import map_ordered, process_count
from deckline.types import Frame

with needs_extra("sim"):
    from deckline.sim import SimConfig, open_simulator
    from deckline.sim.simulate import Simulator, ship_block

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
        for config, group in groupby(items, key=itemgetter(0)):
            with open_simulator(config) as simulator:
                for _, index in group:
                    yield task(simulator.frame(index))
        return
    with closing(map_ordered(partial(_render_chunk, task), _split_chunks(items), jobs)) as chunks:
        for results in chunks:
            yield from results


_opened: dict[SimConfig, Simulator] = {}  # the last recording's simulator in a rendering process


def _render_chunk(task: Callable[[Frame], T], chunk: list[Item]) -> list[T]:
    config = chunk[0][0]
    if config not in _opened:
        for other in list(_opened):
            _opened.pop(other).__exit__(None, None, None)
        _opened[config] = open_simulator(config)
    return [task(_opened[config].frame(index)) for _, index in chunk]


def _split_chunks(items: Sequence[Item]) -> Iterator[list[Item]]:
    """Neighbours of one recording and one ship, at most CHUNK of them."""
    for _, group in groupby(items, key=lambda item: (id(item[0]), ship_block(*item))):
        same_ship = list(group)
        for first in range(0, len(same_ship), CHUNK):
            yield same_ship[first : first + CHUNK]
