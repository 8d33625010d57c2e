"""What a campaign adds up to: shares of outcomes with intervals and touchdowns, cell by cell."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from deckline.config_file import settings_from_json
from deckline.files import parse_plain, read_regular
from deckline_lab.campaigns.plan import CampaignPlan, Settings
from deckline_lab.campaigns.runner import shard_files
from deckline_lab.campaigns.shares import Share, estimate_share
from deckline_lab.evaluation.tables import MISSING, Table, number
from deckline_sim.landing.touchdown import Outcome

SUMMARY_FILE = "summary.json"
GOOD, MISLEADING = "good", "misleading"  # events beside the outcomes
EVENTS = (GOOD, *Outcome, MISLEADING)
BOUNDED = {"ramp strike": Outcome.RAMP_STRIKE, MISLEADING: MISLEADING}  # rare events by what people call them
COMMON = (GOOD, Outcome.WIRE)  # events that most landings have
NOT_MEASURED = "not measured"
NOTES = """\
Good: a wire, or a wave-off that had to be. Square brackets: 95 % intervals (Clopper and Pearson). At most: one-sided
95 % bound; of no event in n landings it is 3 / n. Touchdown: of all landings that touched the deck; along: beyond the
touchdown point, across: right of the centre line; 1-sigma in brackets. First ok: median distance to the ramp at the
first `ok` answer of the picture, of the landings that had one; with ok: how many of the cell's landings had one.
Modelled guidance draws errors as shares of their levels, and exact guidance has none: neither can measure how often an
`ok` misleads."""
WEIGHTED_NOTE = """\
Shares are weighted: estimates of the weighted mean with gamma intervals (Fay and Feuer). Effective: landings of equal
weight that would give the mean the same variance."""


@dataclass(frozen=True)
class FlownLanding:
    """A line of a shard."""

    cell: int
    seed: int
    settings: dict[str, Any]
    weight: float
    """1 without importance."""
    outcome: str
    along_m: float | None
    """Touchdown beyond the touchdown point, m; None: no touchdown."""
    across_m: float | None
    """Touchdown right of the centre line, m."""
    sink_m_s: float | None
    """Over the deck at touchdown, m/s."""
    called_for: bool
    """Of a wave-off: it had to be."""
    misleading: bool | None
    """Guidance was `ok` beyond its protection level at least once; None: the sight cannot measure it."""
    first_ok_m: float | None
    """Distance to the ramp at the first `ok` answer of the picture, m; None: there was none."""

    def has(self, event: str) -> bool:
        """Whether an event of `EVENTS` happened."""
        if event == GOOD:
            return self.outcome == Outcome.WIRE or (self.outcome == Outcome.WAVE_OFF and self.called_for)
        return bool(self.misleading) if event == MISLEADING else self.outcome == event


@dataclass(frozen=True)
class Touchdown:
    """Where landings touch the deck; None: fewer than two did."""

    landings: int
    """That touched it."""
    along_m: tuple[float, float] | None
    """Mean and 1-sigma, m beyond the touchdown point."""
    across_m: tuple[float, float] | None
    """Mean and 1-sigma, m right of the centre line."""
    sink_m_s: tuple[float, float] | None
    """Mean and 1-sigma, m/s."""


@dataclass(frozen=True)
class CellSummary:
    """Landings of one cell, or of any other group."""

    settings: dict[str, Any]
    """What they share: the factors' values."""
    landings: int
    effective: float
    """Effective sample size; the landings themselves without weights."""
    shares: dict[str, Share]
    """Of every event of `EVENTS`; without `misleading` where one landing's sight cannot measure it."""
    touchdown: Touchdown
    first_ok_m: float | None
    """Median distance of the first `ok` answer of the picture, of the landings that had one, m."""
    ok_landings: int
    """Landings that had an `ok` answer of the picture."""


def read_landings(plan: CampaignPlan, out: Path) -> list[FlownLanding]:
    """All landings flown so far, in order of their shards.

    Raises:
        ValueError: a shard that is damaged or not of this plan; names it.
    """
    return [
        landing
        for shard, path in enumerate(shard_files(plan, out))
        if path.exists()
        for landing in _read_shard(path, plan, shard)
    ]


def summarise(plan: CampaignPlan, landings: Sequence[FlownLanding]) -> list[CellSummary]:
    """Every cell that has landings."""
    groups = [[landing for landing in landings if landing.cell == k] for k in range(len(plan.cells))]
    greatest = None if plan.importance is None else plan.importance.greatest_weight
    return [
        summarise_group(group, dict(cell), greatest) for cell, group in zip(plan.cells, groups, strict=True) if group
    ]


def summarise_group(
    landings: Sequence[FlownLanding], settings: dict[str, Any], greatest_weight: float | None = None
) -> CellSummary:
    """Shares and touchdowns of landings.

    Args:
        landings: at least one.
        settings: what they share.
        greatest_weight: that a landing can have; None: all weigh the same.
    """
    weights = np.array([landing.weight for landing in landings])
    shares = {
        str(event): estimate_share(
            np.array([landing.has(event) for landing in landings]),
            None if greatest_weight is None else weights,
            greatest_weight or 1.0,
            event in COMMON,
        )
        for event in EVENTS
        if event != MISLEADING or all(landing.misleading is not None for landing in landings)
    }
    effective = float(weights.sum() ** 2 / (weights**2).sum()) if weights.any() else 0.0
    seen = [(landing.first_ok_m, landing.weight) for landing in landings if landing.first_ok_m is not None]
    median_m = weighted_median(*zip(*seen, strict=True)) if seen else None
    return CellSummary(
        settings, len(landings), effective, shares, _touchdown(landings), median_m, ok_landings=len(seen)
    )


