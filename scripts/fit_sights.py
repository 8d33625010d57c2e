"""Fit the models by which landings are seen without pictures, and check each against the way it was fitted to.

python scripts/fit_sights.py render LOOKS       # fly rendered approaches, one file of looks each; resumes; --jobs N
python scripts/fit_sights.py detection LOOKS    # fit detection_model.json to half of them
python scripts/fit_sights.py points POINTS      # fly approaches by points, one file each; resumes; --jobs N
python scripts/fit_sights.py guidance POINTS    # fit guidance_model.json to half of them
python scripts/fit_sights.py check LOOKS POINTS # compare on those kept apart
"""

import argparse
import json
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import asdict
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from deckline.atomic import write_atomic
from deckline_lab.campaigns.compare import error_table, status_table
from deckline_lab.campaigns.fit_detection import fit_detection, read_flight
from deckline_lab.campaigns.fit_guidance import fit_guidance, gather
from deckline_lab.campaigns.looks import approach_moments, fly_looks, look_record, looks_json, read_looks
from deckline_lab.evaluation.tables import markdown
from deckline_sim.landing import detection_model, guidance_model
from deckline_sim.landing.config import LandingCamera, LandingConfig
from deckline_sim.landing.guidance_sight import GuidanceSight
from deckline_sim.landing.point_sight import PointSight
from deckline_sim.landing.rendered_sight import RenderedSight
from deckline_sim.landing.surroundings import Surroundings
from deckline_sim.progress import progress
from deckline_sim.task_files import write_missing

RENDERED_SEED, POINTS_SEED = 7000, 8000  # the shipped weights never saw seeds from 1000 on
SEEN_VISIBILITIES = 1.5  # distance where a flight begins, in visibilities: hardly anything is seen beyond
FARTHEST_M = 1500.0
RATE_HZ = 5.0  # of rendered flights: a frame takes seconds to render and search on a busy processor
SETTINGS = (  # ship, visibility, m, sea state, time of day
    *(("cvn", 1000.0, 3.0, "day"), ("cvn", 800.0, 2.0, "day")),
    *(("cvn", 500.0, 4.0, "dusk"), ("cvn", 600.0, 5.0, "day")),
    *(("paper", 700.0, 2.0, "day"), ("paper", 900.0, 3.0, "day")),
    *(("cvn", 300.0, 0.0, "day"), ("cvn", 400.0, 3.0, "day")),
    *(("cvn", 2000.0, 1.0, "day"), ("cvn", 1400.0, 4.0, "day")),
    *(("paper", 1200.0, 4.0, "day"), ("paper", 1000.0, 1.0, "dusk")),
    *(("cvn", 700.0, 5.0, "day"), ("cvn", 1000.0, 0.0, "dusk")),
)
RENDERED = (*SETTINGS, *SETTINGS[1:], SETTINGS[0])  # in turn fitted to and kept apart; the second time the other way
BY_POINTS = tuple(  # repetition (fitted to, kept apart), visibility, m, navigation, sea state
    product(range(2), (300.0, 700.0, 1500.0), guidance_model.GRADES, (1.0, 4.0))
)
COMPARED = ("lateral", "height", "distance")
Flight = tuple[Surroundings, list[dict[str, Any]]]


def landing_config(
    ship: str, visibility_m: float, sea_state: float, time_of_day: str, navigation: str, rate_hz: float
) -> LandingConfig:
    """The configuration of a flight from where something may be seen."""
    return LandingConfig(
        ship,  # type: ignore[arg-type]
        visibility_m=visibility_m,
        time_of_day=time_of_day,  # type: ignore[arg-type]
        sea_state=sea_state,
        start_m=min(FARTHEST_M, SEEN_VISIBILITIES * visibility_m),
        camera=LandingCamera(rate_hz=rate_hz),
        navigation=navigation,  # type: ignore[arg-type]
    )


def render(out: Path, jobs: int) -> None:
    """Fly the rendered approaches that `out` does not hold."""
    write_flights(rendered_flight, len(RENDERED), out, jobs)


def rendered_flight(number: int) -> bytes:
    """The looks of one rendered approach."""
    ship, visibility_m, sea_state, time_of_day = RENDERED[number]
    config = landing_config(ship, visibility_m, sea_state, time_of_day, "good", RATE_HZ)
    with closing(RenderedSight(config, RENDERED_SEED + number)) as sight:
        looks = []
        for moment in approach_moments(sight.surroundings):
            found = sight.see(moment)
            detection = None if sight.result is None else sight.result.detection
            looks.append(look_record(sight.surroundings, moment, found, detection))
        return looks_json(sight.surroundings, looks)


def fly_points(out: Path, jobs: int) -> None:
    """Fly the approaches by points that `out` does not hold."""
    write_flights(flight_by_points, len(BY_POINTS), out, jobs)


