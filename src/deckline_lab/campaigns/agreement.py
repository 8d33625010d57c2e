"""Whether two campaigns agree, cell by cell: how passes end, where they touch down, from where the picture is `ok`."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import cache
from itertools import chain, product
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.stats import fisher_exact, ks_2samp

from deckline.config_file import config_from_table, settings_from_json
from deckline.files import parse_plain, read_regular
from deckline_lab.campaigns.importance import Importance
from deckline_lab.campaigns.plan import CampaignPlan, Settings, flat_settings
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
    "first ok": lambda landing: landing.first_ok_m or 0.0,  # never: as if at the ramp
}
NOTE = """\
Against: probability of so large a difference if both campaigns were alike; Fisher's exact test of how often a wire is
taken, Kolmogorov and Smirnov's of touchdowns and of the first `ok` answer, which counts as at the ramp where none
came. Landings of the same seed have the same ship motion and gusts, which makes differences seem less significant than
they are. Least differences: a true difference of this size is found in about half of all pairs of such campaigns, a
smaller one less often; of means in m, of the touchdowns' spread as a factor, for normal distributions. A dash: none is
found, not even a spread 20 times as large, or fewer than 8 landings have the value."""
DIFFERING = "The campaigns also differ in other settings, which may explain a difference: "
LEAST_COLUMNS = ("cell", "wire, percentage points", *(f"{name}, m" for name in MEASURES), "touchdown spread, times")
MOST, HALVINGS, TRIALS = 20.0, 12, 200  # largest change that is tried, steps to the least one, samples for each
SIGHT = "sight"


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
    """The plan of `CampaignPlan.as_json`."""
    known = settings_from_json(table)
    values = {name: known[name] for name in ("seed", "landings", "paired", "shard")}
    values["factors"] = {name: tuple(items) for name, items in known["factors"].items()}
    values["ranges"] = {name: (low, high) for name, (low, high) in known["ranges"].items()}
    if "importance" in known:
        values["importance"] = config_from_table(Importance, known["importance"])
    return CampaignPlan(landing=config_from_table(LandingConfig, known["landing"]), **values)


def shared_cells(plan: CampaignPlan, other: CampaignPlan) -> list[tuple[int, int]]:
    """Numbers of the cells that two plans have both: every factor of either plan has the same value.

    The sight may differ, unless both plans have it as a factor.

    Raises:
        ValueError: there is none, or a plan has importance.
    """
    for one in (plan, other):
        if one.importance is not None:
            raise ValueError(f"campaigns are compared without weights, got importance of {one.importance.name!r}")
    names = _factor_names(plan, other)
    mine, theirs = ([_settings(one, cell) for cell in one.cells] for one in (plan, other))
    pairs = [
        (k, j)
        for (k, cell), (j, known) in product(enumerate(mine), enumerate(theirs))
        if all(cell[name] == known[name] for name in names)
    ]
    if not pairs:
        raise ValueError(f"the campaigns share no cell; the other has {'; '.join(map(name_cell, other.cells))}")
    return pairs


def differing_settings(plan: CampaignPlan, other: CampaignPlan) -> list[str]:
    """Settings that are no factor and differ, such as `start_m 800, of the other 600`; the sight is left out."""
    mine, theirs = (_settings(one, one.cells[0]) for one in (plan, other))
    names = mine.keys() - {SIGHT, *_factor_names(plan, other)}
    return [f"{name} {mine[name]}, of the other {theirs[name]}" for name in sorted(names) if mine[name] != theirs[name]]


def _factor_names(plan: CampaignPlan, other: CampaignPlan) -> list[str]:
    """Factors of either plan; the sight only where it is one of both."""
    names = dict.fromkeys((*plan.factors, *other.factors))
    return [name for name in names if name != SIGHT or (SIGHT in plan.factors and SIGHT in other.factors)]


def _settings(plan: CampaignPlan, cell: Settings) -> dict[str, Any]:
    """Dotted names and values of all settings of a cell; of those that are drawn, their range in words."""
    lowest = plan.config({**cell, **{name: low for name, (low, _) in plan.ranges.items()}})
    drawn = {name: f"drawn from {low:g} to {high:g}" for name, (low, high) in plan.ranges.items()}
    return {**dict(flat_settings(asdict(lowest))), **drawn}


def agreement_tables(
    plan: CampaignPlan, landings: Sequence[FlownLanding], other: CampaignPlan, others: Sequence[FlownLanding]
) -> list[Table]:
    """Cells in which both campaigns have landings: the tests' results, and the least differences that they can find.

    Args:
        plan, landings: a campaign.
        other, others: the campaign that it is held against.

    Raises:
        ValueError: the campaigns share no cell, or a plan has importance.
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
    level = SIGNIFICANCE / max(counted, 1)
    rows, least = [], []
    for (name, first, second), row in zip(flown, tests, strict=True):
        groups = first, second
        sizes = (str(len(group)) for group in groups)
        wires = (f"{100 * sum(map(_took_wire, group)) / len(group):.0f}" for group in groups)
        differs = any(p is not None and p < level for p in row)
        rows.append((name, *sizes, *wires, *(number(p, ".3f") for p in row), "found" if differs else "none found"))
        least.append((name, *(number(value, ".2g") for value in _least_differences(first, second, level))))
    counts = "landings", "of the other", "wire, %", "of the other"
    columns = ("cell", *counts, *(f"{name}, p" for name in ("wire", *MEASURES)), "difference")
    title = f"{plan.landing.sight} against {other.landing.sight}: {counted} tests, {SIGNIFICANCE:g} for all together"
    return [Table(title, columns, rows), Table("least differences found", LEAST_COLUMNS, least)]


