"""What dehazing did to a picture of which no clear one exists: visible edges, gradients, saturation, dark channel; and
how far true lines are seen.

Source of the first three: Hautiere et al., "Blind contrast enhancement assessment by gradient ratioing at visible
edges", 2008, with Kohler's segmentation; of the last: He, Sun and Tang, "Single image haze removal using dark channel
prior", 2011.
"""

from collections.abc import Mapping, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from deckline.dehaze.filters import dark_channel
from deckline.dehaze.pixel_map import linear_levels
from deckline_lab.evaluation.false_content import raised_noise
from deckline_lab.evaluation.tables import Figures, Table, number
from deckline_sim.visible_line import VisibleLine, measure_contrast

LONG_SIDE_PX = 640  # pictures are averaged down to about this: the papers' size, and less noise
VISIBLE_CONTRAST = 0.05  # CIE: the least contrast that counts as visible
DARK_CHANNEL_PX = 15  # side of its window, as He et al. 2011 have it
BLOCK_PX = 4  # windows are two blocks wide and overlap by one; the paper's are 7 px wide, 4 px apart
LEVELS = 256
LEAST_IN_HAZE = 1.0  # grey levels of a line in the hazy picture: less is quantisation, and its enhancement no line
LOG_LIGHT = np.log(
    np.maximum(linear_levels(np.arange(LEVELS)), 1.0)
)  # differences are Weber's contrast; black is 1/255
# Worse than the input. Chosen so that a picture which came out nearly as it went in is not worse.
MOST_EDGES_LOST, LEAST_GRADIENT_RATIO, MOST_SATURATED, MOST_DARK_CHANNEL_GAIN = 0.05, 0.95, 0.02, 0.02
WORSE = "worse_than_input"
FIGURES = {  # the worst of many pictures, column, format, scale
    "new_edges": (min, "new edges, %", "+.1f", 100.0),
    "gradient_ratio": (min, "gradients", ".2f", 1.0),
    "newly_saturated": (max, "saturated, %", ".2f", 100.0),
    "dark_channel": (max, "dark channel", ".3f", 1.0),
    "raised_noise": (max, "raised noise, %", ".2f", 100.0),
}
MEANING = (
    "Median, in brackets the worst picture; no clear picture is used. New edges: of more than 5 % contrast, against "
    "the hazy picture. Gradients: over the hazy ones, geometric mean at visible edges. Saturated: new black or white. "
    "Noise counts as edges (Hautiere et al. 2008). Dark channel: mean; fog, sky and white paint raise it (He et al. "
    "2011). Raised noise: pixels on visible steps where the hazy picture shows none above noise, blocks and one level. "
    f"Worse: {MOST_EDGES_LOST:.0%} of the edges lost, gradients below {LEAST_GRADIENT_RATIO}, "
    f"{MOST_SATURATED:.0%} saturated, or a dark channel {MOST_DARK_CHANNEL_GAIN} higher."
)
Grey = NDArray[np.uint8]


def no_reference_figures(image_rgb: NDArray[np.uint8], hazy_rgb: NDArray[np.uint8]) -> dict[str, float]:
    """Figures of a dehazed picture against the hazy one, both (H, W, 3).

    Returns:
        new_edges: rate e of new visible edges, 0.5 for half as many again; left out where the hazy picture has none.
        gradient_ratio: r, geometric mean over the visible edges; left out where there is none.
        newly_saturated: sigma, share of the pixels that are black or white and were not.
        dark_channel: mean, 0..1; fog raises it, and so do sky and white paint.
        raised_noise: share of the pixels, see `false_content.raised_noise`.
        worse_than_input: 1 for a picture that lost visible edges, gradient or levels or gained fog, beyond the limits
            at the top of this module; 0 for others.

    Raises:
        ValueError: pictures of different shapes.
    """
    if image_rgb.shape != hazy_rgb.shape:
        raise ValueError(f"expected two pictures of one shape, got {image_rgb.shape} and {hazy_rgb.shape}")
    full, full_hazy = _grey(image_rgb), _grey(hazy_rgb)
    small, small_hazy = _shrink(image_rgb), _shrink(hazy_rgb)
    grey, grey_hazy = _grey(small), _grey(small_hazy)
    edges, edges_hazy = visible_edges(grey), visible_edges(grey_hazy)
    gradient, gradient_hazy = _gradient(grey)[edges], _gradient(grey_hazy)[edges]
    figures = {}
    if edges_hazy.any():
        figures["new_edges"] = float(edges.sum() / edges_hazy.sum() - 1)
    comparable = (gradient > 0) & (gradient_hazy > 0)
    if comparable.any():
        figures["gradient_ratio"] = float(np.exp(np.mean(np.log(gradient[comparable] / gradient_hazy[comparable]))))
    figures["newly_saturated"] = float(np.mean(np.isin(full, (0, 255)) & ~np.isin(full_hazy, (0, 255))))
    figures["dark_channel"] = _mean_dark_channel(small)
    figures["raised_noise"] = raised_noise(image_rgb, hazy_rgb)
    lost = -figures.get("new_edges", 0.0) > MOST_EDGES_LOST
    weaker = figures.get("gradient_ratio", 1.0) < LEAST_GRADIENT_RATIO
    saturated = figures["newly_saturated"] > MOST_SATURATED
    foggier = figures["dark_channel"] - _mean_dark_channel(small_hazy) > MOST_DARK_CHANNEL_GAIN
    return figures | {WORSE: float(lost or weaker or saturated or foggier)}


