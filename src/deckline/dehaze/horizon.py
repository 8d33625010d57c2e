"""The sea's horizon in one image, in clear air and in haze, with its uncertainty; or why there is none.

An image is cut into vertical strips, each a profile of colours. Above the horizon a profile is a smooth sky. Below it,
where a row is d below the horizon, it is A + (S - A) exp(-k / d): A is the sky's colour at the horizon, S a water that
mirrors more sky at grazing angles, k the haze (extinction times height, in image widths). k = 0 is an edge; (k / d)^2
is air that thickens with range. Every horizon row and k of a grid has its best sky and water in closed form; what
remains is the likelihood, of noise that grows with the water's visibility. Strips vote for a line by their likelihoods,
each with a bound: a strip full of ship has no vote. Source: Koschmieder's law; Schlick's (1 - sin)^5.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d

from deckline.checks import check_image
from deckline.dehaze.haze_fit import schlick

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

STRIPS = 12
COARSE_PX, FINE_PX = 96, 288  # longer sides of the image: for all lines, and for those near the best one
MIN_SIDE_PX = 24
HAZES = np.geomspace(0.01, 0.8, 13)  # image widths; with 8 the wrong power fits better, and lines are 8 deg off
HAZE = np.r_[0.0, HAZES, HAZES]  # k
POWER = np.repeat([1.0, 2.0], [1 + len(HAZES), len(HAZES)])  # of k / d: 2 where the air thickens with range
LAYERED_NATS = 20.0  # what air that thickens must gain
ALL_AIR = np.arange(len(HAZE))
TEXTURE = (0.0, 4.0, 16.0)  # noise of clear water over the sky's
FOCAL = 1.0  # assumed focal length, image widths: sets how fast water mirrors less below the horizon
TERMS = 7  # of a profile: the airlight, three of the sky, three of the water
SKY_TERMS = (0.06, 0.2, 0.4)  # 1-sigma of the sky's slope, curvature and third order, of the level
DARK, DARK_SIGMA = 0.65, 0.25  # of the airlight: how far water seen from above is below it
MIRROR, MIRROR_SIGMA = 0.3, 0.26  # of that: what grazing water adds; 1-sigma of the airlight
SLOPE_SIGMA = 0.3  # of the level: the water's own change over one focal length
LEVEL_STEP = 1.05  # ratio of the levels that share a model; the priors are vaguer by far
PRIOR_NOISE = 3.0  # levels of noise that these priors are weighed against
NOISE = 0.5  # levels: the least residual
BRIGHTER = 0.1  # of the airlight: 1-sigma of how much brighter than the sky water is; clipped at three
BELOW = np.array([0.05, 0.15, 0.4])  # where that is evaluated, focal lengths below the horizon
INDEPENDENT_ROWS = 15.0  # of a profile, in each channel
BOUND = 8.0  # nats, the largest vote of one strip
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


@dataclass(frozen=True)
class NoHorizon:
    """Why no horizon was found in an image."""

    reason: str


@dataclass(frozen=True, eq=False)
class ProfileModel:
    """Least squares of every horizon row in one haze and one texture, ready for any profile of N rows."""

    weights: Float32  # (V, N) of squared residuals
    fits: Float32  # (V, P, N): levels to orthonormal coefficients
    greys: Float32  # (V, 1 + W, P): those to the greys of the sky at the horizon and the water at BELOW


@dataclass(frozen=True, eq=False)
class LineScan:
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
    """The horizon of an image, or why none was found.

    The line is where the sea ends, or would end without haze. It needs no intrinsics; a lens whose distortion bends
    lines makes it wrong by as much as it bends them.

    Args:
        image_rgb: (H, W, 3).
        rough: accept a vague line as well, and one over foam or glitter, where haze cannot be fitted; mind its sigma.
    """
    check_image(image_rgb)
    height, width = image_rgb.shape[:2]
    if min(height, width) < MIN_SIDE_PX:
        return NoHorizon(f"the image is smaller than {MIN_SIDE_PX} px")
    profiles, x, unit = measure_strips(image_rgb, COARSE_PX)
    count = profiles.shape[1]
    slopes = np.tan(np.deg2rad(np.arange(-MAX_ROLL_DEG, MAX_ROLL_DEG + 1, 2.0)))
    rows, nats = _all_rows(count), _strip_nats(profiles, _all_models(count, unit, _level(profiles)))
    coarse = _scan(profiles, x, rows, _best_nearby(nats), ALL_AIR, rows[::2], slopes)
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


def measure_strips(image_rgb: NDArray[np.uint8], long_side_px: int) -> tuple[Float32, Float64, float]:
    """Median colours of vertical strips (S, N, 3) of an image averaged down to this longer side; the columns of their
    middles (S,) off the image's middle; and a row's height in image widths."""
    import cv2

    height, width = image_rgb.shape[:2]
    scale = min(1.0, long_side_px / max(width, height))
    size = max(STRIPS, round(width * scale)), max(12, round(height * scale))
    small = cv2.resize(image_rgb, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    edges = np.linspace(0, size[0], STRIPS + 1).astype(int)
    profiles = np.stack([np.median(small[:, a:b], axis=1) for a, b in pairwise(edges)])
    return profiles, (edges[:-1] + edges[1:] - size[0]) / 2, 1 / size[0]


def _scan_near(
    profiles: Float32, x: Float64, unit: float, middle: float, slope: float, span: float, air: NDArray[np.intp]
) -> LineScan:
    """Every line near one in this air; `span` is how many rows its middle may be off."""
    count = profiles.shape[1]
    step = max(0.5, span / 30)
    line, reach = middle + slope * x, span + np.abs(x).max() * SLOPE_SPAN
    rows = np.arange(line.min() - reach, line.max() + reach + step, step)
    rows = rows[(rows > -OUTSIDE * count) & (rows < count - 1)]
    middles = middle + np.arange(-span, span + 0.01, step / 2)
    models = (_model(rows, count, unit, _level(profiles), HAZE[k], POWER[k]) for k in air)
    slopes = slope + np.linspace(-SLOPE_SPAN, SLOPE_SPAN, 25)
    return _scan(profiles, x, rows, _strip_nats(profiles, models), air, middles, slopes)


def _best_nearby(nats: Float64) -> Float64:
    """Each strip's best (S, K, V) of three rows and three hazes: a coarse grid misses what is sharply defined."""
    nats = minimum_filter1d(nats, 3, axis=2)
    for power in np.unique(POWER):
        alike = power == POWER
        nats[:, alike] = minimum_filter1d(nats[:, alike], 3, axis=1)
    return nats