def flight_by_points(number: int) -> bytes:
    """The looks of one approach by points."""
    _, visibility_m, navigation, sea_state = BY_POINTS[number]
    config = landing_config("cvn", visibility_m, sea_state, "day", navigation, 10.0)
    with closing(PointSight(config, POINTS_SEED + number)) as sight:
        return looks_json(sight.surroundings, fly_looks(sight.surroundings, sight))


def write_flights(fly: Callable[[int], bytes], count: int, out: Path, jobs: int) -> None:
    """Write the missing ones of OUT/000.json, OUT/001.json, ..."""
    files = {out / f"{number:03d}.json": number for number in range(count)}
    with progress("flying", count, sum(path.exists() for path in files), "approaches") as advance:
        write_missing(fly, files, jobs, lambda _: advance(1))


def read_flights(folder: Path) -> list[Flight]:
    """All flights of a folder, in their order."""
    paths = sorted(folder.glob("*.json"))
    if not paths:
        raise SystemExit(f"no flights in {folder}")
    return [read_looks(path) for path in paths]


def is_kept_apart(scene: Surroundings) -> bool:
    """Whether a flight is checked with: every other rendered one, the second repetition by points."""
    if scene.seed < POINTS_SEED:
        return (scene.seed - RENDERED_SEED) % 2 == 1
    return scene.seed - POINTS_SEED >= len(BY_POINTS) // 2


def write_detection_model(folder: Path) -> None:
    """Fit to rendered flights and write the shipped model."""
    flights = [flight for flight in read_flights(folder) if not is_kept_apart(flight[0])]
    rate_hz = flights[0][0].config.camera.rate_hz
    model = fit_detection([read_flight(number, *flight) for number, flight in enumerate(flights)], rate_hz)
    write_model(detection_model.MODEL_FILE, "detection LOOKS", flights, {"model": asdict(model)}, indent=1)


def write_guidance_model(folder: Path) -> None:
    """Fit to flights by points and write the shipped model."""
    flights = [flight for flight in read_flights(folder) if not is_kept_apart(flight[0])]
    model = fit_guidance(gather(flights), flights[0][0].config.camera.rate_hz)
    tables = {name: rounded(value) if isinstance(value, np.ndarray) else value for name, value in vars(model).items()}
    write_model(guidance_model.MODEL_FILE, "guidance POINTS", flights, tables)


def rounded(values: np.ndarray) -> Any:
    """An array as lists of numbers with five digits."""
    return json.loads(json.dumps(values.tolist()), parse_float=lambda text: float(f"{float(text):.5g}"))


def write_model(
    path: Path, command: str, flights: Sequence[Flight], tables: dict[str, Any], indent: int | None = None
) -> None:
    """Write a model's file, with the command and the flights that it was fitted to."""
    looks = sum(len(looks) for _, looks in flights)
    source = {"command": f"python scripts/fit_sights.py {command}", "flights": len(flights), "looks": looks}
    separators = None if indent else (",", ":")
    write_atomic(path, (json.dumps(source | tables, indent=indent, separators=separators) + "\n").encode())


def check(rendered: Path, points: Path) -> None:
    """Print how points agree with rendered flights, and guidance with points, on flights kept apart."""
    pairs = ((rendered, ("rendered", "points"), PointSight), (points, ("points", "guidance"), GuidanceSight))
    for folder, names, sight in pairs:
        kept = [flight for flight in read_flights(folder) if is_kept_apart(flight[0])]
        again = [fly_again(scene, sight) for scene, _ in kept]
        for table in (error_table(kept, again, names, COMPARED), status_table(kept, again, names)):
            print(markdown(table), end="\n\n")


def fly_again(scene: Surroundings, sight: type[PointSight] | type[GuidanceSight]) -> Flight:
    """The same flight seen another way: path, deck motion and sensor errors follow from its seed and are the same."""
    eyes = sight(scene.config, scene.seed)
    return eyes.surroundings, fly_looks(eyes.surroundings, eyes)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("step", choices=("render", "detection", "points", "guidance", "check"))
    parser.add_argument("folders", type=Path, nargs="+", help="LOOKS or POINTS; check takes both")
    parser.add_argument("--jobs", type=int, default=0, help="processes that fly; 0: one for every core")
    given = parser.parse_args()
    wanted = 2 if given.step == "check" else 1
    if len(given.folders) != wanted:
        parser.error(f"{given.step} takes {wanted} folders, got {len(given.folders)}")
    for folder in given.folders:
        folder.mkdir(parents=True, exist_ok=True)
    match given.step:
        case "render":
            render(*given.folders, given.jobs)
        case "points":
            fly_points(*given.folders, given.jobs)
        case "detection":
            write_detection_model(*given.folders)
        case "guidance":
            write_guidance_model(*given.folders)
        case _:
            check(*given.folders)


if __name__ == "__main__":
    main()
