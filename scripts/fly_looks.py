"""Render the flights that the model of the detector is fitted to and checked with: one file of looks a flight.

    python scripts/fly_looks.py OUT [--most 16]

Flights that OUT holds already are left out. An even number is fitted to, an odd one is kept apart.
"""

import argparse
from pathlib import Path

from rich.progress import track

from deckline_lab.campaigns.looks import approach_moments, look_record, write_looks
from deckline_sim.landing.config import LandingCamera, LandingConfig
from deckline_sim.landing.rendered_sight import RenderedSight

FIRST_SEED = 7000  # the shipped weights never saw seeds from 1000 on
SEEN_VISIBILITIES = 1.5  # distance where a flight begins, in visibilities: hardly anything is seen beyond
FARTHEST_M = 1500.0
RATE_HZ = 5.0  # a frame takes about a second to render and search on a busy processor
FLIGHTS = (  # ship, visibility, m, sea state, time of day; in turn fitted to and kept apart
    *(("cvn", 1000.0, 3.0, "day"), ("cvn", 800.0, 2.0, "day")),
    *(("cvn", 500.0, 4.0, "dusk"), ("cvn", 600.0, 5.0, "day")),
    *(("paper", 700.0, 2.0, "day"), ("paper", 900.0, 3.0, "day")),
    *(("cvn", 300.0, 0.0, "day"), ("cvn", 400.0, 3.0, "day")),
    *(("cvn", 2000.0, 1.0, "day"), ("cvn", 1400.0, 4.0, "day")),
    *(("paper", 1200.0, 4.0, "day"), ("paper", 1000.0, 1.0, "dusk")),
    *(("cvn", 700.0, 5.0, "day"), ("cvn", 1000.0, 0.0, "dusk")),
    *(("cvn", 1500.0, 2.0, "dusk"), ("cvn", 2000.0, 3.0, "day")),
)


def looks_config(number: int) -> tuple[LandingConfig, int]:
    """The configuration and the seed of a flight."""
    ship, visibility_m, sea_state, time_of_day = FLIGHTS[number]
    start_m = min(FARTHEST_M, SEEN_VISIBILITIES * visibility_m)
    camera = LandingCamera(rate_hz=RATE_HZ)
    config = LandingConfig(ship, "A4", visibility_m, time_of_day, sea_state, start_m=start_m, camera=camera)
    return config, FIRST_SEED + number


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--most", type=int, default=len(FLIGHTS))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    models = None
    for number in range(min(given.most, len(FLIGHTS))):
        path = given.out / f"{number:02d}.json"
        if path.exists():
            continue
        config, seed = looks_config(number)
        with RenderedSight(config, seed, models) as sight:
            looks = []
            for moment in track(approach_moments(sight.surroundings), path.name):
                found = sight.see(moment)
                detection = None if sight.result is None else sight.result.detection
                looks.append(look_record(sight.surroundings, moment, found, detection))
            write_looks(path, sight.surroundings, looks)
            models = sight.flight


if __name__ == "__main__":
    main()