def _scan(
    profiles: Float32,
    x: Float64,
    rows: Float64,
    nats: Float64,
    air: NDArray[np.intp],
    middles: Float64,
    slopes: Float64,
) -> LineScan:
    """Every line through these middles (M,) with these slopes (T,), by each strip's nats (S, K, V) at these rows."""
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
    return LineScan(middles, slopes, cost, float(without.sum()), bounded, rows)


def _model(rows: Float64, count: int, unit: float, level: float, haze: float, power: float) -> list[ProfileModel]:
    """One haze's, for each texture."""
    design, prior = _design(rows, count, unit, haze, power), _prior(level)
    greys = np.zeros((1 + len(BELOW), TERMS))
    greys[0, 0], greys[1:, 4:] = 1.0, np.stack([np.ones_like(BELOW), _mirror(BELOW), BELOW], axis=-1)
    models = []
    for texture in TEXTURE:
        weights = 1 / (1 + np.square(texture * design[:, 4]))
        weighed = design * weights[:, None]
        whitening = np.linalg.inv(np.linalg.cholesky(weighed @ design.transpose(0, 2, 1) + prior.T @ prior))
        parts = weights, whitening @ weighed, greys @ whitening.transpose(0, 2, 1)
        models.append(ProfileModel(*(part.astype(np.float32) for part in parts)))
    return models


@lru_cache(maxsize=2)  # a flight's pictures are alike; of 16:9 20 MB each, of a square 70
def _all_models(count: int, unit: float, level: float) -> list[list[ProfileModel]]:
    rows = _all_rows(count)
    return [_model(rows, count, unit, level, haze, power) for haze, power in zip(HAZE, POWER, strict=True)]


def _all_rows(count: int) -> Float64:
    return np.arange(-OUTSIDE * count, count - 0.5, 0.5)


def _strip_nats(profiles: Float32, hazes: Iterable[list[ProfileModel]]) -> Float64:
    """Minus log likelihood (S, K, V) of profiles (S, N, 3) for each haze and horizon row, the best texture's."""
    strips, count = profiles.shape[:2]
    levels = profiles.transpose(1, 0, 2).reshape(count, -1)  # (N, S * 3)
    squares, weight = np.square(levels), 1.5 * INDEPENDENT_ROWS / count

    def nats(model: ProfileModel) -> Float32:
        found = (model.fits.reshape(-1, count) @ levels).reshape(-1, TERMS, strips, 3)
        residual = np.maximum(
            model.weights @ squares - np.einsum("vpsc,vpsc->vsc", found, found).reshape(-1, strips * 3), 0
        )
        mean = residual.reshape(-1, strips, 3) @ np.full(3, 1 / (3 * count), np.float32)
        grey = model.greys @ (found @ np.full(3, 1 / 3, np.float32))
        brighter = np.clip((grey[:, 1:].max(axis=1) / np.maximum(grey[:, 0], 10.0)) / BRIGHTER, 0, 3)
        texture = np.log(model.weights).sum(axis=1, keepdims=True)
        return np.asarray(weight * (count * np.log(mean + NOISE**2) - texture) + np.square(brighter) / 2)

    best = [np.min([nats(model) for model in textures], axis=0) for textures in hazes]
    return np.stack(best, axis=1).transpose(2, 1, 0).astype(np.float64)


