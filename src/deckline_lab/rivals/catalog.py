"""Dehazers and detectors that an evaluation can name: those of `deckline`, and the rivals they are compared with."""

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from deckline.config import CPU, RunConfig
from deckline.dehaze import DEHAZERS, Dehazer, OnnxDehazer
from deckline.detect import DETECTORS, Detector, OnnxDetector
from deckline.flight import Flight
from deckline.runtime import shipped_weights
from deckline_lab.rivals import LAB_WEIGHTS
from deckline_lab.rivals.classical import ClassicalDetector
from deckline_lab.rivals.dark_channel import DarkChannelDehazer

# As in `deckline`: from the `Engine` that computes a network.
RIVAL_DEHAZERS: dict[str, Callable[..., Dehazer]] = {
    "dark-channel": lambda engine=CPU: DarkChannelDehazer(),
    "paper-scene": lambda engine=CPU: OnnxDehazer(
        shipped_weights("paper-scene", LAB_WEIGHTS), "paper-scene", engine, network_only=True
    ),
}
RIVAL_DETECTORS: dict[str, Callable[..., Detector]] = {"classical": lambda engine=CPU: ClassicalDetector()}
ALL_DEHAZERS = DEHAZERS | RIVAL_DEHAZERS
ALL_DETECTORS = DETECTORS | RIVAL_DETECTORS


def flight_from_config(config: RunConfig, **parts: Any) -> Flight:
    """`Flight.from_config` of a configuration whose models may be rivals.

    Args:
        config: everything that decides the answers.
        parts: a dehazer, a detector or a localizer that is used instead of the configuration's.

    Raises:
        ValueError: an unknown dehazer or detector, or a model file or an engine that cannot be used.
    """
    for part, rivals, known in (
        ("dehazer", RIVAL_DEHAZERS, ALL_DEHAZERS),
        ("detector", RIVAL_DETECTORS, ALL_DETECTORS),
    ):
        name = getattr(config.models, part)
        if parts.get(part) is not None:
            continue
        if name in rivals:
            parts[part] = rivals[name](config.engine)
        elif part == "detector" and name.endswith(".onnx"):
            parts[part] = OnnxDetector(Path(name), engine=config.engine, compare=True)
        elif name not in known and not name.endswith(".onnx"):
            names = ", ".join(known)
            raise ValueError(f"unknown {part} {name!r}: use one of {names}, or the path of an .onnx file")
    return Flight.from_config(config, **parts)


def open_flights(configs: Iterable[RunConfig]) -> Iterator[Flight]:
    """Flights of configurations with one engine, which share models of the same name: each is loaded once."""
    dehazers: dict[str, Dehazer] = {}
    detectors: dict[str, Detector] = {}
    for config in configs:
        models = config.models
        parts = {"dehazer": dehazers.get(models.dehazer), "detector": detectors.get(models.detector)}
        flight = flight_from_config(config, **parts)
        dehazers[models.dehazer], detectors[models.detector] = flight.dehazer, flight.detector
        yield flight
