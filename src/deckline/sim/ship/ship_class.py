"""Ship classes: plain TOML files in `classes`, read into frozen data. A wrong file is refused in one line."""

import tomllib
from dataclasses import MISSING, dataclass, fields, is_dataclass
from pathlib import Path
from types import UnionType
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

from deckline.sim.ship.mesh import Rgb
from deckline.sim.ship.plan import DeckSurface, Plan, Point

SHIP_CLASSES = ("paper", "cvn", "axial", "small", "runway")
SHIPS = Path(__file__).parent / "classes"
T = TypeVar("T")


@dataclass(frozen=True)
class Strip:
    """Runway lines about a centre line that turns to port of the ship's axis."""

    start_m: Point  # where the centre line begins
    port_angle_deg: float
    spacing_m: tuple[float, float]  # of the line middles: at the beginning, and at the end of the longer line
    lengths_m: tuple[float, float]  # left, right


@dataclass(frozen=True)
class LineEnds:
    """Runway lines by their ends in the ship frame, ramp end first."""

    left_m: tuple[Point, Point]
    right_m: tuple[Point, Point]


@dataclass(frozen=True)
class WorldLines:
    """Runway lines as w1 x + y + w0 = 0 in the world, from one x towards -x."""

    left: tuple[float, float]  # w1, w0
    right: tuple[float, float]
    start_x_m: float
    length_m: float


@dataclass(frozen=True)
class Place:
    """Where the ship lies in the world (NED)."""

    stern_m: Point = (0.0, 0.0)  # north, east of the deck's stern end on the ship's axis
    heading_deg: float = 0.0
    sea_z_m: float = 0.0  # of the water, or of the ground under a runway on land


@dataclass(frozen=True)
class Hull:
    """What carries the deck."""

    beam_m: float  # at the waterline
    bow: Literal["blunt", "raked", "ski-jump"]
    rgb: Rgb
    stern_x_m: float = 3.0  # of the transom: the deck overhangs it by this much
    ramp_height_m: float = 0.0  # of the ski jump above the deck
    ramp_length_m: float = 0.0
    number: str = ""  # on the bow's sides


@dataclass(frozen=True)
class Island:
    """One superstructure: a footprint and how high its levels and its mast reach above the deck."""

    middle_m: Point
    length_m: float
    width_m: float
    height_m: float
    mast_m: float = 0.0


@dataclass(frozen=True)
class ShipClass:
    """One ship that can be asked for by name. Exactly one of `strip`, `lines` and `world_lines` is given."""

    name: str
    about: str
    length_m: float  # of the deck
    deck_height_m: float  # above the water or the ground
    port_m: tuple[Point, ...]  # corners of the port deck edge, stern to bow
    starboard_m: tuple[Point, ...]
    plan: Plan
    surface: DeckSurface
    strip: Strip | None = None
    lines: LineEnds | None = None
    world_lines: WorldLines | None = None
    place: Place = Place()
    on_land: bool = False
    hull: Hull | None = None
    islands: tuple[Island, ...] = ()

    def __post_init__(self) -> None:
        given = [kind for kind in ("strip", "lines", "world_lines") if getattr(self, kind) is not None]
        if len(given) != 1:
            raise ValueError(f"a ship needs one of strip, lines and world_lines, got {given or 'none'}")
        if (self.hull is None) != self.on_land:
            raise ValueError(f"a hull belongs to a ship and none to a runway on land, got on_land {self.on_land}")
        for edge in (self.port_m, self.starboard_m):
            x = [point[0] for point in edge]
            if len(x) < 2 or sorted(set(x)) != x or x[0] != 0.0 or x[-1] != self.length_m:
                raise ValueError(f"a deck edge must run from x = 0 to {self.length_m} with growing x, got x = {x}")


def load_class(name: str) -> ShipClass:
    """A class that comes with the simulator.

    Raises:
        ValueError: an unknown name.
    """
    if name not in SHIP_CLASSES:
        raise ValueError(f"ship class must be one of {SHIP_CLASSES}, got {name!r}")
    return read_class(SHIPS / f"{name}.toml")


def read_class(path: Path) -> ShipClass:
    """A ship's file; its name is the class's.

    Raises:
        ValueError: not TOML, an unknown or missing key, a value of another kind, or numbers that are no ship.
    """
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
        return build(ShipClass, table | {"name": path.stem}, "")
    except ValueError as error:  # tomllib's too
        raise ValueError(f"{path.name}: {error}") from None


def build(kind: type[T], table: Any, where: str) -> T:
    """A dataclass from a table; `where` is the path of keys so far, for the message."""
    if not isinstance(table, dict):
        raise ValueError(f"{where} must be a table, got {table!r}")
    hints = get_type_hints(kind)
    known = {item.name: item for item in fields(kind)}  # type: ignore[arg-type]
    prefix = f"{where}." if where else ""
    for key in table:
        if key not in known:
            raise ValueError(f"unknown key {prefix}{key}, expected one of {', '.join(known)}")
    for key, item in known.items():
        if key not in table and item.default is MISSING:
            raise ValueError(f"missing key {prefix}{key}")
    return kind(**{key: convert(hints[key], value, f"{prefix}{key}") for key, value in table.items()})


def convert(kind: Any, value: Any, where: str) -> Any:
    """A TOML value as the type a field wants."""
    if get_origin(kind) is UnionType:  # X | None: TOML has no null, so a value that is there is an X
        return convert(next(k for k in get_args(kind) if k is not type(None)), value, where)
    if get_origin(kind) is tuple:
        return _tuple(get_args(kind), value, where)
    if get_origin(kind) is Literal:
        if value not in get_args(kind):
            raise ValueError(f"{where} must be one of {get_args(kind)}, got {value!r}")
        return value
    if is_dataclass(kind) and isinstance(kind, type):
        return build(kind, value, where)
    if kind is float and isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    if not isinstance(value, kind):
        raise ValueError(f"{where} must be a {kind.__name__}, got {value!r}")
    return value


def _tuple(kinds: tuple[Any, ...], value: Any, where: str) -> tuple[Any, ...]:
    """A TOML array as a tuple of fixed length, or of any length where the type ends in `...`."""
    if not isinstance(value, list):
        raise ValueError(f"{where} must be an array, got {value!r}")
    if kinds[-1] is Ellipsis:
        kinds = (kinds[0],) * len(value)
    if len(value) != len(kinds):
        raise ValueError(f"{where} must have {len(kinds)} entries, got {len(value)}")
    return tuple(convert(kind, item, f"{where}[{k}]") for k, (kind, item) in enumerate(zip(kinds, value, strict=True)))