def _design(rows: Float64, count: int, unit: float, haze: float | Float64, power: float | Float64) -> Float64:
    """The linear model of a profile (V, P, N) in one haze, or (V,) in one for each row: A, three terms of the sky,
    three of the water."""
    below = (np.arange(count) + 0.5 - rows[:, None]) * (unit / FOCAL)
    up, down = np.maximum(-below, 0), np.maximum(below, 1e-4)
    depth = np.minimum((np.asarray(haze)[..., None] / down / FOCAL) ** np.asarray(power)[..., None], 50)
    seen = np.where(below > 0, np.exp(-depth), 0)
    sky = [up**term for term in range(4)]
    return np.stack([*sky, seen, seen * _mirror(down), seen * down], axis=1)


def _mirror(below: Float64) -> Float64:
    """How much more sky water mirrors at so many focal lengths below the horizon."""
    return schlick(below / np.sqrt(1 + below * below))


def _prior(level: float) -> Float64:
    """What the terms are likely to be (P, P), as rows of the least squares below the profile's."""
    prior = np.zeros((TERMS, TERMS))
    prior[0, 0] = 1e-3
    for term, sigma in enumerate(SKY_TERMS, start=1):
        prior[term, term] = 1 / (sigma * level)
    prior[4, [0, 4]] = np.array([DARK, 1]) / (DARK_SIGMA * level)
    prior[5, [4, 5]] = np.array([MIRROR, 1]) / (MIRROR_SIGMA * level)
    prior[6, 6] = 1 / (SLOPE_SIGMA * level)
    prior[1:] *= PRIOR_NOISE
    return prior


def flat_nats(profiles: Float32) -> Float64:
    """Minus log likelihood (S,) of profiles (S, N, 3) without a horizon: a cubic through each channel."""
    strips, count = profiles.shape[:2]
    q, _ = np.linalg.qr(np.vander(np.linspace(-1, 1, count), 4))
    levels = profiles.transpose(1, 0, 2).reshape(count, -1).astype(np.float64)
    residual = np.maximum((levels * levels).sum(axis=0) - np.square(q.T @ levels).sum(axis=0), 0)
    mean = residual.reshape(strips, 3).sum(axis=1) / (3 * count)
    return np.asarray(1.5 * INDEPENDENT_ROWS * np.log(mean + NOISE**2))


def _judge(
    fine: LineScan, profiles: Float32, x: Float64, unit: float, width: int, height: int, rough: bool
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
        return NoHorizon(reason or "the place of the horizon is too uncertain")
    return Horizon(width, float(row * scale - 0.5), float(sigma), slope, float(SIGMA_TIMES * slope_sigma))


def _moments(values: Float64, probability: Float64) -> tuple[float, float]:
    mean = float(probability @ values)
    return mean, float(np.sqrt(probability @ (values - mean) ** 2))


def _judge_parts(profiles: Float32, line: Float64, unit: float, rough: bool) -> str:
    """Why what lies above and below a line (S,) of rows is no sky over water; empty where it is."""
    count = profiles.shape[1]
    prior = _prior(_level(profiles))
    parts = []  # of each strip: residual of the sky, of the water, contrast
    for profile, row in zip(profiles, line, strict=True):
        if not 4 <= row <= count - 4:
            continue
        design = _design(np.full(len(HAZE), row), count, unit, HAZE, POWER).transpose(0, 2, 1)
        levels = np.concatenate([profile, np.zeros((TERMS, 3), np.float32)])
        q, _ = np.linalg.qr(np.concatenate([design, np.broadcast_to(prior, (len(design), TERMS, TERMS))], axis=1))
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
    """A level near the airlight's, that the priors are shares of; in steps, so that pictures alike share a model."""
    level = max(40.0, float(np.percentile(profiles.mean(axis=2), 80)))
    return float(LEVEL_STEP ** round(np.log(level) / np.log(LEVEL_STEP)))
