"""The rows of `deckline eval localization`: which chain each is, and how they share what they have in common."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from deckline.config import Models, RunConfig
from deckline.dehaze import NOT_DEHAZED
from deckline.detect import Detector
from deckline.flight import Flight
from deckline.localize import Localizer, localize
from deckline.report.provenance import settings_of
from deckline_lab.evaluation.approaches import PointNoise
from deckline_lab.evaluation.chain import single_frames
from deckline_lab.evaluation.dehazers import SharedDehazer, detector_label
from deckline_lab.rivals.catalog import flight_from_config, open_flights
from deckline_lab.rivals.sgd import localize_by_descent
from deckline_sim.landing.modelled_detector import point_flight


@dataclass(frozen=True)
class Method:
    """A row of the tables: a configuration, and the estimator of its lines in the world."""

    name: str
    config: RunConfig
    localizer: Localizer = localize
    exact_pose: bool = False  # flies with the true pose: what is left is the vision's own error

    @property
    def tracked(self) -> bool:
        return self.config.tracking.enabled

    def fly(self) -> Flight:
        """A flight with models of its own."""
        return flight_from_config(self.config, localizer=self.localizer)


HAZY, DEHAZED, PAPERS, EXACT = "hazy", "dehazed", "paper's", "exact pose"  # words of which a row's name is made
SHIPPED = "as shipped, tracked"


def methods_of(config: RunConfig, rivals: Sequence[str]) -> list[Method]:
    """The rows of the table, the one that improvements refer to first.

    Each detector without and with dehazing, the paper's estimator behind both; the first rival's again with the true
    pose; then our estimator, our track, and the defaults of `deckline run`.

    Args:
        config: of our rows; its dehazer is every row's that dehazes.
        rivals: detectors to compare with.

    Raises:
        ValueError: two detectors that would have one name.
    """
    single, models = single_frames(config), config.models
    chains = {DEHAZED: replace(models, detect_in="dehazed")}
    chains[HAZY] = replace(models, dehazer=NOT_DEHAZED, detect_in="hazy")
    named: dict[str, str] = {}
    for each in (*rivals, models.detector):
        if named.setdefault(detector_label(each), each) != each:
            raise ValueError(f"rival: two rows would be called {detector_label(each)}: rename {each} or its folder")

    def row(seen: str, detector: str, *words: str, base: RunConfig = single) -> Method:
        localizer, exact = localize_by_descent if PAPERS in words else localize, EXACT in words
        given = replace(base, models=replace(chains[seen], detector=named[detector]))
        return Method(", ".join((detector, seen, *words)), given, localizer, exact)

    first, own = detector_label([*rivals, models.detector][0]), detector_label(models.detector)
    rows = [row(seen, detector, PAPERS) for detector in named for seen in (HAZY, DEHAZED)]
    rows += [row(seen, first, PAPERS, EXACT) for seen in (HAZY, DEHAZED)]
    rows += [row(seen, own, "ours") for seen in (HAZY, DEHAZED)]
    rows += [row(seen, own, "ours, tracked", base=config) for seen in (HAZY, DEHAZED)]
    return [*rows, Method(SHIPPED, replace(config, models=Models()))]


@dataclass(frozen=True, eq=False)
class LocalizationBench:
    """Every method's models, loaded once."""

    start: Callable[[Method], Flight]  # a new flight of a method
    settings: dict[str, Any]  # what decides the numbers: plain values
    correlation: float = 0.0  # of neighbouring points' errors, where they are drawn: what the bound counts


def load(methods: Sequence[Method]) -> LocalizationBench:
    """Load each model once; methods that share a dehazer share its work."""
    settings: dict[str, Any] = {}
    dehazers: dict[str, SharedDehazer] = {}
    detectors: dict[str, Detector] = {}
    for method, flight in zip(methods, open_flights(method.config for method in methods), strict=True):
        settings[method.name] = {**settings_of(flight), "estimator": method.localizer.__name__}
        dehazers.setdefault(method.config.models.dehazer, SharedDehazer(flight.dehazer))
        detectors.setdefault(method.config.models.detector, flight.detector)

    def start(method: Method) -> Flight:
        models = method.config.models
        return Flight(method.config, dehazers[models.dehazer], detectors[models.detector], method.localizer)

    return LocalizationBench(start, settings)


def point_methods(config: RunConfig) -> list[Method]:
    """The rows that need no picture."""
    single = single_frames(config)
    return [
        Method("paper's", single, localize_by_descent),
        Method("ours", single),
        Method("ours, tracked", config),
    ]


def point_bench(methods: list[Method], noise: PointNoise) -> LocalizationBench:
    """Flights that are given their detections."""

    def start(method: Method) -> Flight:
        return point_flight(method.config, method.localizer)

    settings: dict[str, Any] = {"points": asdict(noise)}
    settings |= {method.name: settings_of(start(method)) for method in methods}
    return LocalizationBench(start, settings, noise.correlation)
