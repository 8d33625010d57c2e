"""The sea's horizon in one image, in clear air and in haze, with its uncertainty; or why there is none.

An image is cut into vertical strips, each a profile of colours. Above the horizon a profile is a smooth sky. Below it,
where a row is d below the horizon, it is A + (S - A) exp(-k / d): A is the sky's colour at the horizon, S a water that
mirrors more sky at grazing angles, k the haze (extinction times height, in image widths). k = 0 is an edge; (k / d)^2
is air that thickens with range. Every horizon row and k of a grid has its best sky and water in closed form; what
remains is the likelihood, of noise that grows with the water's visibility. Strips vote for a line by their likelihoods,
each with a bound: a strip full of ship says nothing. Source: Koschmieder's law; Schlick's (1 - sin)^5.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d

from deckline.checks import check_image
from deckline.dehaze.haze_fit import schlick

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

STRIPS = 12
COARSE_PX, FINE_PX = 96, 288  # image widths: for all lines, and for those near the best one
MIN_SIDE_PX = 24
HAZES = np.geomspace(0.01, 0.8, 13)  # image widths; with 8 the wrong power fits better, and lines are 8 deg off
HAZE = np.r_[0.0, HAZES, HAZES]  # k
POWER = np.repeat([1.0, 2.0], [1 + len(HAZES), len(HAZES)])  # of k / d: 2 where the air thickens with range
LAYERED_NATS = 20.0  # what air that thickens must gain
ALL_AIR = np.arange(len(HAZE))
TEXTURE = (0.0, 4.0, 16.0)  # noise of clear water over the sky's
FOCAL = 1.0  # assumed focal length, image widths: sets how fast water mirrors less below the horizon
SKY_TERMS = (0.06, 0.2, 0.4)  # 1-sigma of the sky's slope, curvature and third order, of the level
DARK, DARK_SIGMA = 0.65, 0.25  # of the airlight: how far water seen from above is below it
MIRROR, MIRROR_SIGMA = 0.3, 0.26  # of that: what grazing water adds; 1-sigma of the airlight
SLOPE_SIGMA = 0.3  # of the level: the water's own change over one focal length
PRIOR_NOISE = 3.0  # levels of noise that these priors are weighed against
NOISE = 0.5  # levels: the least residual
BRIGHTER = 0.1  # of the airlight: 1-sigma of how much brighter than the sky water is; clipped at three
BELOW = np.array([0.05, 0.15, 0.4])  # where that is looked up, focal lengths below the horizon
INDEPENDENT_ROWS = 15.0  # of a profile, in each channel
BOUND = 8.0  # nats that one strip says at most
ROLL_SIGMA_DEG, MAX_ROLL_DEG = 10.0, 30.0
COMMON_ERROR = 4.0  # the strips err alike: their likelihood is flattened by it for the uncertainty; and what is left,
SIGMA_TIMES, SIGMA_FLOOR = 2.0, 0.001  # times, and image widths: chosen on 38 views of preset paper, 200 to 3000 m
AIR_NATS = 20 * COMMON_ERROR  # over the best: a haze that is so much worse is not tried again near the best line

OUTSIDE = 0.3  # of the height: how far above the image a line may start
SLOPE_SPAN = 0.06  # about the coarse line
MIN_GAIN = 36.0  # nats over images without a horizon
MIN_AGREE = 0.6  # of the strips
MAX_ELSEWHERE = 0.02  # of the probability that is farther off the best line than this share of the height:
ELSEWHERE = 0.1
MAX_SIGMA = 0.03  # of the height
MIN_CONTRAST = 4.0  # levels, between sky and water
MAX_SKY, MAX_WATER = 0.1, 0.2  # of that contrast: rms residual of a smooth sky, of water in haze


@dataclass(frozen=True)
class Horizon:
    """A straight horizon line."""

    width_px: int  # of the image
    middle_px: float  # row where it crosses the image's middle, 0 the centre of the first row
    middle_sigma_px: float
    slope: float  # rows down for each column to the right
    slope_sigma: float

    def rows(self, columns: NDArray[np.float64]) -> Float64:
        """Rows of the line at columns (N,), px."""
        return np.asarray(self.middle_px + self.slope * (columns - (self.width_px - 1) / 2))


@dataclass(frozen=True)
class NoHorizon:
    """Why an image tells no horizon."""

    reason: str


@dataclass(frozen=True, eq=False)
class _Scan:
    """Lines that were compared; rows count from the image's upper edge."""

    middles: Float64  # (M,) rows
    slopes: Float64  # (T,)
    cost: Float64  # (T, M, K) nats, the roll's prior included
    without: float  # nats, if no strip shows a horizon
    bounded: Float64  # (S, K, V) each strip's nats at `rows`, over its best, bounded
    rows: Float64  # (V,)

    @property
    def best(self) -> tuple[np.intp, ...]:
        return np.unravel_index(self.cost.argmin(), self.cost.shape)

    def probability(self, flattened: float = 1.0) -> Float64:
        """(T, M), summed over haze."""
        likelihood = np.exp((self.cost.min() - self.cost) / flattened).sum(axis=2)
        return np.asarray(likelihood / likelihood.sum())


