"""`deckline land`."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import tyro

from deckline import __version__
from deckline.atomic import write_atomic
from deckline.config_file import settings_to_json
from deckline.files import is_there, print_line, printable
from deckline_lab.campaigns.filmed import fly_filmed, make_film
from deckline_lab.campaigns.landing_report import landing_html
from deckline_sim.landing.config import LandingConfig
from deckline_sim.landing.summary import summarise_landing

FILM_FILE, REPORT_FILE, RECORD_FILE = "landing.mp4", "report.html", "landing.json"
# A ramp ought to be in sight from 480 m: the flight begins some seconds before, so that it takes two minutes at most.
IN_HAZE = LandingConfig(visibility_m=600.0, start_m=800.0, sight="rendered")


def land(
    landing: Annotated[LandingConfig, tyro.conf.arg(name="")] = IN_HAZE, seed: int = 1, out: Path = Path("landing-out")
) -> int:
    """Fly one landing through haze with rendered pictures, and write its film and its report.

    Args:
        landing: what it is flown in.
        seed: of everything random; the same seed and settings give the same landing.
        out: folder of landing.mp4, report.html and landing.json.
    """
    with folder_of_results(out):
        filmed = fly_filmed(landing, seed)
        film = make_film(filmed)
    settings = settings_to_json(asdict(landing))
    record = {"seed": seed, "made_with": __version__, **filmed.landing.record(), "settings": settings}
    write_atomic(out / RECORD_FILE, (json.dumps(record, indent=1, allow_nan=False) + "\n").encode())
    write_atomic(out / FILM_FILE, film)
    print(summarise_landing(landing, seed, filmed.landing))
    for name in (RECORD_FILE, FILM_FILE):
        print(printable(out / name))
    try:
        page = landing_html(filmed, FILM_FILE)
    except ImportError as error:
        print_line(f"no {REPORT_FILE}: {error}")
        return 0
    write_atomic(out / REPORT_FILE, page.encode())
    print(printable(out / REPORT_FILE))
    return 0


@contextmanager
def folder_of_results(out: Path) -> Iterator[None]:
    """The folder is there at once, so that a bad one is refused at once; a new one is removed after an error."""
    is_new = not is_there(out)
    out.mkdir(parents=True, exist_ok=True)
    try:
        yield
    except BaseException:
        if is_new:
            out.rmdir()
        raise


COMMANDS = {"land": land}
EXAMPLES = {
    "deckline land": (
        "deckline land --seed 1",
        "deckline land --seed 1 --visibility-m 200 --out fog",
        "deckline land --seed 4 --sight points --sea-state 5",
    ),
}
