"""What a campaign flies: a base landing, factors that make a grid of cells, settings drawn for every landing."""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, fields
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from deckline.checks import check_numbers
from deckline.config_file import config_from_table, read_toml, settings_to_json, suggest_key
from deckline_lab.campaigns.importance import Importance
from deckline_sim.landing.config import LandingConfig

Settings = Mapping[str, Any]  # dotted names of landing settings and their values
SEED_BITS = 53  # of a landing's seed: every reader of JSON holds such a number exactly
DRAWS = 1  # random stream of a landing's drawn settings; its seed is of the stream without this number
KINDS = {  # of a plan's keys that are no tables
    "seed": (int, "a whole number"),
    "landings": (int, "a whole number"),
    "paired": (bool, "true or false"),
    "shard": (int, "a whole number"),
}


@dataclass(frozen=True, eq=False)
class CampaignPlan:
    """A campaign. A value out of its range is a ValueError that names it."""

    landing: LandingConfig = field(default_factory=LandingConfig)
    """What all landings share."""
    seed: int = 0
    """Of the campaign."""
    landings: int = 100
    """In every cell."""
    paired: bool = False
    """Landing n has the same seed and the same drawn settings in every cell: cells can be compared landing by landing,
    and their landings not be pooled. Otherwise all landings are independent."""
    shard: int = 50
    """Landings of one file, all of one cell; a stopped campaign loses the shards that it had begun."""
    factors: Mapping[str, tuple[Any, ...]] = field(default_factory=dict)
    """Setting -> its values: every combination is a cell."""
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Setting -> lowest and highest value, drawn evenly for every landing."""
    importance: Importance | None = None
    """A setting that is drawn with weights."""

    def __post_init__(self) -> None:
        check_numbers(self, "", "seed", least=0)
        check_numbers(self, "", "landings", "shard", least=1)
        for name, values in self.factors.items():
            if not values or len({repr(value) for value in values}) < len(values):
                raise ValueError(f"factors.{name} must be a list of different values, got {list(values)}")
        for name, ends in self.ranges.items():
            if not all(math.isfinite(end) for end in ends) or not ends[0] <= ends[1]:
                raise ValueError(f"ranges.{name} must be finite numbers [low, high], got {list(ends)}")
        names = [*self.factors, *self.ranges, *([self.importance.name] if self.importance else [])]
        if twice := [name for name in names if names.count(name) > 1]:
            raise ValueError(f"{twice[0]} must be a factor, a range or importance's, got it twice")
        tuple(self.extremes())  # refuses a setting that is unknown or out of its range

    @cached_property
    def cells(self) -> tuple[Settings, ...]:
        """The factors' values in every cell; one cell without a factor."""
        return tuple(dict(zip(self.factors, values, strict=True)) for values in product(*self.factors.values()))

    @property
    def shards(self) -> int:
        """Number of shards."""
        return len(self.cells) * math.ceil(self.landings / self.shard)

    def shard_landings(self, shard: int) -> tuple[int, range]:
        """Cell of a shard and the numbers of its landings. Shards take the cells in turn."""
        part, cell = divmod(shard, len(self.cells))
        return cell, range(part * self.shard, min((part + 1) * self.shard, self.landings))

    def config(self, settings: Settings) -> LandingConfig:
        """The base landing with some settings replaced.

        Raises:
            ValueError: an unknown setting, or a value that is none of it.
        """
        return config_from_table(LandingConfig, _nested(settings), self.landing, "plan")

    def extremes(self) -> Iterator[LandingConfig]:
        """The landings of every cell at both ends of all that is drawn."""
        drawn: dict[str, tuple[float, float]] = dict(self.ranges)
        if self.importance is not None:
            drawn[self.importance.name] = self.importance.low, self.importance.high
        for cell in self.cells:
            yield self.config({**cell, **{name: low for name, (low, _) in drawn.items()}})
            if drawn:
                yield self.config({**cell, **{name: high for name, (_, high) in drawn.items()}})

    def landing_seed(self, cell: int, number: int) -> int:
        """Seed of a cell's landing."""
        state = np.random.SeedSequence(self._entropy(cell, number)).generate_state(1, np.uint64)
        return int(state[0]) >> (64 - SEED_BITS)

    def draw(self, cell: int, number: int) -> tuple[dict[str, float], float]:
        """Drawn settings of a cell's landing, and its weight: 1 without importance."""
        rng = np.random.default_rng(np.random.SeedSequence(self._entropy(cell, number), spawn_key=(DRAWS,)))
        settings = {name: float(rng.uniform(*self.ranges[name])) for name in sorted(self.ranges)}
        if self.importance is None:
            return settings, 1.0
        value = self.importance.draw(rng)
        return {**settings, self.importance.name: value}, self.importance.weight(value)

    def _entropy(self, cell: int, number: int) -> list[int]:
        return [self.seed, number] if self.paired else [self.seed, number, cell]

    def as_json(self) -> dict[str, Any]:
        """The plan as JSON values: infinite numbers as text."""
        return settings_to_json(
            {
                **{item.name: getattr(self, item.name) for item in fields(self)},
                "landing": asdict(self.landing),
                "importance": None if self.importance is None else asdict(self.importance),
            }
        )