def find_horizon(image_rgb: NDArray[np.uint8], rough: bool = False) -> Horizon | NoHorizon:
    """The horizon of an image (H, W, 3), or why there is none that can be told.

    The line is where the sea ends, or would end without haze. It needs no intrinsics; a lens whose distortion bends
    lines makes it wrong by as much as it bends them.

    Args:
        image_rgb: (H, W, 3).
        rough: a vague line counts too, and one over foam or glitter, in which haze cannot be read; mind its sigma.
    """
    check_image(image_rgb)
    height, width = image_rgb.shape[:2]
    if min(height, width) < MIN_SIDE_PX:
        return NoHorizon(f"the image is smaller than {MIN_SIDE_PX} px")
    profiles, x, unit = measure_strips(image_rgb, COARSE_PX)
    count = profiles.shape[1]
    slopes = np.tan(np.deg2rad(np.arange(-MAX_ROLL_DEG, MAX_ROLL_DEG + 1, 2.0)))
    rows = np.arange(-OUTSIDE * count, count - 0.5, 0.5)
    coarse = _scan(profiles, x, unit, rows[::2], rows, slopes, nearby=3)
    tilt, middle, _ = coarse.best
    probability = coarse.probability().sum(axis=0)
    off = coarse.middles - coarse.middles[middle]
    elsewhere = float(probability[np.abs(off) > ELSEWHERE * count].sum())
    spread = float(np.sqrt(probability @ off**2))
    if coarse.without - coarse.cost.min() < MIN_GAIN:
        return NoHorizon("no horizon is seen")
    if elsewhere > MAX_ELSEWHERE:
        return NoHorizon("more than one line may be the horizon")
    profiles, x, fine_unit = measure_strips(image_rgb, FINE_PX)
    zoom = unit / fine_unit
    span = zoom * min(max(4 * spread, 5.0), 12.0)
    line = coarse.middles[middle] * zoom, coarse.slopes[tilt]
    air = np.flatnonzero(coarse.cost.min(axis=(0, 1)) < coarse.cost.min() + AIR_NATS)
    fine = _scan_near(profiles, x, fine_unit, *line, span, air)
    return _judge(fine, profiles, x, fine_unit, width, height, rough)


