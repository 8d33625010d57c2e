"""The page of a campaign: one HTML file that needs no network and no server."""

from collections.abc import Iterator, Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from deckline import __version__
from deckline.report.html import TEMPLATES as REPORT_TEMPLATES
from deckline_lab.campaigns.figures import Group, draw_dispersion, draw_shares, draw_touchdowns, landings_by_ship
from deckline_lab.campaigns.plan import CampaignPlan
from deckline_lab.campaigns.summary import (
    GOOD,
    MISLEADING,
    NOT_MEASURED,
    FlownLanding,
    name_cell,
    summarise_group,
)
from deckline_lab.evaluation.tables import MISSING, Table
from deckline_lab.statistics import VISIBILITY_M
from deckline_sim.landing.touchdown import Outcome

REPORT_FILE = "report.html"
TEMPLATES = Path(__file__).parent / "templates"
SEA_STATES = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, np.inf)
BANDS = {"visibility_m": VISIBILITY_M, "sea_state": SEA_STATES}  # edges of groups, where a setting is drawn
LISTED = 6  # landings of one outcome
PAIRED = "paired: bounds by cell"  # cells that share seeds are not independent


def campaign_html(
    plan: CampaignPlan,
    landings: Sequence[FlownLanding],
    heading: str,
    tables: Sequence[Table],
    notes: Sequence[str],
    films: Sequence[tuple[FlownLanding, Path]] = (),
) -> str:
    """The report as one HTML text, pictures inside.

    Args:
        plan: the campaign.
        landings: all of them.
        heading: of the page.
        tables: those of `summary_tables`, and what else is to be shown.
        notes: to the tables.
        films: landings with their films, which lie in a folder beside the page.

    Raises:
        ImportError: the viz extra is not installed.
    """
    bad = [landing for landing in landings if not landing.has(GOOD)]
    seeds = [{landing.seed: landing for landing in bad if landing.outcome == outcome} for outcome in Outcome]
    by_outcome = [[*of.values()][:LISTED] for of in seeds]
    return render_page(
        "campaign.html",
        heading=heading,
        subtitle=f"seen by {plan.landing.sight}",
        cards=list(_cards(plan, landings)),
        figures=list(_figures(plan, landings)),
        tables=tables,
        notes=notes,
        failures=[(_words(each.outcome), each.seed, _name_rounded(each.settings)) for of in by_outcome for each in of],
        films=[
            (
                path.relative_to(path.parents[1]),
                f"{_words(each.outcome)}, seed {each.seed}, {_name_rounded(each.settings)}",
            )
            for each, path in films
        ],
        failed=len(bad),
        listed=LISTED,
        settings_title="Plan",
        settings=list(setting_rows(plan.as_json())),
    )


def render_page(template: str, subtitle: str, **values: Any) -> str:
    """A page of one of our templates, in the style of a run's report; the version and the date are added."""
    environment = Environment(
        loader=FileSystemLoader(TEMPLATES), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    style = Markup((REPORT_TEMPLATES / "report.css").read_text(encoding="utf-8"))
    subtitle = f"{subtitle} · deckline {__version__} · {date.today()}"
    return environment.get_template(template).render(style=style, subtitle=subtitle, **values)


def group_landings(plan: CampaignPlan, landings: Sequence[FlownLanding]) -> list[Group]:
    """Landings by visibility and sea state; bands where these are drawn. Groups without landings are left out."""
    greatest = None if plan.importance is None else plan.importance.greatest_weight
    grouped: dict[tuple[Any, Any], list[FlownLanding]] = {}
    for landing in landings:
        key = tuple(_group(plan, landing, name) for name in BANDS)
        grouped.setdefault((key[0], key[1]), []).append(landing)
    return [
        (axis[1], series[1], summarise_group(members, {}, greatest))
        for (axis, series), members in sorted(grouped.items())
    ]


def _group(plan: CampaignPlan, landing: FlownLanding, name: str) -> tuple[float, str]:
    """What groups are sorted by, and the group's name."""
    if plan.importance is not None and plan.importance.name == name:
        return 0.0, "as it occurs"  # its weights are of the whole distribution, not of a band
    value = float(landing.settings.get(name, getattr(plan.landing, name)))  # "inf" is clear air
    if name not in plan.ranges:
        return value, f"{value:g}"
    edges = np.array(BANDS[name])
    number = int(np.searchsorted(edges, value, side="right")) - 1
    low, high = edges[number], edges[min(number + 1, len(edges) - 1)]
    return float(low), f"{low:g} to {high:g}" if np.isfinite(high) else f"from {low:g}"


def _figures(plan: CampaignPlan, landings: Sequence[FlownLanding]) -> Iterator[tuple[str, str, str]]:
    """Title, picture and caption."""
    ships = landings_by_ship(plan, landings)
    for ship, members in ships.items():
        yield (
            "Touchdowns on the deck" + (f" of {ship}" if len(ships) > 1 else ""),
            draw_touchdowns(plan, members),
            "Hook at first contact; the aircraft comes from the left. Cross: touchdown point (where the wind over the "
            "deck varies, the nearest and the farthest); grey bars: wires.",
        )
    if any(landing.along_m is not None for landing in landings):
        yield (
            "Dispersion by cell",
            draw_dispersion(plan, landings),
            "Ellipses that hold 95 % of normally distributed touchdowns; plus: mean. Both axes have their own scale.",
        )
    if plan.paired and set(plan.factors) - set(BANDS):
        return  # a landing flown in several cells of a group is no new one: no interval holds for the group
    yield (
        "Outcomes by visibility and sea state",
        draw_shares(group_landings(plan, landings), "visibility, m", "sea state"),
        "Share of landings with 95 % interval.",
    )


def _cards(plan: CampaignPlan, landings: Sequence[FlownLanding]) -> Iterator[tuple[str, str, str]]:
    greatest = None if plan.importance is None else plan.importance.greatest_weight
    whole = summarise_group(landings, {}, greatest)
    detail = f"of {plan.landings * len(plan.cells):,} planned, {len(plan.cells)} cells"
    yield "Landings", f"{whole.landings:,}", detail
    if greatest is not None:
        yield "Effective landings", f"{whole.effective:,.0f}", "weighted"
    good = whole.shares[GOOD]
    interval = f"95 % interval {100 * good.low:.3g} to {100 * good.high:.3g} %"
    yield "Boarded or rightly waved off", f"{100 * good.value:.3g} %", PAIRED if plan.paired else interval
    for label, event in (("Ramp strikes", Outcome.RAMP_STRIKE), ("Misleading", MISLEADING)):
        if event not in whole.shares:
            yield label, MISSING, f"{NOT_MEASURED} in every cell"
            continue
        share = whole.shares[event]
        bound = PAIRED if plan.paired else f"at most {100 * share.at_most:.3g} %"
        yield label, f"{share.hits:,}", f"{100 * share.value:.3g} %, {bound}"
    down = whole.touchdown
    if down.along_m is not None and down.across_m is not None:
        yield "Touchdown, 1-sigma", f"{down.along_m[1]:.1f} m", f"along; across {down.across_m[1]:.2f} m"


def setting_rows(table: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Name and value of every setting of a table of settings and tables."""
    for name, value in table.items():
        if isinstance(value, dict):
            yield from ((f"{name}.{key}", str(item)) for key, item in value.items())
        elif value is not None:
            yield name, str(value)


def _name_rounded(settings: dict[str, Any]) -> str:
    return name_cell({name: f"{value:.4g}" if isinstance(value, float) else value for name, value in settings.items()})


def _words(outcome: str) -> str:
    return outcome.replace("_", " ")
