"""The simulator of a recording, and its frames one after the other."""

from collections.abc import Iterator

from deckline.sim.config import SimConfig
from deckline.sim.deckless import DecklessSimulator
from deckline.sim.simulate import Simulator
from deckline.types import Frame


def open_simulator(config: SimConfig) -> Simulator:
    """What renders the frames of a recording.

    Raises:
        RendererError: no OpenGL through EGL on this machine.
    """
    return DecklessSimulator(config) if config.trajectory == "deckless" else Simulator(config)


def frames(config: SimConfig, start: int = 0, stop: int | None = None) -> Iterator[Frame]:
    """Frames `start`, `start + 1`, ... of a recording, before `stop` (None: all).

    Raises:
        RendererError: no OpenGL through EGL on this machine.
        ValueError: a negative start.
    """
    if start < 0:
        raise ValueError(f"start must not be negative, got {start}")
    with open_simulator(config) as simulator:
        for index in range(start, config.frames if stop is None else min(stop, config.frames)):
            yield simulator.frame(index)
