"""What use leaves on a deck: rubber, oil, rust, wet patches, repairs, seams; and edge markings worn or painted over."""

import numpy as np
from numpy.typing import NDArray

from deckline.sim.ship.layout import Layout
from deckline.sim.ship.mesh import Rgb
from deckline.sim.ship.paint import Coat, axes, bars, layers, polygons, soft_discs, soft_stripes
from deckline.sim.ship.plan import DeckSurface

RUST = np.array([0.36, 0.22, 0.13])
DAMAGED = 0.35  # part of the random ships whose edge markings are interrupted
TOUCHDOWN = (0.12, 0.5)  # of the runway's length: where most rubber lies


def rubber_coat(layout: Layout, rng: np.random.Generator) -> Coat:
    """Tyre marks about the middle, densest where aircraft touch down; on some decks they merge into one dark field."""
    start, end = layout.centre_m
    along, right, length = axes(start, end)
    half = 0.42 * layout.spacing_m
    count = rng.integers(0, 30)
    begin = rng.uniform(0.02, 0.6, count) * length
    reach = np.minimum(rng.uniform(15.0, max(0.6 * length, 16.0), count), length - begin)
    across = np.clip(rng.normal(0, 0.3, (2, count)), -0.9, 0.9) * half
    first = start + begin[:, None] * along + across[0, :, None] * right
    last = start + (begin + reach)[:, None] * along + (0.7 * across[0] + 0.3 * across[1])[:, None] * right
    widths, strong = rng.uniform(0.4, 3.0, count), rng.uniform(0.1, 0.7, count)
    if rng.random() < 0.4:
        fields = rng.integers(1, 4)
        s = rng.uniform(*TOUCHDOWN, (fields, 1)) * length
        middle = start + s * along + rng.normal(0.0, 0.15 * half, fields)[:, None] * right
        stretch = np.minimum(np.minimum(rng.uniform(0.15, 0.45, (fields, 1)) * length, 150.0) / 2, s) * along
        first, last = np.concatenate([middle - stretch, first]), np.concatenate([middle + stretch, last])
        widths = np.concatenate([rng.uniform(0.8, 1.9, fields) * half, widths])
        strong = np.concatenate([rng.uniform(0.2, 0.6, fields), strong])
    shade = np.repeat(rng.uniform(0.02, 0.12, (len(first), 1)), 3, axis=1)
    return soft_stripes(first, last, widths, shade, strong)


def stain_coat(layout: Layout, rng: np.random.Generator) -> Coat:
    """Soft patches anywhere: dark and light streaks, oil, rust, wet deck."""
    streaks, drops = rng.integers(0, 26), rng.integers(0, 40)
    x = rng.uniform(0.0, 0.97, streaks + drops) * layout.length_m
    port, starboard = (np.interp(x, layout.stations_m, edge) for edge in (layout.port_m, layout.starboard_m))
    places = np.column_stack([x, port + rng.random(len(x)) * (starboard - port)])
    first = places[:streaks]
    last = first + np.column_stack([rng.uniform(4, 40, streaks), rng.normal(0, 4, streaks)])
    grey = np.repeat(rng.uniform(0.02, 0.5, (streaks, 1)), 3, axis=1)
    soft = soft_stripes(first, last, rng.uniform(2, 14, streaks), grey, rng.uniform(0.05, 0.4, streaks))
    rusty = rng.random((drops, 1)) < rng.choice([0.05, 0.6])
    colours = np.where(rusty, RUST * rng.uniform(0.7, 1.2, (drops, 1)), rng.uniform(0.02, 0.15, (drops, 1)))
    radii = np.exp(rng.uniform(np.log(0.4), np.log(6.0), drops))
    return layers([soft, soft_discs(places[streaks:], radii, colours, rng.uniform(0.1, 0.7, drops))])


def plate_coat(layout: Layout, surface: DeckSurface, rng: np.random.Generator) -> Coat:
    """Tones and seams of the deck's plates, and rectangles painted anew in another grey."""
    coats = []
    low, high = layout.outline_m.min(axis=0), layout.outline_m.max(axis=0)
    if rng.random() < 0.3:
        count = np.ceil((high - low) / [rng.uniform(9.0, 25.0), (high[1] - low[1]) / rng.integers(3, 9)])
        coats.append(_plates(low, (high - low) / count, count, surface.rgb, rng))
    if rng.random() < 0.3:
        pitch, shade, width = rng.uniform(4.0, 15.0), rng.uniform(0.0, 0.5), rng.uniform(0.08, 0.25)
        seams = np.arange(pitch, high[0], pitch)
        spans = np.column_stack([seams, seams + width])
        coats.append(bars((0, 0), (1, 0), spans, (low[1], high[1]), (shade,) * 3, rng.uniform(0.1, 0.5)))
    patches = rng.integers(0, 9)
    middle = low + rng.random((patches, 1, 2)) * (high - low)
    half = np.exp(rng.uniform(np.log(1.5), np.log(18.0), (patches, 1, 2)))
    corners = middle + half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    tone = np.clip(np.asarray(surface.rgb) * rng.uniform(0.5, 1.8, (patches, 1, 1)), 0.0, 1.0)
    coats.append(polygons(corners, tone, rng.uniform(0.3, 1.0, (patches, 1)), wear=0.3))
    return layers(coats)


def _plates(
    low_m: NDArray[np.float64],
    size_m: NDArray[np.float64],
    count: NDArray[np.float64],
    rgb: Rgb,
    rng: np.random.Generator,
) -> Coat:
    cells = np.stack(np.meshgrid(np.arange(count[0]), np.arange(count[1])), axis=-1).reshape(-1, 1, 2)
    corners = low_m + (cells + np.array([[0, 0], [1, 0], [1, 1], [0, 1]])) * size_m
    tone = np.clip(np.asarray(rgb) * rng.uniform(0.75, 1.3, (len(cells), 1, 1)), 0.0, 1.0)
    return polygons(corners, tone, rng.uniform(0.2, 0.8), wear=0.0)


def damage_coat(layout: Layout, width_m: float, rgb: Rgb, rng: np.random.Generator) -> Coat:
    """Deck-coloured gaps in the edge markings: worn spots across them, and repaint that hides half of their width."""
    coats = []
    for line in (layout.left_m, layout.right_m):
        length = axes(*line)[2]
        count = rng.integers(0, 7)
        first = rng.uniform(0.0, 0.95, count) * length
        spans = np.column_stack([first, np.minimum(first + rng.uniform(0.5, 0.06 * length + 1.0, count), length)])
        reach = width_m / 2 + 0.1
        across = np.where(rng.random((count, 1)) < 0.6, (-reach, reach), np.sort(rng.choice([-reach, 0, reach], 2)))
        tone = np.clip(np.asarray(rgb) * rng.uniform(0.7, 1.4, (count, 1, 1)), 0.0, 1.0)
        coats.append(bars(line[0], line[1], spans, across, tone, rng.uniform(0.3, 1.0, (count, 1)), wear=0.0))
    return layers(coats)