def visible_range_m(image_rgb: NDArray[np.uint8], hazy_rgb: NDArray[np.uint8], lines: Sequence[VisibleLine]) -> float:
    """The farthest range, m, at which one of two true lines is seen in a dehazed picture (H, W, 3); 0 where none is.

    A line is visible where its contrast, or that of a step along it, is above 5 % of luminance, the CIE's threshold of
    visibility, and by a grey level of the hazy picture (H, W, 3). Distance and blur count as haze does.
    """
    ranges = [0.0]
    for line, other in (lines, lines[::-1]):
        ends = (line.points_px, other.points_px)
        seen = measure_contrast(LOG_LIGHT[image_rgb], *ends) > np.log1p(VISIBLE_CONTRAST)
        seen &= measure_contrast(hazy_rgb, *ends) >= LEAST_IN_HAZE
        ranges += line.ranges_m[seen].tolist()
    return max(ranges)


def summarise_no_reference(pictures: Sequence[Mapping[str, float]]) -> Figures:
    """Median and worst of every figure, as new_edges.median and new_edges.worst, and the number of worse pictures."""
    summary: Figures = {WORSE: sum(figures.get(WORSE, 0.0) for figures in pictures)}
    for name, (worst, *_) in FIGURES.items():
        values = [figures[name] for figures in pictures if name in figures]
        if values:
            summary |= {f"{name}.median": float(np.median(values)), f"{name}.worst": worst(values)}
    return summary


def no_reference_table(summaries: Mapping[str, Figures]) -> Table:
    """A row for each dehazer's summary."""
    rows = []
    for dehazer, summary in summaries.items():
        cells = []
        for name, (_, _, form, scale) in FIGURES.items():
            median, worst = (number(scale * summary.get(f"{name}.{key}", np.nan), form) for key in ("median", "worst"))
            cells.append(f"{median} ({worst})")
        rows.append((dehazer, *cells, f"{summary[WORSE]:.0f}"))
    columns = ("dehazer", *(column for _, column, _, _ in FIGURES.values()), "worse than the input")
    return Table("Without a clear picture", columns, rows, (MEANING,))


def visible_edges(grey: Grey) -> NDArray[np.bool_]:
    """Pixels (H, W) on either side of a border whose mean contrast within a window is above 5 %.

    The border of a window is the threshold s with the largest mean contrast of the neighbours a <= s < b that it
    separates (Kohler's segmentation), min((s - a) / s, (b - s) / b) each: half of Weber's.

    Args:
        grey: (H, W); black counts as level 1.
    """
    pixels = np.arange(grey.size).reshape(grey.shape)
    first = np.concatenate([pixels[:-1].ravel(), pixels[:, :-1].ravel()])
    second = np.concatenate([pixels[1:].ravel(), pixels[:, 1:].ravel()])
    values = np.maximum(grey.ravel(), 1).astype(np.int64)
    different = values[first] != values[second]
    first, second = first[different], second[different]
    low, high = np.sort(values[np.stack([first, second])], axis=0)
    rows, columns = first // grey.shape[1] // BLOCK_PX, first % grey.shape[1] // BLOCK_PX
    contrast = _mean_contrast(rows, columns, low, high)
    border = np.where(2 * contrast.max(axis=2) > VISIBLE_CONTRAST, contrast.argmax(axis=2), 0)
    separated = np.zeros(len(first), np.bool_)
    for down, right in np.ndindex(2, 2):  # the windows that a block is part of
        level = border[rows + down, columns + right]
        separated |= (low <= level) & (level < high)
    mask = np.zeros(grey.size, np.bool_)
    mask[first[separated]] = mask[second[separated]] = True
    return mask.reshape(grey.shape)


def _mean_contrast(
    rows: NDArray[np.int64], columns: NDArray[np.int64], low: NDArray[np.int64], high: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Mean contrast (windows down, windows across, 256) at every threshold of the neighbours that it separates.

    The contrast of neighbours is 1 - low / s up to their geometric mean and 1 - s / high beyond, so that its sum is
    made of three running sums over s.

    Args:
        rows, columns: (N,) blocks that the neighbours lie in.
        low, high: (N,) their levels, low < high.
    """
    shape = (int(rows.max(initial=0)) + 1, int(columns.max(initial=0)) + 1, LEVELS)
    bins = (rows * shape[1] + columns) * LEVELS
    middle = np.floor(np.sqrt(low * high)).astype(np.int64) + 1

    def sums(begin: NDArray[np.int64], end: NDArray[np.int64], weight: NDArray[np.float64]) -> NDArray[np.float64]:
        size = int(np.prod(shape))
        steps = np.bincount(bins + begin, weight, size) - np.bincount(bins + end, weight, size)
        blocks = np.pad(np.cumsum(steps.reshape(shape), axis=2), ((1, 1), (1, 1), (0, 0)))
        return blocks[1:, 1:] + blocks[:-1, 1:] + blocks[1:, :-1] + blocks[:-1, :-1]

    levels = np.maximum(np.arange(LEVELS), 1)
    counts = sums(low, high, np.ones(len(low)))
    total = counts - sums(low, middle, low.astype(np.float64)) / levels - sums(middle, high, 1 / high) * levels
    return total / np.maximum(counts, 1)


def _grey(image_rgb: NDArray[np.uint8]) -> Grey:
    return np.asarray(cv2.cvtColor(image_rgb, cv2.COLOR_RGB2GRAY), dtype=np.uint8)


def _shrink(image_rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    height, width = image_rgb.shape[:2]
    scale = min(1.0, LONG_SIDE_PX / max(height, width))
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    return np.asarray(cv2.resize(image_rgb, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _gradient(grey: Grey) -> NDArray[np.float32]:
    """Sobel's magnitude (H, W)."""
    return np.hypot(cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1))


def _mean_dark_channel(image_rgb: NDArray[np.uint8]) -> float:
    return float(dark_channel(image_rgb.astype(np.float32) / 255, DARK_CHANNEL_PX).mean())