def _least_differences(
    first: Sequence[FlownLanding], second: Sequence[FlownLanding], level: float
) -> Iterator[float | None]:
    """Columns of `LEAST_COLUMNS`; None: the test finds no difference, however large."""
    share = least_share_difference(len(first), sum(map(_took_wire, second)), len(second), level)
    yield None if share is None else 100 * share
    for measure in MEASURES.values():
        groups = _values(measure, first, second)
        shift = least_change(*map(len, groups), level, "shift")
        yield None if shift is None else shift * float(np.std(groups[1], ddof=1)) or None
    yield least_change(*map(len, _values(MEASURES["along"], first, second)), level, "spread")


def least_share_difference(trials: int, hits: int, of: int, level: float) -> float | None:
    """Least difference from a share `hits` / `of` that is significant in so many trials; None: there is none."""
    for count in sorted(range(trials + 1), key=lambda count: abs(count / trials - hits / of)):
        if fisher_exact([[count, trials - count], [hits, of - hits]])[1] < level:
            return abs(count / trials - hits / of)
    return None


@cache
def least_change(first: int, second: int, level: float, change: Literal["shift", "spread"]) -> float | None:
    """Least change of a normal distribution that the Kolmogorov-Smirnov test finds in half of `TRIALS` trials.

    Args:
        first, second: sizes of the samples of either distribution.
        level: of significance.
        change: of the mean, in 1-sigma, or of the 1-sigma, as a factor.

    Returns:
        The change; None: too few values, or none up to `MOST` is found.
    """
    if min(first, second) < LEAST:
        return None
    rng = np.random.default_rng(0)
    one, other = rng.standard_normal((TRIALS, first)), rng.standard_normal((TRIALS, second))
    steps = np.concatenate([np.full(first, 1 / first), np.full(second, -1 / second)])
    limit = _least_distance(first, second, level)

    def is_found(size: float) -> bool:
        changed = one + size if change == "shift" else one * size
        order = np.argsort(np.concatenate([changed, other], axis=1), axis=1)
        return bool(np.median(np.abs(np.cumsum(steps[order], axis=1)).max(axis=1)) >= limit)

    return _bisect(is_found, 0.0 if change == "shift" else 1.0, MOST)


def _least_distance(first: int, second: int, level: float) -> float:
    """Least Kolmogorov-Smirnov distance of two samples of these sizes that is significant."""

    def test(shift: float) -> Any:
        return ks_2samp((np.arange(first) + 0.5) / first + shift, (np.arange(second) + 0.5) / second)

    shift = _bisect(lambda shift: bool(test(shift).pvalue < level), 0.0, 1.0)
    return np.inf if shift is None else float(test(shift).statistic) - 1e-9  # less what sums are rounded by


def _bisect(is_found: Callable[[float], bool], low: float, high: float) -> float | None:
    """Least number that is found; None: not even the highest one is."""
    if not is_found(high):
        return None
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (low, middle) if is_found(middle) else (middle, high)
    return high


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
    values = _values(measure, first, second)
    return float(ks_2samp(*values).pvalue) if min(map(len, values)) >= LEAST else None


def _values(
    measure: Callable[[FlownLanding], float | None], *groups: Sequence[FlownLanding]
) -> tuple[list[float], ...]:
    """The values of those landings of each group that have one; none where all are the same: nobody saw the ramp."""
    found = tuple([value for value in map(measure, group) if value is not None] for group in groups)
    return found if len(set(chain(*found))) > 1 else tuple([] for _ in groups)
