"""Whether two campaigns agree, cell by cell: how passes end, where they touch down, from where the picture is `ok`."""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from scipy.stats import fisher_exact, ks_2samp

from deckline.config_file import config_from_table
from deckline.files import parse_plain, read_regular
from deckline_lab.campaigns.plan import CampaignPlan, settings_from_json
from deckline_lab.campaigns.runner import PLAN_FILE
from deckline_lab.campaigns.summary import FlownLanding, name_cell, read_landings
from deckline_lab.evaluation.tables import Table, number
from deckline_sim.landing.config import LandingConfig
from deckline_sim.landing.touchdown import Outcome

LEAST = 8  # landings on either side that a test of where they touch down needs
SIGNIFICANCE = 0.05  # of all tests of a table together
MEASURES: Mapping[str, Callable[[FlownLanding], float | None]] = {
    "along": lambda landing: landing.along_m,
    "across": lambda landing: landing.across_m,
    "first ok": lambda landing: landing.first_ok_m,
}
NOTE = """\
Against: probability of so large a difference if both campaigns were alike; Fisher's exact test of how often a wire is
taken, Kolmogorov and Smirnov's of touchdowns and of the first `ok` answer. Landings of the same seed have the same ship
motion and gusts, which makes differences seem less significant than they are."""


def read_campaign(folder: Path) -> tuple[CampaignPlan, list[FlownLanding]]:
    """Plan and landings of a campaign that was flown.

    Raises:
        OSError: a file cannot be read.
        ValueError: the folder holds no campaign, or one that is damaged.
    """
    path = folder / PLAN_FILE
    try:
        table = parse_plain(json.loads, read_regular(path).decode())
        plan = plan_from_json(table)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"{path}: not the plan of a campaign ({error})") from None
    landings = read_landings(plan, folder)
    if not landings:
        raise ValueError(f"{folder} holds no landings yet")
    return plan, landings


def plan_from_json(table: Mapping[str, Any]) -> CampaignPlan:
    """The plan of `CampaignPlan.as_json`, without its importance: that changes weights, which no test here takes."""
    known = settings_from_json(table)
    values = {name: known[name] for name in ("seed", "landings", "paired", "shard")}
    values["factors"] = {name: tuple(items) for name, items in known["factors"].items()}
    values["ranges"] = {name: (low, high) for name, (low, high) in known["ranges"].items()}
    return CampaignPlan(landing=config_from_table(LandingConfig, known["landing"]), **values)


def shared_cells(plan: CampaignPlan, other: CampaignPlan) -> list[tuple[int, int]]:
    """Numbers of the cells that two plans have both.

    Raises:
        ValueError: there is none.
    """
    known = {name_cell(cell): k for k, cell in enumerate(other.cells)}
    pairs = [(k, known[name_cell(cell)]) for k, cell in enumerate(plan.cells) if name_cell(cell) in known]
    if not pairs:
        raise ValueError(f"the campaigns share no cell; the other has {'; '.join(known)}")
    return pairs


def agreement_table(
    plan: CampaignPlan, landings: Sequence[FlownLanding], other: CampaignPlan, others: Sequence[FlownLanding]
) -> Table:
    """Cells in which both campaigns have landings, one row each.

    Args:
        plan, landings: a campaign.
        other, others: the campaign that it is held against.

    Raises:
        ValueError: the campaigns share no cell.
    """
    both = [
        (name_cell(plan.cells[mine]), _of_cell(landings, mine), _of_cell(others, theirs))
        for mine, theirs in shared_cells(plan, other)
    ]
    flown = [(name, first, second) for name, first, second in both if first and second]
    tests = [
        [_wire_test(first, second), *(_same_law(measure, first, second) for measure in MEASURES.values())]
        for _, first, second in flown
    ]
    counted = sum(p is not None for row in tests for p in row)
    rows = []
    for (name, *groups), row in zip(flown, tests, strict=True):
        sizes = (str(len(group)) for group in groups)
        wires = (f"{100 * sum(map(_took_wire, group)) / len(group):.0f}" for group in groups)
        differs = any(p is not None and p < SIGNIFICANCE / counted for p in row)
        rows.append((name, *sizes, *wires, *(number(p, ".3f") for p in row), "no" if differs else "yes"))
    counts = "landings", "of the other", "wire, %", "of the other"
    columns = ("cell", *counts, *(f"{name}, p" for name in ("wire", *MEASURES)), "agree")
    title = f"{plan.landing.sight} against {other.landing.sight}: {counted} tests, {SIGNIFICANCE:g} for all together"
    return Table(title, columns, rows)


def _of_cell(landings: Sequence[FlownLanding], cell: int) -> list[FlownLanding]:
    return [landing for landing in landings if landing.cell == cell]


def _took_wire(landing: FlownLanding) -> bool:
    return landing.outcome == Outcome.WIRE


def _wire_test(first: Sequence[FlownLanding], second: Sequence[FlownLanding]) -> float:
    hits = [sum(_took_wire(landing) for landing in group) for group in (first, second)]
    return float(fisher_exact([[hits[0], len(first) - hits[0]], [hits[1], len(second) - hits[1]]])[1])


def _same_law(
    measure: Callable[[FlownLanding], float | None], first: Sequence[FlownLanding], second: Sequence[FlownLanding]
) -> float | None:
    """p of the two-sample Kolmogorov-Smirnov test; None: too few landings have the value."""
    values = [[value for value in map(measure, group) if value is not None] for group in (first, second)]
    return float(ks_2samp(*values).pvalue) if min(map(len, values)) >= LEAST else None
