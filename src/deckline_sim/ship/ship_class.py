"""Ship classes: plain TOML files in `classes`, read into frozen data. Random ships draw the same data.

Ship frame: x forward, y to starboard, metres on the deck plane. Colours are display colours, 0..1.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from deckline.config_file import read_config
from deckline_sim.ship.mesh import Rgb

SHIP_CLASSES = ("paper", "cvn", "axial", "small", "runway")
SHIPS = Path(__file__).parent / "classes"
Point = tuple[float, float]
EdgePattern = Literal["ladder", "stripe", "double", "dashed"]


@dataclass(frozen=True)
class EdgeStyle:
    """How an edge of the runway is painted; widths and lengths in metres."""

    kind: EdgePattern
    width_m: float  # outside to outside
    rail_m: float  # one stripe of a ladder or a double line
    bar_m: float
    pitch_m: float
    rgb: Rgb
    opacity: float = 1.0
    smear: float = 0.0  # opacity of paint that bleeds inwards, as coarse textures seen from afar do
    smear_m: float = 0.0  # how far it bleeds

    def __post_init__(self) -> None:
        if not (self.width_m > 0 and self.rail_m > 0 and 0 < self.bar_m < self.pitch_m):
            numbers = (self.width_m, self.rail_m, self.bar_m, self.pitch_m)
            raise ValueError(f"an edge needs width, rail > 0 < bar < pitch, got width, rail, bar, pitch {numbers}")


@dataclass(frozen=True)
class LineStyle:
    """A stripe, solid where the gap is zero and there is one colour; the dashes' colours take turns."""

    width_m: float
    rgbs: tuple[Rgb, ...]
    dash_m: float = 5.0
    gap_m: float = 0.0

    def __post_init__(self) -> None:
        if not (self.width_m > 0 and self.rgbs and self.dash_m > 0 and self.gap_m >= 0):
            numbers = (self.width_m, len(self.rgbs), self.dash_m, self.gap_m)
            raise ValueError(f"a line needs width_m, rgbs, dash_m > 0 and gap_m >= 0 (in this order), got {numbers}")


@dataclass(frozen=True)
class Stripe:
    """A painted line anywhere on the deck."""

    start_m: Point
    end_m: Point
    style: LineStyle


@dataclass(frozen=True)
class Catapult:
    """A dark slot in a painted band, and the jet blast deflector behind it."""

    start_m: Point
    end_m: Point
    width_m: float
    rgb: Rgb
    slot_m: float = 0.4
    border_m: float = 0.0  # distance of thin lines on both sides; 0: none
    deflector_m: float = 0.0  # across; 0: none


@dataclass(frozen=True)
class Panel:
    """A rectangle of another tone: elevator, hatch, fresh paint; with or without an outline."""

    middle_m: Point
    length_m: float  # along the ship before the yaw
    width_m: float
    rgb: Rgb
    opacity: float = 1.0
    yaw_deg: float = 0.0
    border: LineStyle | None = None


@dataclass(frozen=True)
class Spot:
    """A helicopter's landing circle, with a line that leads to its middle."""

    middle_m: Point
    radius_m: float
    width_m: float
    rgb: Rgb
    lead_m: float = 0.0  # length of the line from the middle aft; 0: none
    cross_m: float = 0.0  # half length of a bar across the middle; 0: none


@dataclass(frozen=True)
class Number:
    """Digits read from astern."""

    text: str
    at_m: Point  # left foot of the first digit
    height_m: float
    rgb: Rgb
    yaw_deg: float = 0.0  # to starboard


@dataclass(frozen=True)
class Plan:
    """All paint of a deck but its wear; a deck without a runway shows only the fields from `stern_m` on."""

    edge: EdgeStyle
    right_edge: EdgeStyle | None = None  # where it differs from the left one
    centre: LineStyle | None = None
    area_rgb: Rgb = (0.0, 0.0, 0.0)  # tone of the landing area
    area_opacity: float = 0.0
    ramp_m: float = 0.0  # depth of the painted stripe at the runway's beginning
    wires_m: tuple[float, ...] = ()  # distances from the runway's beginning
    wire_width_m: float = 0.15
    fouls: tuple[tuple[float, LineStyle], ...] = ()  # outside the edge lines: distance (negative: left), style
    stern_m: float = 0.0  # depth of a painted stripe across the whole stern
    paint_rgb: Rgb = (0.86, 0.87, 0.88)  # of ramp, stern and deck edge stripes
    port_border_m: float = 0.0  # width of a line along the port deck edge; 0: none
    starboard_border_m: float = 0.0
    catapults: tuple[Catapult, ...] = ()
    panels: tuple[Panel, ...] = ()
    spots: tuple[Spot, ...] = ()
    stripes: tuple[Stripe, ...] = ()
    numbers: tuple[Number, ...] = ()


@dataclass(frozen=True)
class DeckSurface:
    """Bare deck and the state of what is on it."""

    rgb: Rgb
    grain: float  # contrast of the deck's noise
    wear: float  # 0: fresh paint, 1: half gone
    noise_offset: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Strip:
    """Runway lines about a centre line that turns to port of the ship's axis."""

    start_m: Point  # where the centre line begins
    port_angle_deg: float
    spacing_m: tuple[float, float]  # of the line middles: at the beginning, and at the end of the longer line
    lengths_m: tuple[float, float]  # left, right


@dataclass(frozen=True)
class WorldLines:
    """Runway lines as w1 x + y + w0 = 0 in the world, from one x towards -x."""

    left: tuple[float, float]  # w1, w0
    right: tuple[float, float]
    start_x_m: float
    length_m: float


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
    """One ship that can be asked for by name. Exactly one of `strip` and `world_lines` is given."""

    length_m: float  # of the deck
    deck_height_m: float  # above the water or the ground
    port_m: tuple[Point, ...]  # corners of the port deck edge, stern to bow
    starboard_m: tuple[Point, ...]
    plan: Plan
    surface: DeckSurface
    strip: Strip | None = None
    world_lines: WorldLines | None = None
    stern_m: Point = (0.0, 0.0)  # in the world (NED): north, east of the deck's stern end on the ship's axis
    heading_deg: float = 0.0
    sea_z_m: float = 0.0  # of the water, or of the ground under a runway on land
    on_land: bool = False
    hull: Hull | None = None
    islands: tuple[Island, ...] = ()

    def __post_init__(self) -> None:
        if (self.strip is None) == (self.world_lines is None):
            raise ValueError(f"a ship needs either strip or world_lines, got {self.strip} and {self.world_lines}")
        if (self.hull is None) != self.on_land:
            raise ValueError(f"a hull belongs to a ship and none to a runway on land, got on_land {self.on_land}")
        for edge in (self.port_m, self.starboard_m):
            x = [point[0] for point in edge]
            if len(x) < 2 or sorted(set(x)) != x or x[0] != 0.0 or x[-1] != self.length_m:
                raise ValueError(f"a deck edge must run from x = 0 to {self.length_m} with growing x, got x = {x}")


def load_class(name: str) -> ShipClass:
    """A class that comes with the simulator.

    Raises:
        ValueError: an unknown name, or a file that holds no ship.
    """
    if name not in SHIP_CLASSES:
        raise ValueError(f"ship class must be one of {SHIP_CLASSES}, got {name!r}")
    return read_config(ShipClass, SHIPS / f"{name}.toml")
