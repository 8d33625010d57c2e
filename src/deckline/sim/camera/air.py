"""Draws the air of a frame: which model, how thick, how high, how patchy, how coloured."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deckline.haze import Atmosphere, Triple, Wave, beta_from_visibility
from deckline.sim.camera.config import AirConfig, Model

PHYSICAL_SHARE = 0.5  # of the frames of preset train
WAVELENGTH_NM = np.array([610.0, 550.0, 465.0])  # middles of red, green and blue; visibility is quoted for green
HAZE_FROM_M = 1000.0  # visibility from which drops are small enough to colour the light; below it is fog
SCALE_HEIGHT_M = 1000.0  # of haze in the marine boundary layer
PATCH_WAVES = 5
MOST_COLOUR = 0.4  # deviation from grey, as a share, of drawn thick air: drops scatter all colours nearly alike
TINT = 0.04  # 1-sigma of the airlight's colour, from cold to warm
# Carbonneau's rain attenuation, ITU-R P.1814: 1.076 R^0.67 dB/km, R in mm/h.
RAIN_DB_PER_KM, RAIN_EXPONENT = 1.076, 0.67
DB_PER_NEPER = 10.0 / math.log(10.0)


def draw_model(config: AirConfig, rng: np.random.Generator, wide: bool) -> Model:
    """Which model a frame has."""
    physical = rng.random() < PHYSICAL_SHARE
    if config.model is not None:
        return config.model
    return "physical" if wide and physical else "paper"


def rain_extinction(rain_mm_h: float) -> float:
    """Extinction, 1/m, of rain. Source: Carbonneau's model in ITU-R P.1814."""
    return RAIN_DB_PER_KM * rain_mm_h**RAIN_EXPONENT / DB_PER_NEPER / 1000.0


def draw_air(
    config: AirConfig,
    visibility_m: float,
    rain_mm_h: float,
    horizon: ArrayLike,
    sun: ArrayLike,
    sea_z_m: float,
    rng: np.random.Generator,
    wide: bool,
) -> Atmosphere:
    """Air of the physical model.

    Args:
        visibility_m: 2 % contrast at the water, without the rain; infinite is clear.
        horizon: (3,) linear light of the clear sky at the horizon.
        sun: (3,) unit vector from the sun to the ground, world.
        sea_z_m: world z of the water.
        wide: draw what the configuration leaves open, as for preset train.
    """
    drawn = _draw_open_values(visibility_m, rng)
    values = drawn if wide else {"scale_height_m": SCALE_HEIGHT_M, "patchiness": 0.0, "patch_m": 400.0}
    values = {"angstrom": 0.0, "glow": 1.0} | values
    values |= {name: given for name in values if (given := getattr(config, name)) is not None}
    waves = draw_waves(values["patchiness"], values["patch_m"], rng)
    airlight = draw_airlight(np.asarray(horizon, dtype=np.float64), rng, wide)
    haze = 0.0 if math.isinf(visibility_m) else beta_from_visibility(visibility_m)
    extinction = haze * (WAVELENGTH_NM / WAVELENGTH_NM[1]) ** -values["angstrom"] + rain_extinction(rain_mm_h)
    return Atmosphere(
        extinction_per_m=triple(extinction),
        airlight=triple(airlight),
        base_z_m=float(sea_z_m),
        scale_height_m=values["scale_height_m"],
        glow=values["glow"],
        sun=triple(sun),
        waves=waves,
    )


def _draw_open_values(visibility_m: float, rng: np.random.Generator) -> dict[str, float]:
    kinds = rng.random(4)
    height = float(np.exp(rng.uniform(np.log(40.0), np.log(3000.0))))
    patchiness, patch = rng.uniform(0.1, 0.9), np.exp(rng.uniform(np.log(100.0), np.log(2000.0)))
    angstrom, glow = rng.uniform(0.0, 1.3), rng.exponential(1.0)
    return {
        "scale_height_m": height if kinds[0] < 0.6 else math.inf,
        "patchiness": float(patchiness) if kinds[1] < 0.5 else 0.0,
        "patch_m": float(patch),
        "angstrom": float(angstrom) if visibility_m > HAZE_FROM_M else 0.0,
        "glow": float(min(glow, 5.0)) if kinds[2] < 0.6 else 0.0,
    }


def draw_waves(patchiness: float, patch_m: float, rng: np.random.Generator) -> tuple[Wave, ...]:
    """Plane waves of random heading and phase about a wavelength, whose amplitudes add up to `patchiness`."""
    heading, phase = rng.uniform(0, 2 * np.pi, (2, PATCH_WAVES))
    number = 2 * np.pi / (patch_m * np.exp(rng.uniform(-0.7, 0.7, PATCH_WAVES)))
    share = rng.uniform(0.5, 1.0, PATCH_WAVES)
    amplitude = patchiness * share / share.sum()
    if patchiness == 0:
        return ()
    waves = np.column_stack([number * np.cos(heading), number * np.sin(heading), phase, amplitude])
    return tuple((kx, ky, start, size) for kx, ky, start, size in waves.tolist())


def draw_airlight(horizon: NDArray[np.float64], rng: np.random.Generator, wide: bool) -> NDArray[np.float64]:
    """Linear light (3,) of thick air under a sky with this horizon: the same within a few per cent, or if `wide`
    greyer, tinted or darker.

    Source: Koschmieder's law, in which the airlight is the light of the sky at the horizon.
    """
    (warmth, green), mixed = rng.normal(size=2), rng.uniform(0.0, 1.0)
    thick, darkness, brightness = rng.random() < 0.25, rng.uniform(0.3, 0.75), rng.uniform(0.75, 1.2)
    tint = np.exp(TINT * np.array([warmth, 0.4 * green, -warmth]))
    if not wide:
        return np.asarray(horizon * tint)
    grey = horizon.mean()
    colour = horizon - grey
    paled = min(1.0, MOST_COLOUR * grey / max(float(np.abs(colour).max()), 1e-9))
    air = grey + colour * paled * mixed
    return np.asarray(air * tint * (darkness if thick else brightness))


def triple(values: ArrayLike) -> Triple:
    """Three numbers as plain floats."""
    first, second, third = np.asarray(values, dtype=np.float64).tolist()
    return first, second, third
