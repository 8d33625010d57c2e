"""Landings with their films: one alone, and one of each outcome of a campaign."""

from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from deckline.atomic import write_atomic
from deckline.report.video import join
from deckline_lab.campaigns.landings import sights_of
from deckline_lab.campaigns.plan import CampaignPlan
from deckline_lab.campaigns.summary import FlownLanding
from deckline_sim.landing.config import LandingConfig
from deckline_sim.landing.film import FilmedLanding, write_film
from deckline_sim.landing.landing import fly
from deckline_sim.landing.recorded_sight import RecordedSight
from deckline_sim.landing.rendered_sight import open_simulator, sim_config
from deckline_sim.landing.surroundings import surroundings
from deckline_sim.landing.touchdown import Outcome

FILMS = "films"  # folder in a campaign's


def fly_filmed(config: LandingConfig, seed: int) -> FilmedLanding:
    """Fly a landing and record what its film shows; errors as `fly`."""
    sights = sights_of(config, seed)
    with closing(sights):
        recorded = RecordedSight(sights.picture)
        landing = fly(config, seed, replace(sights, picture=recorded))
    scene = surroundings(config, seed)
    return FilmedLanding(scene, landing, recorded.answers, recorded.last_s, recorded.pictures)


def make_film(filmed: FilmedLanding) -> bytes:
    """The film of a landing, an MP4 file.

    Raises:
        RendererError: no OpenGL through EGL on this machine.
    """
    config = replace(sim_config(filmed.scene), keep_clear=not filmed.pictures)
    with TemporaryDirectory() as folder, closing(open_simulator(config, filmed.scene)) as simulator:
        piece, whole = Path(folder) / "piece.mp4", Path(folder) / "film.mp4"
        write_film(filmed, simulator.flown_frame, piece)
        join([piece], whole)
        return whole.read_bytes()


def film_outcomes(
    plan: CampaignPlan, landings: Sequence[FlownLanding], out: Path
) -> Iterator[tuple[FlownLanding, Path]]:
    """The first landing of every outcome with its film, in the order of `Outcome`; films that are there are kept.

    Raises:
        RendererError: no OpenGL through EGL on this machine.
        OSError: the disk refuses.
    """
    firsts = {landing.outcome: landing for landing in reversed(landings)}
    for outcome in filter(firsts.__contains__, Outcome):
        landing = firsts[outcome]
        path = out / FILMS / f"{outcome}-{landing.cell}-{landing.seed}.mp4"
        if not path.exists():
            path.parent.mkdir(exist_ok=True)
            write_atomic(path, make_film(fly_filmed(plan.config(landing.settings), landing.seed)))
        yield landing, path
