"""Films of flights with faults: what a pilot sees of one, and the same report and records as `deckline run` writes."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from deckline.flight import Flight
from deckline.recording.source import Source
from deckline.report.run import run as run_flight
from deckline.types import Frame
from deckline_lab.evaluation.approaches import FlightsConfig, Sighting
from deckline_lab.evaluation.integrity_score import FaultRun, flight_with, inject_run


class Frames(Source):
    """Frames that are at hand.

    Args:
        name: what the report calls them.
        frames: in order of time.
    """

    def __init__(self, name: str, frames: Sequence[Frame]) -> None:
        self.name, self._frames = name, frames

    @property
    def length(self) -> int:
        return len(self._frames)

    def items(self) -> Iterator[Frame]:
        return iter(self._frames)


def film(sightings: Sequence[Sighting], run: FaultRun, flights: FlightsConfig, models: Flight, out: Path) -> Path:
    """Fly a run over rendered frames once more, and write all that `deckline run` writes; returns the folder.

    Args:
        sightings: of one approach, in order of time, with depth.
        run: fault and aid.
        flights: what they were rendered from.
        models: a flight whose dehazer and detector are used.
        out: parent of the folder, which is named after the run.
    """
    faulty = [sighting.frame for sighting, _ in inject_run(sightings, run, flights)]
    flight = flight_with(sightings, run, flights, models)
    folder = out / f"{run.name} {run.number}".replace("; ", ", ").replace(" ", "_")
    run_flight(Frames(f"{run.name}, approach {run.number}", faulty), flight, folder, overwrite=True)
    return folder
