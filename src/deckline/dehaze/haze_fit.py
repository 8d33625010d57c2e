"""Airlight and extinction of one image, from how the sea fades into the haze towards the horizon.

The pose gives the range of the sea in every pixel. In the band above the horizon the air is endless and shows the
airlight A alone. Below it the water at range r shows A + (S - A) exp(-tau(r)), where S is the sea without haze, which
mirrors more of the sky at grazing angles. tau = beta r, or beta r + (k beta r)^4 where the air thickens with range.
Source: Koschmieder's law; Schlick's (1 - sin)^5 for the mirroring water.
"""

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from deckline.dehaze.base import linear_step
from deckline.dehaze.filters import mean_channel
from deckline.dehaze.sea_view import EARTH_RADIUS_M, SeaView
from deckline.haze import CONTRAST_THRESHOLD
from deckline.types import Value

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
Image = NDArray[np.uint8] | Float32

AIRLIGHT_BAND_RAD = 0.026  # 1.5 degrees of sky above the horizon
MIN_BAND_PX = 100  # of that band in view
MIN_AIRLIGHT = 25.0  # of 0..255; darker is night
BEYOND_GAP_RAD, FAR_SEA_RAD = 0.0025, 0.02  # off the horizon that is not looked at; of sea below it that is compared
BEYOND_CELLS = (5, 50)  # rows of angle above the horizon, columns
MIN_CELL_PX, MIN_CELLS, MIN_COLUMNS = 3, 40, 12
SEA_LEVELS = 8.0  # around the far sea's median; other columns show an object before the horizon
TEXTURE = 3.0  # levels that a quarter of the cells differ by from a smooth sky; 2.0 at most in 277 views of haze
FADING = 13.0  # levels from the horizon up to the end of the band; 10.6 at most in these
MIN_CONTRAST = 8.0  # between the nearest sea and the airlight, levels
MAX_RANGE_M = 5000.0  # of sea that is fitted; farther, clear air itself hides it
ENDLESS_M = 1e6  # tau of 100 and more in any haze
BINS = 40  # of equal ratio in range
MIN_BIN_PX = 60
MAX_BIN_PX = 500  # that are read, evenly chosen
MIN_BINS = 8
QUANTILES = (0.3, 0.5)  # of a bin's levels, between which the mean is taken; foam is bright and on the other side
QUANTILES_BELOW = 0.2562  # sigmas of normal noise that this mean lies below the median
BETAS_PER_M = np.geomspace(1e-4, 3e-2, 80)  # visibility 39 km to 130 m
FOG_LAYER_K = np.array([0.0, 0.5, 0.7, 0.85, 1.0, 1.2, 1.5, 2.0])  # k of the term for air that thickens with range
BANK_PENALTY = 10.0  # what that term must gain, in squared sigmas
DARKER_SIGMA = 0.1  # of A: grazing water mirrors more sky and is hardly darker; fits at a misplaced horizon make it so
LEVEL_SIGMA = 1.0  # of a bin's quantile from the law, levels; beyond twice that a bin's weight falls
NEAR_LEVELS = 4.0  # between a bin and the law that explains it
MIN_EXPLAINED = 0.6  # of the bins; seen on preset paper: 0.75 and more with a sea, 0.4 and less with a deck for a sea
MIN_FAR_SEA = -0.05  # of the airlight: no water is darker than black; a deck for a sea makes it -0.1 and less
SIDES_FROM = 0.56  # of the way from the middle column to the outermost
MAX_RELATIVE_SIGMA = 0.5  # of the extinction; vaguer fits are not used
END_BINS = 3  # of a profile, the nearest and the farthest
BRIGHTENING = (0.1, 0.2)  # of the sea over the last factor of two in range, as a share of all: in haze, in clear air
FAR_LEVEL = (0.85, 0.95)  # of the farthest sea, as a share of the brightest detail: a deck, or haze
BRIGHTEST = 99.5  # percentile that counts as the brightest detail
STEPS = 8  # of reweighting
CORRELATED_BINS = 4.0  # neighbouring bins err alike: one in so many is independent


