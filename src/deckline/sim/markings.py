"""What is painted on a deck: the runway's markings and everything that may be mistaken for them."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from deckline.sim.layout import Layout
from deckline.sim.mesh import Rgb
from deckline.sim.paint import Coat, axes, dashes, figures, fill, ladder, layers, quad, soft_stripe, stripe

EdgeKind = Literal["ladder", "stripe", "double", "dashed"]
EDGE_KINDS: tuple[EdgeKind, ...] = ("ladder", "stripe", "double", "dashed")
YELLOW = (0.78, 0.62, 0.10)
SMEARED = 0.15  # part of the random edges whose paint has run together
RED = (0.55, 0.10, 0.08)


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


@dataclass(frozen=True)
class DeckSurface:
    """Bare deck and the state of what is on it."""

    rgb: Rgb
    grain: float  # contrast of the deck's noise
    wear: float  # 0: fresh paint, 1: half gone
    noise_offset: tuple[float, float]


CVN_EDGE = EdgeStyle("ladder", width_m=3.4, rail_m=0.75, bar_m=0.75, pitch_m=3.6, rgb=(0.86, 0.87, 0.88))
PAPER_EDGE = EdgeStyle("ladder", width_m=2.4, rail_m=0.6, bar_m=0.6, pitch_m=3.0, rgb=(0.86, 0.87, 0.88))


def random_edge(rng: np.random.Generator) -> EdgeStyle:
    """Ladders mostly; single, double and dashed lines too."""
    kind = EDGE_KINDS[rng.choice(len(EDGE_KINDS), p=[0.65, 0.15, 0.10, 0.10])]
    rail = rng.uniform(0.3, 0.9)
    width = rng.uniform(max(1.5, 3 * rail), 3.5)
    if kind in ("stripe", "dashed"):
        width = rng.uniform(0.5, 1.6)
    elif kind == "double":
        width = rng.uniform(3 * rail, 3 * rail + 1.0)
    bar = rng.uniform(0.3, 1.0) if kind == "ladder" else rng.uniform(3.0, 12.0)
    pitch = bar + rng.uniform(0.8, 6.0)
    white = rng.uniform(0.6, 1.0)
    tint = np.array([1.0, 1.0, 1.0]) if rng.random() < 0.7 else np.array([1.0, rng.uniform(0.88, 1.0), 0.7])
    rgb = _rgb(white * tint * rng.uniform(0.97, 1.03, 3))
    if rng.random() >= SMEARED:
        return EdgeStyle(kind, width, rail, bar, pitch, rgb)
    smear, reach = rng.uniform(0.25, 0.8), rng.uniform(0.5, 6.0)
    return EdgeStyle(kind, width, rail, bar, pitch, rgb, rng.uniform(0.0, 0.7), smear, reach)


def random_surface(rng: np.random.Generator) -> DeckSurface:
    """Deck from nearly black to light grey, greenish or brownish."""
    grey = rng.uniform(0.06, 0.34) if rng.random() < 0.88 else rng.uniform(0.34, 0.5)
    tint = np.array([[1, 1, 1], [1, 0.98, 0.95], [0.94, 1.0, 0.95], [1.05, 0.97, 0.88], [0.93, 0.97, 1.06]])
    colour = grey * tint[rng.integers(len(tint))] * rng.uniform(0.96, 1.04, 3)
    offset = rng.uniform(0, 100, 2)
    return DeckSurface(_rgb(colour), rng.uniform(0.1, 0.9), rng.beta(1.1, 3.0), (float(offset[0]), float(offset[1])))


def edge_coat(line_m: NDArray[np.float64], style: EdgeStyle) -> Coat:
    """One edge marking; its middle is the line (2, 2), from its first end to its last."""
    coat = crisp_edge(line_m, style)
    coat[:, 5] *= style.opacity
    return coat


def crisp_edge(line_m: NDArray[np.float64], style: EdgeStyle) -> Coat:
    """The marking as it was painted."""
    start, end = line_m
    if style.kind == "ladder":
        return ladder(start, end, style.width_m, style.rail_m, style.bar_m, style.pitch_m, style.rgb)
    if style.kind == "double":
        offset = (style.width_m - style.rail_m) / 2
        return layers([stripe(start, end, style.rail_m, style.rgb, side * offset) for side in (-1, 1)])
    if style.kind == "dashed":
        return dashes(start, end, style.width_m, [style.rgb], style.bar_m, style.pitch_m - style.bar_m)
    return stripe(start, end, style.width_m, style.rgb)


def smear_coat(line_m: NDArray[np.float64], inward: float, style: EdgeStyle, rng: np.random.Generator) -> Coat:
    """Streaks from the marking's sharp outer edge inwards (+1: to the line's right), fading."""
    start, end = line_m
    length = axes(start, end)[2]
    outer, inner = -inward * style.width_m / 2, inward * (style.width_m / 2 + style.smear_m)
    coats, s = [], 0.0
    while s < length:
        step = min(rng.uniform(0.5, 5.0), length - s)
        strong = style.smear * rng.uniform(0.75, 1.0)
        middle = inward * style.width_m / 2
        body = quad(start, end, (s, s + step), (outer, middle))
        fringe = quad(start, end, (s, s + step), (middle, inner))
        coats += [fill(body, style.rgb, strong), fill(fringe, style.rgb, [strong, strong, 0.0, 0.0])]
        s += step
    return layers(coats)


def runway_coat(layout: Layout, style: EdgeStyle, rng: np.random.Generator) -> Coat:
    """Tinted landing area, tyre marks, wires, centre line, threshold, and the edge markings on top."""
    start, end = layout.centre_m
    along, right, length = axes(start, end)
    half = float(np.hypot(*(layout.right_m[0] - layout.left_m[0]))) / 2
    inner = half - style.width_m / 2 - 0.3
    coats = []
    if rng.random() < 0.5:
        grey = rng.uniform(0.05, 0.5)
        coats.append(fill(quad(start, end, (0.0, length), (-inner, inner)), [grey] * 3, rng.uniform(0.1, 0.6)))
    coats.append(centre_coat(start, end, style, rng))
    coats += [tyre_marks(start, along, length, inner, rng), wires(start, end, inner, style, rng)]
    if rng.random() < 0.35:
        depth = rng.uniform(0.8, 3.0)
        coats.append(fill(quad(start, end, (0.0, depth), (-inner, inner)), style.rgb))
    if rng.random() < 0.25:
        begin = start + along * rng.uniform(4, 20) + right * rng.uniform(-0.7, 0.0) * half
        text = f"{rng.integers(1, 100):02d}"
        coats.append(figures(text, begin, begin + right, rng.uniform(3, 9), style.rgb))
    for line, inward in ((layout.left_m, 1.0), (layout.right_m, -1.0)):
        if style.smear > 0:
            coats.append(smear_coat(line, inward, style, rng))
        coats.append(edge_coat(line, style))
    return layers(coats)


def centre_coat(
    start_m: NDArray[np.float64], end_m: NDArray[np.float64], style: EdgeStyle, rng: np.random.Generator
) -> Coat:
    """Solid, dashed, two-coloured or no centre line."""
    kind, width = rng.random(), rng.uniform(0.3, 1.1)
    colours = [style.rgb, YELLOW] if rng.random() < 0.5 else [YELLOW if rng.random() < 0.5 else style.rgb]
    if kind < 0.2:
        return layers([])
    if kind < 0.45:
        return stripe(start_m, end_m, width, colours[-1])
    dash = rng.uniform(2.0, 10.0)
    gap = 0.0 if len(colours) == 2 and rng.random() < 0.5 else rng.uniform(1.0, 10.0)
    return dashes(start_m, end_m, width, colours, dash, gap)


def tyre_marks(
    start_m: NDArray[np.float64], along: NDArray[np.float64], length_m: float, half_m: float, rng: np.random.Generator
) -> Coat:
    """Dark rubber about the middle, densest where aircraft touch down."""
    right = np.array([-along[1], along[0]])
    coats = []
    for _ in range(rng.integers(0, 26)):
        begin = rng.uniform(0.02, 0.6) * length_m
        reach = min(rng.uniform(15.0, 0.6 * length_m), length_m - begin)
        across = np.clip(rng.normal(0, 0.3, 2), -0.9, 0.9) * half_m
        first = start_m + along * begin + right * across[0]
        last = start_m + along * (begin + reach) + right * (0.7 * across[0] + 0.3 * across[1])
        rubber = [rng.uniform(0.02, 0.1)] * 3
        coats.append(soft_stripe(first, last, rng.uniform(0.4, 3.5), rubber, rng.uniform(0.1, 0.7)))
    return layers(coats)


def wires(
    start_m: NDArray[np.float64], end_m: NDArray[np.float64], half_m: float, style: EdgeStyle, rng: np.random.Generator
) -> Coat:
    """Arresting wires across the landing area, some with a light or dark band under them."""
    coats: list[Coat] = []
    count, first, pitch = rng.integers(0, 5), rng.uniform(30.0, 60.0), rng.uniform(9.0, 15.0)
    reach = half_m + style.width_m * rng.uniform(0.3, 1.5)
    width, shade = rng.uniform(0.1, 0.35), rng.uniform(0.02, 0.12)
    for k in range(count):
        s = float(first + k * pitch)
        coats.append(fill(quad(start_m, end_m, (s, s + width), (-reach, reach)), [shade] * 3, wear=0.2))
    return layers(coats)


def distractor_coat(layout: Layout, style: EdgeStyle, rng: np.random.Generator) -> Coat:
    """Stains, catapult tracks, elevators, figures and stripes anywhere on the deck, under the runway's markings."""
    length = layout.length_m
    middle = (layout.port_m + layout.starboard_m) / 2
    coats = [deck_stains(layout, rng)]
    for _ in range(rng.integers(0, 5)):
        x = rng.uniform(0.3, 0.75) * length
        y = rng.normal(0, 0.3) * float(np.interp(x, layout.stations_m, layout.starboard_m - layout.port_m) / 2)
        last = (x + rng.uniform(50, 100), y + rng.uniform(-5, 5))
        paint = style.rgb if rng.random() < 0.6 else (0.05, 0.05, 0.05)
        coats.append(stripe((x, y), last, rng.uniform(0.3, 1.4), paint))
        if rng.random() < 0.5:
            coats.append(stripe((x, y), last, 0.3, style.rgb, rng.uniform(1.5, 5.0)))
    for _ in range(rng.integers(0, 4)):
        x, side = rng.uniform(0.1, 0.8) * length, rng.choice([-1.0, 1.0])
        y = float(np.interp(x, layout.stations_m, layout.starboard_m if side > 0 else layout.port_m)) - side * 8.0
        size = rng.uniform(12.0, 22.0)
        corners = quad((x, y), (x + size, y), (0.0, size), (-7.5, 7.5))
        shade = rng.uniform(0.05, 0.5)
        coats.append(fill(corners, [shade] * 3, rng.uniform(0.2, 0.9)))
        coats.append(stripe(corners[0], corners[1], 0.3, YELLOW if rng.random() < 0.5 else style.rgb))
    if rng.random() < 0.6:
        x = rng.uniform(0.7, 0.9) * length
        y = float(np.interp(x, layout.stations_m, middle)) - 6.0
        text = f"{rng.integers(1, 100)}"
        coats.append(figures(text, (x, y), (x, y + 1.0), rng.uniform(8, 18), style.rgb))
    return layers(coats)


