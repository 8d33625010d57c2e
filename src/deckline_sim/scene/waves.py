"""A sea by its state: how high the waves are, how long, how steep, how much of it is white, and one tile of it."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

G_M_S2 = 9.81
# Significant wave height of sea states 0..6, m: middle of each range of WMO code table 3700.
STATE_HEIGHT_M = (0.0, 0.05, 0.3, 0.875, 1.875, 3.25, 5.0)
# Pierson and Moskowitz 1964, fully developed sea: height = 0.21 U^2 / g, peak at omega = 0.877 g / U.
PM_HEIGHT, PM_PEAK = 0.21, 0.877
PHILLIPS = 0.0081  # their constant: the slopes' variance gains PHILLIPS / 2 for every factor e of wave number
COX_MUNK = (0.003, 0.00512)  # 1954: all slopes' variance is the first plus the second times the wind in m/s
MONAHAN = (3.84e-6, 3.41)  # Monahan and O'Muircheartaigh 1980: foam covers the first times U to the second
TILE_TEXELS = 512
TILE_WAVES = 8.0  # peak wavelengths along one side of a tile
SPAN = 4.0  # a tile holds slopes and heights up to this many root mean squares
FOAM_BLUR_WAVES = 0.06  # size of the smallest patch of foam, of the peak wavelength


@dataclass(frozen=True)
class Waves:
    """One sea in numbers."""

    height_m: float  # significant
    length_m: float  # at the spectrum's peak
    wave_slope: float  # root mean square over the waves of one tile
    ripple_slope: float  # the same over the next shorter ones
    roughness: float  # the same over what is too short to be drawn
    foam: float  # part of the surface that is white, 0..1


def wind_from_height(height_m: float) -> float:
    """Wind, m/s, that raises a fully developed sea of a significant height."""
    return float(np.sqrt(height_m * G_M_S2 / PM_HEIGHT))


def peak_length_m(wind_m_s: float) -> float:
    """Wavelength at the peak of the Pierson-Moskowitz spectrum in deep water."""
    return 2.0 * np.pi * wind_m_s**2 / (PM_PEAK**2 * G_M_S2)


def phase_speed_m_s(length_m: float) -> float:
    """Deep-water dispersion."""
    return float(np.sqrt(G_M_S2 * length_m / (2.0 * np.pi)))


def whitecap_cover(wind_m_s: float) -> float:
    """Part of the sea under foam, 0..1."""
    return float(min(MONAHAN[0] * wind_m_s ** MONAHAN[1], 1.0))


def waves_from(height_m: float, wind_m_s: float, ripple_ratio: float) -> Waves:
    """The sea of a significant height under a wind; ripples are drawn `ripple_ratio` times shorter than the waves.

    Source: spectrum by Pierson and Moskowitz for the long waves, all slopes together by Cox and Munk.
    """
    length = max(peak_length_m(wind_from_height(height_m)), 3.0)
    octaves = np.log(TILE_TEXELS / (2.0 * TILE_WAVES))
    steepness = min(height_m / 0.3, 1.0)  # a sea below state 2 is not developed
    waves = PHILLIPS / 2 * octaves * steepness
    ripples = PHILLIPS / 2 * np.log(ripple_ratio) * min(wind_m_s / 5.0, 1.0)
    rest = max(COX_MUNK[0] + COX_MUNK[1] * wind_m_s - waves - ripples, 0.003)
    return Waves(
        height_m, float(length), float(np.sqrt(waves)), float(np.sqrt(ripples)), float(np.sqrt(rest)),
        whitecap_cover(wind_m_s),
    )  # fmt: skip


@cache
def wave_tile(size: int = TILE_TEXELS) -> NDArray[np.uint8]:
    """Tile (size, size, 4) of a sea that runs along its columns' axis: slope along, slope across, height, foam.

    Slopes and height are in root mean squares, 0 to 255 for -SPAN to SPAN; foam is the rank 0..255 of each point, so
    that a share w of the sea lies above 255 (1 - w): the crests' lee sides.

    Source: Pierson-Moskowitz in wave numbers with a cosine-squared spread of directions.
    """
    rng = np.random.default_rng(20240615)
    number = np.fft.fftfreq(size) * size / TILE_WAVES  # of the peak's
    along, across = np.meshgrid(number, number)
    k = np.hypot(along, across)
    k[0, 0] = np.inf
    spread = np.where(along > 0, (along / k) ** 2, 0.08 * (across / k) ** 2)
    density = k**-4 * np.exp(-1.25 * k**-2) * spread  # per area of wave numbers
    noise = np.fft.fft2(rng.standard_normal((size, size)))
    surface = noise * np.sqrt(density)
    height, down, cross = (np.fft.ifft2(surface * factor).real for factor in (1.0, 1j * along, 1j * across))
    slope_scale = np.sqrt(down.var() + cross.var())
    height, down, cross = height / height.std(), down / slope_scale, cross / slope_scale
    blur = np.exp(-0.5 * (2 * np.pi * FOAM_BLUR_WAVES * np.where(np.isinf(k), 0.0, k)) ** 2)
    patch = np.fft.ifft2(np.fft.fft2(rng.standard_normal((size, size))) * blur).real
    crest = height - 1.5 * down + 0.8 * patch / patch.std()
    rank = np.empty(size * size)
    rank[np.argsort(crest, axis=None)] = np.linspace(0.0, 255.0, size * size)
    fields = [127.5 * (1.0 + field / SPAN) for field in (down, cross, height)]
    return np.clip(np.rint(np.stack([*fields, rank.reshape(size, size)], axis=-1)), 0, 255).astype(np.uint8)
