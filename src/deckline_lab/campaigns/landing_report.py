"""The page of one landing: one HTML file beside its film."""

from collections.abc import Iterator
from dataclasses import asdict

from deckline.types import Status
from deckline_lab.campaigns.landing_figures import draw_profile, draw_statuses, draw_touchdown
from deckline_lab.campaigns.report import render_page, setting_rows
from deckline_lab.campaigns.summary import NOT_MEASURED, measures_misleading
from deckline_sim.landing.film import FilmedLanding
from deckline_sim.landing.summary import name_outcome


def landing_html(filmed: FilmedLanding, film: str) -> str:
    """The report as one HTML text, pictures inside.

    Args:
        filmed: the landing.
        film: name of its film, which lies beside the page.

    Raises:
        ImportError: the viz extra is not installed.
    """
    config, seed = filmed.scene.config, filmed.scene.seed
    return render_page(
        "landing.html",
        heading=f"Landing {seed}",
        subtitle=f"visibility {config.visibility_m:g} m, sea state {config.sea_state:g}, sight {config.sight}",
        cards=list(_cards(filmed)),
        film=film,
        figures=list(_figures(filmed)),
        settings_title="Settings",
        settings=list(setting_rows(asdict(config))),
    )


def _cards(filmed: FilmedLanding) -> Iterator[tuple[str, str, str]]:
    landing, answers, config = filmed.landing, filmed.answers, filmed.scene.config
    outcome, _, why = name_outcome(landing).partition(", ")
    yield "Outcome", outcome.capitalize(), why
    contact = landing.touchdown
    if contact is not None:
        yield "Along the deck", f"{contact.beyond_aim_m:+.1f} m", "beyond the touchdown point"
        yield "Across the deck", f"{contact.right_m:+.1f} m", "right of the centre line"
        yield "Sink", f"{contact.sink_m_s:.1f} m/s", "towards the deck"
    first = "never" if landing.first_ok_m is None else f"{landing.first_ok_m:.0f} m"
    ok = sum(answer.status is Status.OK for answer in answers)
    misleading = str(landing.misleading) if measures_misleading(config.sight, config.guidance) else NOT_MEASURED
    yield "First ok, to the ramp", first, f"{ok} of {len(answers)} answers ok, misleading: {misleading}"


def _figures(filmed: FilmedLanding) -> Iterator[tuple[str, str, str]]:
    """Title, picture and caption."""
    yield (
        "Touchdown on the deck",
        draw_touchdown(filmed),
        "The aircraft comes from the left. Cross: touchdown point; grey bars: wires.",
    )
    yield (
        "Approach",
        draw_profile(filmed),
        "Of the hook, relative to the moving deck. A pass outside the dashed lines is broken off.",
    )
    yield "Statuses", draw_statuses(filmed.answers), "Of every answer to a picture."