# Prior of a sea without haze: tuned on both training sets of preset paper, checked on FlightGear's sea.
DARK, DARK_SIGMA = 0.75, 0.07  # of the airlight: how far water seen from straight above is below it
MIRROR, MIRROR_SIGMA = 0.6, 0.45  # share of `DARK` that mirrored sky adds back at grazing angles


@dataclass(frozen=True, eq=False)
class HazeFit:
    """Air and sea of one image, in levels 0..255."""

    airlight: Float64
    """(3,) A."""
    beta_per_m: float
    """Extinction coefficient, 1/m."""
    beta_sigma_per_m: float
    """1-sigma of the fit, without errors of the law itself."""
    bank_per_m: float
    """k beta of the fourth-power term, 1/m; 0: air of one density."""
    sea: Float64
    """(2, 3) S - A from straight above, and what grazing angles add to it."""

    def optical_depth(self, range_m: Float32 | np.float32) -> Float32:
        """tau of ray lengths, m; endless ones count as ENDLESS_M."""
        reach = np.minimum(range_m, np.float32(ENDLESS_M))
        even = np.asarray(np.float32(self.beta_per_m) * reach)
        return even if self.bank_per_m == 0 else even + np.square(np.square(np.float32(self.bank_per_m) * reach))

    @property
    def visibility_m(self) -> float:
        """Range at which 2 % of a contrast are left: where the optical depth reaches that of Koschmieder's law."""
        least = -np.log(CONTRAST_THRESHOLD)
        if self.bank_per_m == 0:
            return float(least / self.beta_per_m)
        depth = np.poly1d([self.bank_per_m**4, 0.0, 0.0, self.beta_per_m, -least])
        return float(brentq(depth, 0.0, least / self.beta_per_m))

    @property
    def visibility(self) -> Value:
        """`visibility_m` with the fit's 1-sigma, without errors of the law itself."""
        return Value(self.visibility_m, self.visibility_m * self.beta_sigma_per_m / self.beta_per_m)

    def clear_sea(self, down: Float32) -> Float32:
        """The sea without haze (3, H, W) at sines of the angle below the horizontal (H, W)."""
        straight, grazing = np.stack([self.airlight + self.sea[0], self.sea[1]]).astype(np.float32)[..., None, None]
        return np.clip(straight + schlick(down) * grazing, 0, 255)


class NoFit(StrEnum):
    """Why an image's haze cannot be fitted; the value is the message for people."""

    NO_POSE = "the frame has no pose; give poses or choose another dehazer"
    SEA_ABOVE_DECK = "the sea is above the deck"
    BELOW_SEA = "the camera is below the sea"
    NO_HORIZON = "the horizon is not in view"
    DARK = "too dark to see the haze"
    LITTLE_SEA = "too little sea in view"
    NO_CONTRAST = "the sea does not differ from the haze"
    VAGUE = "the sea does not show how thick the haze is"
    FAR_SEEN = "a coast or clouds show just above the horizon: the air is clear, or the pose is wrong"
    NO_FADING = "what lies below the horizon does not fade as a sea in haze does"


@dataclass(frozen=True, eq=False)
class NotFitted:
    """An image whose haze could not be fitted."""

    cause: NoFit
    """Why."""
    detail: str = ""
    """Numbers to it, for people."""
    hidden: float = 0.0
    """Certainty that haze hides the farthest sea nevertheless, 0 to 1."""
    down: Float32 | None = None
    """(h, w) sines of the angle below the horizontal; None without a pose."""

    @property
    def reason(self) -> str:
        """The cause with its detail, for people."""
        return f"{self.cause}: {self.detail}" if self.detail else str(self.cause)


@dataclass(frozen=True, eq=False)
class SeaProfile:
    """The sea by range, near to far."""

    range_m: Float64
    """(N,) ray lengths."""
    down: Float64
    """(N,) sines of the angle below the horizontal."""
    levels: Float64
    """(N, 3)."""


