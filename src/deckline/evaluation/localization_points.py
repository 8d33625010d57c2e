"""`deckline eval localization --points`: the same tables without pictures, of points with a stated noise."""

import zlib
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace

import numpy as np

from deckline.dehaze import NOT_DEHAZED
from deckline.evaluation.integrity_points import PointNoise
from deckline.evaluation.localization_flights import FlightsConfig
from deckline.evaluation.localization_methods import Bench, Method
from deckline.extras import needs_extra
from deckline.guide import guidance
from deckline.localize import LocalizeConfig, localize
from deckline.pipeline import FrameResult, PipelineConfig
from deckline.types import Detection, Frame, RunwayPrior

MODELLED = "modelled"
POINT_METHODS = [
    Method("paper's", NOT_DEHAZED, MODELLED, "paper"),
    Method("ours", NOT_DEHAZED, MODELLED, "joint"),
    Method("ours, tracked", NOT_DEHAZED, MODELLED, "joint", tracked=True),
]


@dataclass(frozen=True, eq=False)
class ModelledChain:
    """Everything after detection; what was detected in a frame is known beforehand."""

    config: PipelineConfig
    seen: dict[str, Detection]  # by the frame's name

    def __call__(self, frame: Frame, prior: RunwayPrior | None = None) -> FrameResult:
        detection = self.seen[frame.file]
        rng = np.random.default_rng(zlib.crc32(frame.file.encode()))
        estimate = localize(frame, detection, self.config.localize, rng)
        return FrameResult(frame, frame.image_rgb, detection, estimate, guidance(frame, estimate), {})


def modelled_bench(config: LocalizeConfig, noise: PointNoise) -> tuple[Bench, dict[str, Detection]]:
    """The rows that need no picture, and where they look up what was detected."""
    seen: dict[str, Detection] = {}
    configs = {m.name: PipelineConfig(localize=replace(config, method=m.estimator)) for m in POINT_METHODS}
    chains = {name: ModelledChain(chosen, seen) for name, chosen in configs.items()}
    settings = {"points": asdict(noise)} | {name: str(chosen.localize) for name, chosen in configs.items()}
    return Bench(chains, lambda: None, settings, noise.correlation), seen


def fly_points(flights: FlightsConfig, number: int, noise: PointNoise, seen: dict[str, Detection]) -> Iterator[Frame]:
    """The frames of one approach; `seen` holds what the detector saw in the one given last.

    Raises:
        ImportError: the sim extra is not installed.
    """
    with needs_extra("sim"):
        from deckline.evaluation.integrity_flights import point_flight
    for shot in point_flight(flights.approach(number), noise):
        seen.clear()
        seen[shot.frame.file] = shot.detection
        yield shot.frame