def deck_stains(layout: Layout, rng: np.random.Generator) -> Coat:
    """Soft dark and light patches."""
    coats = []
    for _ in range(rng.integers(0, 30)):
        x = rng.uniform(0.0, 0.95) * layout.length_m
        y = rng.uniform(*layout.edges_at(x))
        last = (x + rng.uniform(4, 40), y + rng.normal(0, 4))
        shade = rng.uniform(0.02, 0.5)
        coats.append(soft_stripe((x, y), last, rng.uniform(2, 14), [shade] * 3, rng.uniform(0.05, 0.4)))
    return layers(coats)


def foul_coat(layout: Layout, style: EdgeStyle, rng: np.random.Generator) -> Coat:
    """Foul lines beside the runway, ramp stripe across the stern, border along the deck's edge."""
    coats = []
    for line, side in ((layout.left_m, -1.0), (layout.right_m, 1.0)):
        if rng.random() < 0.5:
            continue
        _, right, _ = axes(*line)
        shift = right * side * (style.width_m / 2 + rng.uniform(0.6, 6.0))
        rgbs = [[RED, style.rgb], [YELLOW, style.rgb], [YELLOW], [style.rgb], [RED]][rng.integers(5)]
        dash, gap, width = rng.uniform(0.8, 4.0), rng.uniform(0.0, 2.0), rng.uniform(0.15, 0.6)
        first, last = line + shift + np.array([[rng.uniform(0, 8)], [-rng.uniform(0, 30)]]) * axes(*line)[0]
        coats.append(dashes(first, last, width, rgbs, dash, gap))
    if rng.random() < 0.6:
        depth = rng.uniform(0.8, 4.0)
        corners = [(0, layout.port_m[0]), (depth, layout.port_m[0]), (depth, layout.starboard_m[0])]
        coats.append(fill([*corners, (0, layout.starboard_m[0])], style.rgb))
    if rng.random() < 0.4:
        width = rng.uniform(0.2, 0.6)
        for edge, inset in ((layout.port_m, 0.8), (layout.starboard_m, -0.8)):
            points = np.column_stack([layout.stations_m, edge + inset])[::4]
            coats += [stripe(a, b, width, style.rgb) for a, b in pairwise(points)]
    return layers(coats)


def deck_coat(layout: Layout, style: EdgeStyle, runway: bool, rng: np.random.Generator) -> Coat:
    """Everything painted on a deck, in order; without a runway only the rest."""
    coats = [distractor_coat(layout, style, rng)]
    if runway:
        coats += [foul_coat(layout, style, rng), runway_coat(layout, style, rng)]
    return layers(coats)


def _rgb(colour: NDArray[np.float64]) -> Rgb:
    red, green, blue = np.clip(colour, 0.0, 1.0)
    return float(red), float(green), float(blue)