def fit_haze(image: Image, view: SeaView, noise_sigma: float = 0.0) -> HazeFit | NotFitted:
    """Airlight, extinction and sea colour of an image, or why they cannot be fitted.

    Where what lies below the horizon does not fade as a sea does, the sides of the image are tried: a deck just ahead
    hides the sea in its middle.

    Args:
        image: (H, W, 3) levels 0..255.
        noise_sigma: 1-sigma of a pixel's noise, levels; it shifts the quantile below the median.
    """
    airlight = _band_airlight(image, view)
    if airlight is None:
        return NotFitted(NoFit.NO_HORIZON)
    if airlight.max() < MIN_AIRLIGHT:
        return NotFitted(NoFit.DARK)
    if sees_beyond_horizon(image, view):
        return NotFitted(NoFit.FAR_SEEN)
    sides = np.arange(view.down.shape[1])
    sides = sides[np.abs(sides - sides.mean()) > SIDES_FROM * len(sides) / 2]
    for columns in (slice(None), sides):
        part = SeaView(view.down[:, columns], view.range_m[:, columns], view.height_m)
        profile = measure_profile(image[:, columns], part)
        profile = replace(profile, levels=profile.levels + QUANTILES_BELOW * noise_sigma)
        if len(profile.range_m) < MIN_BINS:
            return NotFitted(NoFit.LITTLE_SEA)
        if np.abs(profile.levels - airlight).max() < MIN_CONTRAST:
            return NotFitted(NoFit.NO_CONTRAST)
        fit = _fit_profile(profile, airlight)
        far_sea = (airlight + fit.sea.sum(axis=0)).min() / airlight.mean()
        if far_sea >= MIN_FAR_SEA and explained_share(fit, profile) >= MIN_EXPLAINED:
            vague = fit.beta_sigma_per_m > MAX_RELATIVE_SIGMA * fit.beta_per_m
            return NotFitted(NoFit.VAGUE) if vague else fit
    return NotFitted(NoFit.NO_FADING)


def explained_share(fit: HazeFit, profile: SeaProfile) -> float:
    """Share of a profile's bins that the law comes near to."""
    t = np.exp(-fit.optical_depth(profile.range_m.astype(np.float32)))
    sea = fit.sea[0] + schlick(profile.down)[:, None] * fit.sea[1]
    residual = np.linalg.norm(profile.levels - fit.airlight - t[:, None] * sea, axis=1)
    return float(np.mean(residual < NEAR_LEVELS))


def _band_airlight(image: Image, view: SeaView) -> Float64 | None:
    """Median colour (3,) of the sky just above the horizon; None when there is too little of it."""
    band = ~view.is_sea & (view.down > -AIRLIGHT_BAND_RAD)
    return np.median(image[band], axis=0) if np.count_nonzero(band) >= MIN_BAND_PX else None


