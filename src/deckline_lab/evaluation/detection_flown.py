"""Detection as flown: recordings through the chain of `deckline run`, beside their frames as single pictures."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import TracebackType
from typing import Any, Self

from deckline.config import RunConfig
from deckline.flight import Flight, FrameResult
from deckline.report.bands import share
from deckline.report.provenance import settings_of
from deckline.types import RunwayPrior
from deckline_lab.evaluation.detection_score import DetectionScore, summarise, visible_figures, with_scene
from deckline_lab.evaluation.detection_truth import SceneKind
from deckline_lab.evaluation.frames import FrameSample, FrameSet
from deckline_lab.evaluation.picture_alone import without_pose
from deckline_lab.evaluation.tables import Columns, Figures, Table, cells
from deckline_lab.evaluation.visible_distance import CELLS, NOTE

SINGLE, FLOWN = "single pictures", "as flown"
FAR_M = 400.0
COLUMNS: Columns = {
    "decks": ("decks", 1.0, ".0f"),
    "empty": ("empty", 1.0, ".0f"),
    "found %": ("found_rate", 100.0, ".1f"),
    "in 3 px %": ("placed_rate", 100.0, ".1f"),
    f"found beyond {FAR_M:g} m %": ("far.found_rate", 100.0, ".1f"),
    "in 3 px %, beyond": ("far.placed_rate", 100.0, ".1f"),
    "wrong %": ("wrong_rate", 100.0, ".1f"),
    "false %": ("false_rate", 100.0, ".1f"),
    **CELLS,
}
FLOWN_NOTE = """\
as flown: every recording is one flight, tracked as in `deckline run`. wrong: decks with points on both \
lines, either of which is not right."""


class FlightPerSet:
    """Flies every set of frames as one flight with the models of another; leaving it as a context ends its threads.

    Args:
        poses: give the flight the frames' poses; else it sees them as a video's.
    """

    def __init__(self, sets: Sequence[FrameSet], models: Flight, poses: bool) -> None:
        self._configs = {
            item.name: replace(item.base_config or RunConfig(), models=models.config.models) for item in sets
        }
        self._models, self._poses = models, poses
        self._source: str | None = None
        self._flight: Flight | None = None

    @property
    def settings(self) -> dict[str, Any]:
        """What decides the answers."""
        flown = {}
        for name, config in self._configs.items():
            with self._start(config) as flight:
                flown[name] = settings_of(flight)
        return {"flown": flown, "poses": self._poses}

    def __call__(self, sample: FrameSample, prior: RunwayPrior | None = None) -> FrameResult:
        """The next frame of its set, from the first one on."""
        if self._flight is None or self._source != sample.source or sample.index == 0:
            self.close()
            self._source, self._flight = sample.source, self._start(self._configs[sample.source])
        frame = sample.frame if self._poses else without_pose(sample.frame)
        return self._flight(frame, prior=prior)

    def _start(self, config: RunConfig) -> Flight:
        return Flight(config, self._models.dehazer, self._models.detector)

    def close(self) -> None:
        if self._flight is not None:
            self._flight.close()
            self._flight = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def approach_figures(scores: Sequence[DetectionScore]) -> Figures:
    """`summarise`'s figures, those beyond FAR_M as `far.`, `wrong_rate`, and where lines are first held."""
    far = [score for score in scores if score.range_m > FAR_M]
    figures = summarise(scores) | {f"far.{name}": value for name, value in (summarise(far) if far else {}).items()}
    if decks := with_scene(scores, SceneKind.DECK):
        figures["wrong_rate"] = share(decks, lambda score: score.found == 2 and not score.is_right)
    return figures | visible_figures(scores)


def approach_table(modes: Mapping[str, Figures]) -> Table:
    """A row for single pictures, one as flown."""
    rows = [(mode, *cells(figures, COLUMNS)) for mode, figures in modes.items()]
    return Table("approaches", ("", *COLUMNS), rows, [FLOWN_NOTE, NOTE])