def summary_tables(cells: Sequence[CellSummary], weighted: bool) -> list[Table]:
    """Shares, and touchdowns, a row a cell; outcomes that no landing has are left out."""
    seen = [outcome for outcome in Outcome if any(cell.shares[outcome].hits for cell in cells)]
    columns = ("cell", "landings", *(("effective",) if weighted else ()), "good, %")
    columns += (*(f"{outcome.replace('_', ' ')}, %" for outcome in seen), *(f"{name} at most, %" for name in BOUNDED))
    shares, places = [], []
    for cell in cells:
        name, down = name_cell(cell.settings), cell.touchdown
        counts = (str(cell.landings), *((f"{cell.effective:.0f}",) if weighted else ()))
        texts = (cell.shares[event].text() for event in (GOOD, *seen))
        shares.append((name, *counts, *texts, *(_bound(cell.shares.get(event)) for event in BOUNDED.values())))
        spreads = (_spread(down.along_m, "+.1f"), _spread(down.across_m, "+.2f"), _spread(down.sink_m_s, ".2f"))
        first_ok = (number(cell.first_ok_m, ".0f"), f"{cell.ok_landings} of {cell.landings}")
        places.append((name, str(down.landings), *spreads, *first_ok))
    of = ("cell", "touchdowns", "along, m", "across, m", "sink, m/s", "first ok, m", "with ok")
    return [Table("outcomes", columns, shares), Table("touchdowns", of, places)]


def measures_misleading(sight: str, guidance: str) -> bool:
    """Whether such a landing can find an `ok` that misleads: modelled guidance cannot, exact guidance never does."""
    return sight in ("points", "rendered") or guidance == "navigation"


def weighted_median(values: Sequence[float], weights: Sequence[float]) -> float | None:
    """Median of values with weights, the plain one where all weigh the same; None: nothing weighs anything."""
    order = np.argsort(values)
    ordered, upto = np.array(values)[order], np.cumsum(np.array(weights)[order])
    half = upto[-1] / 2
    if not half > 0:
        return None
    ends = (np.searchsorted(upto, half, side) for side in ("left", "right"))
    return float(np.mean([ordered[end] for end in ends]))


def name_cell(settings: Settings) -> str:
    """A cell in words, such as `visibility_m 300, sea_state 4`."""
    return ", ".join(f"{name} {value}" for name, value in settings.items()) or "all"


def _read_shard(path: Path, plan: CampaignPlan, shard: int) -> list[FlownLanding]:
    cell, numbers = plan.shard_landings(shard)
    try:
        lines = [parse_plain(json.loads, line) for line in read_regular(path).decode().splitlines()]
        known = [(cell, number, plan.landing_seed(cell, number)) for number in numbers]
        if [(line["cell"], line["number"], line["seed"]) for line in lines] != known:
            raise ValueError("other landings than the plan's")
        flown = {name: plan.cells[cell].get(name, getattr(plan.landing, name)) for name in ("sight", "guidance")}
        return [_parse_line(line, measures_misleading(**flown)) for line in lines]
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{path}: a damaged shard ({error!r}); remove it and give the command again") from None


def _parse_line(line: dict[str, Any], measures: bool) -> FlownLanding:
    record = line["landing"]
    outcome = Outcome(record["outcome"])
    where = (record["beyond_aim_m"], record["right_m"], record["sink_m_s"])
    of = (line["cell"], line["seed"], settings_from_json(line["settings"]), line.get("weight", 1.0))
    seen = (record["called_for"], record["misleading"] > 0 if measures else None, record["first_ok_m"])
    return FlownLanding(*of, outcome, *where, *seen)


def _touchdown(landings: Sequence[FlownLanding]) -> Touchdown:
    down = [landing for landing in landings if landing.along_m is not None and landing.weight > 0]

    def spread(measure: Callable[[FlownLanding], float | None]) -> tuple[float, float] | None:
        pairs = [(measure(landing), landing.weight) for landing in down]
        values, weights = np.array([pair for pair in pairs if pair[0] is not None], dtype=np.float64).reshape(-1, 2).T
        if len(values) < 2:
            return None
        weights = weights / weights.sum()
        mean = float(weights @ values)
        free = 1 - float(weights @ weights)  # (n - 1) / n with equal weights
        return mean, float(np.sqrt(weights @ (values - mean) ** 2 / free))

    along, across = spread(lambda landing: landing.along_m), spread(lambda landing: landing.across_m)
    return Touchdown(len(down), along, across, spread(lambda landing: landing.sink_m_s))


def _bound(share: Share | None) -> str:
    return NOT_MEASURED if share is None else number(100 * share.at_most, ".3g")


def _spread(pair: tuple[float, float] | None, form: str) -> str:
    return MISSING if pair is None else f"{pair[0]:{form}} ({pair[1]:{form.lstrip('+')}})"