def sees_beyond_horizon(image: Image, view: SeaView) -> bool:
    """Whether an image (H, W, 3) of levels shows a coast or clouds just above the sea's horizon.

    Haze hides them: along a ray so flat the air is endless. Columns without a plain sea below are left out, as what
    stands there may be a near ship.
    """
    rows, columns = BEYOND_CELLS
    near = np.flatnonzero((np.abs(view.down) < AIRLIGHT_BAND_RAD).any(axis=1))
    if not len(near):
        return False
    part = np.s_[near[0] : near[-1] + 1]
    image, view = image[part], SeaView(view.down[part], view.range_m[part], view.height_m)
    grey = mean_channel(np.asarray(image, np.float32))
    column = np.broadcast_to(np.arange(grey.shape[1]) * columns // grey.shape[1], grey.shape)
    sea = view.is_sea & (view.down > BEYOND_GAP_RAD) & (view.down < FAR_SEA_RAD)
    sky = ~view.is_sea & (view.down < -BEYOND_GAP_RAD) & (view.down > -AIRLIGHT_BAND_RAD)
    far_sea, counts = _means_of(grey[sea], column[sea], columns)
    shown = counts > MIN_CELL_PX
    if np.count_nonzero(shown) < MIN_COLUMNS:
        return False
    plain = shown & (np.abs(far_sea - np.median(far_sea[shown])) < SEA_LEVELS)
    row = np.minimum(view.down[sky] * (-rows / AIRLIGHT_BAND_RAD), rows - 1).astype(np.intp)
    levels, counts = _means_of(grey[sky], row * columns + column[sky], rows * columns)
    cells = np.flatnonzero((counts >= MIN_CELL_PX) & np.tile(plain, rows))
    if len(cells) < MIN_CELLS:
        return False
    up, across = cells // columns / (rows - 1), cells % columns / (columns - 1) - 0.5
    smooth = np.stack([np.ones_like(up), up, across, across * across], axis=1)
    weights = np.ones(len(cells))
    for _ in range(STEPS):
        weighted = (smooth * weights[:, None]).T
        surface = np.linalg.lstsq(weighted @ smooth, weighted @ levels[cells], rcond=None)[0]
        off = np.abs(levels[cells] - smooth @ surface)
        weights = 1 / (1 + np.square(off / (2 * LEVEL_SIGMA)))
    return bool(np.percentile(off, 75) > TEXTURE or abs(surface[1]) > FADING)


def _means_of(levels: Float32, which: NDArray[np.integer], count: int) -> tuple[Float64, NDArray[np.intp]]:
    """Means (count,) of levels (N,) in groups (N,), and how many they are."""
    counts = np.bincount(which, minlength=count)
    return np.bincount(which, levels, minlength=count) / np.maximum(counts, 1), counts


def measure_profile(image: Image, view: SeaView) -> SeaProfile:
    """Quantiles of the sea's levels in bins of range up to MAX_RANGE_M; bins with few pixels are left out."""
    near = view.range_m < MAX_RANGE_M
    ranges, levels = view.range_m[near], image[near]
    if ranges.size == 0:
        return SeaProfile(np.zeros(0), np.zeros(0), np.zeros((0, 3)))
    ratio = np.log(ranges * np.float32(1 / ranges.min()))
    which = np.minimum(ratio * np.float32(BINS / np.log(MAX_RANGE_M / ranges.min())), BINS - 1).astype(np.uint8)
    groups = np.split(np.argsort(which, kind="stable"), np.cumsum(np.bincount(which, minlength=BINS))[:-1])
    groups = [group[:: 1 + len(group) // MAX_BIN_PX] for group in groups if len(group) >= MIN_BIN_PX]
    middle = np.array([np.partition(ranges[group], len(group) // 2)[len(group) // 2] for group in groups], np.float64)
    return SeaProfile(
        middle,
        view.height_m / middle + middle / (2 * EARTH_RADIUS_M),  # as in `view_sea`
        np.array([_mean_between_quantiles(levels[group]) for group in groups]).reshape(-1, 3),
    )


def hidden_sea_certainty(image: Image, view: SeaView) -> float:
    """How surely haze hides the farthest sea of an image (H, W, 3), 0 to 1, the horizon in view or not.

    Such a sea brightens no more with range, and nothing in the image is much brighter. A clear sea brightens up to the
    horizon, as it mirrors more and more of the sky.
    """
    profile = measure_profile(image, view)
    if len(profile.range_m) < MIN_BINS:
        return 0.0
    levels, ranges = profile.levels.mean(axis=1), np.log(profile.range_m)
    near, far = levels[:END_BINS].mean(), levels[-END_BINS:].mean()
    brightening = (far - np.interp(ranges[-1] - np.log(2), ranges, levels)) / max(far - near, MIN_CONTRAST)
    brightest = np.percentile(image.mean(axis=2), BRIGHTEST)
    return (1 - linear_step(brightening, *BRIGHTENING)) * linear_step(far / max(brightest, 1), *FAR_LEVEL)


def _mean_between_quantiles(levels: NDArray) -> Float64:
    """Mean (3,) of levels (N, 3) between two quantiles: unlike one quantile, it changes by less than a whole level."""
    low, high = (int(share * len(levels)) for share in QUANTILES)
    return np.asarray(np.sort(levels, axis=0)[low : max(high, low + 1)].mean(axis=0, dtype=np.float64))


def _fit_profile(profile: SeaProfile, airlight: Float64) -> HazeFit:
    """The law through a profile: every extinction of a grid, with the best sea colour for each.

    The extinction is the posterior mean: the best of the grid would jump from one value to the next between frames.
    """
    beta, bank = (grid.ravel() for grid in np.meshgrid(BETAS_PER_M, FOG_LAYER_K, indexing="ij"))
    _, cost = _solve_sea_colours(profile, airlight, beta, bank)
    best = int(cost.argmin())
    likelihood = np.exp(-(cost - cost[best]) / (2 * CORRELATED_BINS))
    sigma = float(np.sqrt(np.average((beta - np.average(beta, weights=likelihood)) ** 2, weights=likelihood)))
    alike = bank == bank[best]
    weights = likelihood[alike] ** CORRELATED_BINS
    mean = np.exp(np.average(np.log(beta[alike]), weights=weights, keepdims=True))
    sea, _ = _solve_sea_colours(profile, airlight, mean, bank[best : best + 1])
    return HazeFit(airlight, float(mean[0]), sigma, float(bank[best] * mean[0]), sea[0])


def _solve_sea_colours(profile: SeaProfile, airlight: Float64, beta: Float64, bank: Float64) -> tuple[Float64, Float64]:
    """The best sea colour (T, 2, 3) for each of T extinctions, 1/m, and banks, and its cost (T,).

    The sea's colour is linear in the law: iteratively reweighted least squares (Cauchy) with the water's prior, without
    which bright distant water and haze look alike.
    """
    contrast, mirroring = (profile.levels - airlight).astype(np.float32), schlick(profile.down).astype(np.float32)
    depth = (beta[:, None] * profile.range_m).astype(np.float32)
    t = np.exp(-depth - np.square(np.square(bank[:, None].astype(np.float32) * depth)))
    rows, usual = prior_equations(airlight)
    prior, prior_side = rows.T @ rows, rows.T @ usual
    powers = np.stack([np.ones_like(mirroring), mirroring, np.square(mirroring)], axis=1)
    sides = np.concatenate([contrast, mirroring[:, None] * contrast], axis=1)
    weights = np.full_like(t, 1 / LEVEL_SIGMA**2)
    for _ in range(STEPS):
        weighted = weights * t
        p, q, r = ((weighted * t) @ powers + prior[[0, 0, 1], [0, 1, 1]]).T[..., None]
        first, second = np.split(weighted @ sides + prior_side.ravel(), 2, axis=1)
        sea = np.stack([r * first - q * second, p * second - q * first], axis=1) / (p * r - q * q)[:, None]
        squares = _squared_residuals(contrast, mirroring, t, sea.astype(np.float32)) / np.float32(LEVEL_SIGMA**2)
        weights = 1 / (np.float32(LEVEL_SIGMA**2) * (1 + squares / 4))
    unusual = ((rows @ sea - usual) ** 2).sum(axis=(1, 2))
    darker = np.minimum(sea[:, 1].mean(axis=1), 0) / (DARKER_SIGMA * airlight.mean())
    return sea, 4 * np.log1p(squares / 4).sum(axis=1) + unusual + darker**2 + BANK_PENALTY * (bank > 0)


def _squared_residuals(contrast: Float32, mirroring: Float32, t: Float32, sea: Float32) -> Float32:
    """Squares (T, N), added up over colours, of a contrast (N, 3) less the law's, for each of T sea colours."""
    total = np.zeros_like(t)
    for k in range(3):
        residual = sea[:, 1:, k] * mirroring
        residual += sea[:, :1, k]
        residual *= t
        residual -= contrast[:, k]
        total += np.square(residual, out=residual)
    return total


def prior_equations(airlight: Float64) -> tuple[Float64, Float64]:
    """The water's prior as equations of a sea's colour (2, 3), each in its sigmas: rows (2, 2) @ sea = usual (2, 3)."""
    level = airlight.mean()
    mirror = np.array([MIRROR, 1.0]) / (MIRROR_SIGMA * DARK * level)
    dark = np.array([1.0, 0.0]) / (DARK_SIGMA * level)
    return np.stack([mirror, dark]), np.stack([np.zeros(3), -DARK / DARK_SIGMA * airlight / level])


def schlick(down: NDArray) -> NDArray:
    rest = 1 - np.clip(down, 0, 1)
    return np.square(np.square(rest)) * rest  # numpy's own fifth power takes ten times as long