def measure_strips(image_rgb: NDArray[np.uint8], width_px: int) -> tuple[Float32, Float64, float]:
    """Median colours of vertical strips (S, N, 3) of an image averaged down to a width; their middles' columns (S,)
    off the image's middle; and a row's height in image widths."""
    import cv2

    height, width = image_rgb.shape[:2]
    scale = min(1.0, width_px / width)
    size = max(STRIPS, round(width * scale)), max(12, round(height * scale))
    small = cv2.resize(image_rgb, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    edges = np.linspace(0, size[0], STRIPS + 1).astype(int)
    profiles = np.stack([np.median(small[:, a:b], axis=1) for a, b in pairwise(edges)])
    return profiles, (edges[:-1] + edges[1:] - size[0]) / 2, 1 / size[0]


def _scan_near(
    profiles: Float32, x: Float64, unit: float, middle: float, slope: float, span: float, air: NDArray[np.intp]
) -> _Scan:
    """Every line near one in this air; `span` is how many rows its middle may be off."""
    count = profiles.shape[1]
    step = max(0.5, span / 30)
    line, reach = middle + slope * x, span + np.abs(x).max() * SLOPE_SPAN
    rows = np.arange(line.min() - reach, line.max() + reach + step, step)
    rows = rows[(rows > -OUTSIDE * count) & (rows < count - 1)]
    middles = middle + np.arange(-span, span + 0.01, step / 2)
    return _scan(profiles, x, unit, rows, middles, slope + np.linspace(-SLOPE_SPAN, SLOPE_SPAN, 25), air)


def _scan(
    profiles: Float32,
    x: Float64,
    unit: float,
    rows: Float64,
    middles: Float64,
    slopes: Float64,
    air: NDArray[np.intp] = ALL_AIR,
    nearby: int = 1,
) -> _Scan:
    """Every line through these middles (M,) with these slopes (T,), by each strip's nats at these rows (V,).

    A strip counts by its best of `nearby` rows and hazes: a coarse grid misses what is sharply defined.
    """
    nats = minimum_filter1d(strip_nats(profiles, rows, unit, air), nearby, axis=2)
    for power in np.unique(POWER[air]):
        alike = POWER[air] == power
        nats[:, alike] = minimum_filter1d(nats[:, alike], nearby, axis=1)
    flat = flat_nats(profiles)
    best = np.minimum(nats.min(axis=(1, 2)), flat)
    bounded, without = (-np.log(np.exp(-over) + np.exp(-BOUND)) for over in (nats - best[:, None, None], flat - best))
    place = (middles[:, None] + slopes[:, None, None] * x - rows[0]) / (rows[1] - rows[0])  # (T, M, S)
    inside = (place >= 0) & (place < len(rows) - 1)
    before = np.clip(place.astype(np.intp), 0, len(rows) - 2)
    part = (place - before)[..., None]
    cost = np.repeat(np.rad2deg(np.arctan(slopes))[:, None, None] ** 2 / (2 * ROLL_SIGMA_DEG**2), len(middles), axis=1)
    cost = np.repeat(cost, len(air), axis=2) + LAYERED_NATS * (POWER[air] > 1)
    for strip, over in enumerate(bounded):
        table, at, share = over.T, before[..., strip], part[..., strip, :]
        here = table[at] * (1 - share) + table[at + 1] * share
        cost += np.where(inside[..., strip, None], here, without[strip])
    return _Scan(middles, slopes, cost, float(without.sum()), bounded, rows)


def strip_nats(profiles: Float32, rows: Float64, unit: float, air: NDArray[np.intp] = ALL_AIR) -> Float64:
    """Minus log likelihood (S, K, V) of profiles (S, N, 3) for each haze and horizon row (V,), the best texture's."""
    strips, count = profiles.shape[:2]
    design = _design(count, rows, unit, _level(profiles), air)
    terms = design.shape[-1]
    levels = profiles.transpose(1, 0, 2).reshape(count, -1)  # (N, S * 3)
    weight, best = 1.5 * INDEPENDENT_ROWS / count, np.full((len(rows) * len(air), strips), np.inf)
    seen = design[:, :count, 4]
    for texture in TEXTURE:
        precision = 1 / (1 + np.square(np.float32(texture) * seen))
        root = np.sqrt(precision)[..., None]
        q, r = np.linalg.qr(np.concatenate([design[:, :count] * root, design[:, count:]], axis=1))
        found = np.matmul((q[:, :count] * root).transpose(0, 2, 1), levels)
        residual = precision @ (levels * levels) - np.square(found).sum(axis=1)
        residual = np.maximum(residual, 0).reshape(-1, strips, 3).sum(axis=2)
        colours = np.linalg.solve(r, found).reshape(-1, terms, strips, 3).mean(axis=3)
        nats = weight * count * np.log(residual / (3 * count) + NOISE**2)
        nats += _brightness_nats(colours) - weight * np.log(precision).sum(axis=1, keepdims=True)
        best = np.minimum(best, nats)
    return np.asarray(best.reshape(len(rows), len(air), strips).transpose(2, 1, 0), np.float64)


def _design(count: int, rows: Float64, unit: float, level: float, air: NDArray[np.intp] = ALL_AIR) -> Float32:
    """The linear model of a profile (V * K, N + P, P), priors below: A, three terms of the sky, three of the water."""
    below = (np.arange(count) + 0.5 - rows[:, None]) * (unit / FOCAL)
    up, down = np.maximum(-below, 0), np.maximum(below, 1e-4)
    depth = np.minimum((HAZE[air, None] / down[:, None] / FOCAL) ** POWER[air, None], 50)
    seen = np.where(below[:, None] > 0, np.exp(-depth), 0)  # (V, K, N)
    sky = [np.broadcast_to(term[:, None], seen.shape) for term in (np.ones_like(up), up, up**2, up**3)]
    mirror = schlick(down / np.sqrt(1 + down * down))[:, None]
    design = np.stack([*sky, seen, seen * mirror, seen * down[:, None]], axis=-1)
    prior = np.zeros((design.shape[-1],) * 2)
    prior[0, 0] = 1e-3
    for term, sigma in enumerate(SKY_TERMS, start=1):
        prior[term, term] = 1 / (sigma * level)
    prior[4, [0, 4]] = np.array([DARK, 1]) / (DARK_SIGMA * level)
    prior[5, [4, 5]] = np.array([MIRROR, 1]) / (MIRROR_SIGMA * level)
    prior[6, 6] = 1 / (SLOPE_SIGMA * level)
    prior[1:] *= PRIOR_NOISE
    design = design.reshape(-1, *design.shape[2:])
    return np.concatenate([design, np.broadcast_to(prior, (len(design), *prior.shape))], axis=1).astype(np.float32)


def _brightness_nats(colours: Float32) -> Float64:
    """What water that is brighter than the sky at the horizon costs (B, S), of the model's greys (B, P, S)."""
    mirror = schlick(BELOW / np.sqrt(1 + BELOW * BELOW))
    water = colours[:, 4, :, None] + colours[:, 5, :, None] * mirror + colours[:, 6, :, None] * BELOW
    brighter = water.max(axis=2) / np.maximum(colours[:, 0], 10.0)
    return np.asarray(np.square(np.clip(brighter / BRIGHTER, 0, 3)) / 2, np.float64)


def flat_nats(profiles: Float32) -> Float64:
    """Minus log likelihood (S,) of profiles (S, N, 3) without a horizon: a cubic through each channel."""
    strips, count = profiles.shape[:2]
    q, _ = np.linalg.qr(np.vander(np.linspace(-1, 1, count), 4))
    levels = profiles.transpose(1, 0, 2).reshape(count, -1).astype(np.float64)
    residual = np.maximum((levels * levels).sum(axis=0) - np.square(q.T @ levels).sum(axis=0), 0)
    mean = residual.reshape(strips, 3).sum(axis=1) / (3 * count)
    return np.asarray(1.5 * INDEPENDENT_ROWS * np.log(mean + NOISE**2))


def _judge(
    fine: _Scan, profiles: Float32, x: Float64, unit: float, width: int, height: int, rough: bool
) -> Horizon | NoHorizon:
    """The line of a fine scan, where it can be trusted."""
    tilt, middle, _ = fine.best
    at = np.rint((fine.middles[middle] + fine.slopes[tilt] * x - fine.rows[0]) / (fine.rows[1] - fine.rows[0]))
    at = np.clip(at.astype(int), 0, len(fine.rows) - 1)
    agree = (fine.bounded[np.arange(STRIPS), :, at].min(axis=1) < BOUND / 2).mean()
    if agree < MIN_AGREE:
        return NoHorizon("the parts of the image do not agree on a horizon")
    probability = fine.probability(COMMON_ERROR)
    row, row_sigma = _moments(fine.middles, probability.sum(axis=0))
    slope, slope_sigma = _moments(fine.slopes, probability.sum(axis=1))
    scale = unit * width
    sigma = SIGMA_TIMES * np.hypot(row_sigma, SIGMA_FLOOR / unit) * scale
    reason = _judge_parts(profiles, row + slope * x, unit, rough)
    if reason or (sigma > MAX_SIGMA * height and not rough) or not 0 < row < profiles.shape[1]:
        return NoHorizon(reason or "where the horizon is cannot be told well enough")
    return Horizon(width, float(row * scale - 0.5), float(sigma), slope, float(SIGMA_TIMES * slope_sigma))


def _moments(values: Float64, probability: Float64) -> tuple[float, float]:
    mean = float(probability @ values)
    return mean, float(np.sqrt(probability @ (values - mean) ** 2))


def _judge_parts(profiles: Float32, line: Float64, unit: float, rough: bool) -> str:
    """Why what lies above and below a line (S,) of rows is no sky over water; empty where it is."""
    count = profiles.shape[1]
    level = _level(profiles)
    parts = []  # of each strip: residual of the sky, of the water, contrast
    for profile, row in zip(profiles, line, strict=True):
        if not 4 <= row <= count - 4:
            continue
        design = _design(count, np.array([row]), unit, level)
        levels = np.concatenate([profile, np.zeros((design.shape[2], 3), np.float32)])
        q, _ = np.linalg.qr(design)
        residual = (levels - q @ (q.transpose(0, 2, 1) @ levels))[:, :count]
        squares = np.square(residual[np.square(residual).sum(axis=(1, 2)).argmin()])
        above, below = int(row), int(row) + 1
        contrast = profile[above - 3 : above].mean() - profile[below:].mean(axis=1).min()
        parts.append((np.sqrt(squares[:above].mean()), np.sqrt(squares[below:].mean()), contrast))
    sky, water, contrast = np.median(parts, axis=0) if parts else (0.0, 0.0, 0.0)
    if contrast < MIN_CONTRAST:
        return "what lies below the horizon is not darker than the sky, as a sea is"
    if sky > MAX_SKY * contrast:
        return "what lies above the horizon is no smooth sky"
    return "what lies below the horizon is no sea" if water > MAX_WATER * contrast and not rough else ""


def _level(profiles: Float32) -> float:
    """A level near the airlight's, that the priors are shares of."""
    return max(40.0, float(np.percentile(profiles.mean(axis=2), 80)))
