"""What is painted on one deck, as data: a ship's file holds such a plan, and random ships draw theirs.

Ship frame: x forward, y to starboard, metres on the deck plane. Colours are display colours, 0..1.
"""

from dataclasses import dataclass
from typing import Literal

from deckline.sim.ship.mesh import Rgb

Point = tuple[float, float]
EdgeKind = Literal["ladder", "stripe", "double", "dashed"]


@dataclass(frozen=True)
class EdgeStyle:
    """How an edge of the runway is painted; widths and lengths in metres."""

    kind: EdgeKind
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
            raise ValueError(
                f"an edge needs width, rail > 0 and pitch > bar > 0, got width, rail, bar, pitch {numbers}"
            )


@dataclass(frozen=True)
class LineStyle:
    """A stripe, solid where the gap is zero and there is one colour; the dashes' colours take turns."""

    width_m: float
    rgbs: tuple[Rgb, ...]
    dash_m: float = 5.0
    gap_m: float = 0.0

    def __post_init__(self) -> None:
        if not (self.width_m > 0 and self.rgbs and self.dash_m > 0 and self.gap_m >= 0):
            numbers = (self.width_m, self.dash_m, self.gap_m)
            raise ValueError(
                f"a line needs colours, width, dash > 0 and gap >= 0, got {len(self.rgbs)} colours and {numbers}"
            )


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
    """All paint of a deck but its wear; what stands before `stern_m` is left out where there is no runway."""

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

    @property
    def edges(self) -> tuple[EdgeStyle, EdgeStyle]:
        """Style of the left and of the right edge marking."""
        return self.edge, self.edge if self.right_edge is None else self.right_edge


@dataclass(frozen=True)
class DeckSurface:
    """Bare deck and the state of what is on it."""

    rgb: Rgb
    grain: float  # contrast of the deck's noise
    wear: float  # 0: fresh paint, 1: half gone
    noise_offset: tuple[float, float] = (0.0, 0.0)