def read_plan(path: Path) -> CampaignPlan:
    """A plan from a TOML file: keys seed, landings, paired, shard; tables landing, factors, ranges, importance.

    Raises:
        OSError: the file cannot be read.
        ValueError: the file is no TOML, a key or setting is unknown (names the nearest), or a value is impossible.
    """
    table = read_toml(path)
    known = [item.name for item in fields(CampaignPlan)]
    for key, value in table.items():
        if key not in known:
            raise ValueError(f"{path}: unknown key {key}{suggest_key(key, known)}")
        if isinstance(value, dict) is (key in KINDS):
            raise ValueError(f"{path}: {key} must be {KINDS.get(key, (dict, 'a table'))[1]}")
    values: dict[str, Any] = dict(table)
    try:
        values["landing"] = config_from_table(LandingConfig, table.get("landing", {}), source="landing")
        values["factors"] = {name: _factor(name, value) for name, value in flat_settings(table.get("factors", {}))}
        values["ranges"] = {name: _range(name, value) for name, value in flat_settings(table.get("ranges", {}))}
        if "importance" in table:
            values["importance"] = config_from_table(Importance, table["importance"], source="importance")
        for key, (kind, name) in KINDS.items():
            if key in values and type(values[key]) is not kind:
                raise ValueError(f"{key} must be {name}, got {values[key]!r}")
        return CampaignPlan(**values)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def check_plan(plan: CampaignPlan, check: Callable[[LandingConfig], None]) -> None:
    """Call `check` with the landings of every cell, which raises a ValueError for one that cannot be flown."""
    for config in plan.extremes():
        check(config)


def flat_settings(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted names and values of nested tables."""
    for key, value in table.items():
        if isinstance(value, dict):
            yield from flat_settings(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value


def _nested(settings: Settings) -> dict[str, Any]:
    """Nested tables of dotted names and values."""
    tables: dict[str, Any] = {}
    for name, value in settings.items():
        *parents, last = name.split(".")
        table = tables
        for parent in parents:
            table = table.setdefault(parent, {})
        table[last] = value
    return tables


def _factor(name: str, value: Any) -> tuple[Any, ...]:
    if not isinstance(value, list):
        raise ValueError(f"factors.{name} must be a list of values, got {value!r}")
    return tuple(value)


def _range(name: str, value: Any) -> tuple[float, float]:
    is_pair = isinstance(value, list) and len(value) == 2
    if not is_pair or any(type(end) not in (int, float) for end in value):
        raise ValueError(f"ranges.{name} must be two numbers [low, high], got {value!r}")
    return float(value[0]), float(value[1])
