"""Light, sky and sea. Colours are what a display shows, 0..1."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deckline.sim.mesh import Rgb


@dataclass(frozen=True)
class Weather:
    """Everything around the ship in one frame; directions are world NED."""

    sun_rgb: Rgb  # light on a surface that faces the sun
    ambient_rgb: Rgb  # light from the sky
    horizon_rgb: Rgb
    zenith_rgb: Rgb
    cloud_rgb: Rgb
    cloud_cover: float  # 0 none, 1 closed
    cloud_scale: float
    sun_glow: float
    sea_rgb: Rgb
    sea_sheen: float  # how much sky the sea mirrors
    wave_slope: float
    wave_scale: float  # 1: waves of 10 m
    whitecaps: float  # 0..1
    glint: float
    fade_m: float  # distance where the sea melts into the horizon
    wake: float  # opacity
    wake_length_m: float
    wake_spread: float  # half width gained per metre
    wake_rgb: Rgb
    wet: float  # how much sky the deck mirrors
    offset: tuple[float, float]  # of all noise


def sun_direction(rng: np.random.Generator) -> NDArray[np.float64]:
    """Unit vector (3,) from the sun to the ground, world NED."""
    azimuth, elevation = rng.uniform(-np.pi, np.pi), np.deg2rad(rng.uniform(8.0, 75.0))
    return np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])


def random_weather(rng: np.random.Generator, fair: bool = False) -> Weather:
    """From bright sun to overcast and dusk, from calm dark water to whitecaps; `fair` keeps to days with few clouds."""
    overcast = rng.random() < 0.35 and not fair
    dusk = rng.random() < 0.12 and not fair
    level = rng.uniform(0.3, 0.5) if dusk else rng.uniform(0.75 if fair else 0.6, 0.95)
    red = rng.uniform(0.72, 1.02)
    bright = np.array([red, (red + 1.0) / 2 + rng.uniform(-0.02, 0.04), 1.0])
    horizon = level * (np.array([1.0, 0.85, 0.75]) if dusk and not overcast else bright)
    zenith = horizon * (rng.uniform(0.7, 1.05) if overcast else np.array([0.45, 0.65, 0.95]) * rng.uniform(0.7, 1.1))
    sun = 0.12 if overcast else rng.uniform(0.35, 1.0) * (0.5 if dusk else 1.0)
    sun_rgb = sun * np.array([1.0, rng.uniform(0.88, 1.0), rng.uniform(0.75, 0.98)])
    ambient = (0.4 + 0.7 * level) * rng.uniform(0.75, 1.15) * np.array([0.95, 0.98, 1.04])
    sea = rng.uniform(0.04, 0.32) * level
    sea_rgb = sea * np.array([rng.uniform(0.25, 0.9), rng.uniform(0.7, 1.1), rng.uniform(0.8, 1.3)])
    foam = rng.uniform(0.55, 1.0) * level * np.array([rng.uniform(0.75, 1.0), rng.uniform(0.9, 1.0), 1.0])
    offset = rng.uniform(0, 50, 2)
    return Weather(
        sun_rgb=_rgb(sun_rgb),
        ambient_rgb=_rgb(ambient),
        horizon_rgb=_rgb(horizon),
        zenith_rgb=_rgb(zenith),
        cloud_rgb=_rgb(level * rng.uniform(0.75, 1.15) * np.ones(3)),
        cloud_cover=rng.uniform(0.6, 1.0) if overcast else rng.uniform(0.0, 0.3 if fair else 0.7),
        cloud_scale=rng.uniform(0.03, 0.3),
        sun_glow=0.0 if overcast else rng.uniform(0.0, 0.8),
        sea_rgb=_rgb(sea_rgb),
        sea_sheen=rng.uniform(0.1, 0.9),
        wave_slope=rng.uniform(0.05, 0.5),
        wave_scale=rng.uniform(0.5, 3.0),
        whitecaps=max(0.0, rng.uniform(-0.5, 1.0)),
        glint=0.0 if overcast else rng.uniform(0.0, 1.2),
        fade_m=float(np.exp(rng.uniform(np.log(1500.0), np.log(40000.0)))),
        wake=rng.uniform(0.3, 1.0) if rng.random() < 0.8 else 0.0,
        wake_length_m=rng.uniform(150.0, 1500.0),
        wake_spread=rng.uniform(0.02, 0.25),
        wake_rgb=_rgb(foam),
        wet=max(0.0, rng.uniform(-0.3, 0.5)),
        offset=(float(offset[0]), float(offset[1])),
    )


def random_airlight(horizon_rgb: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """Colour of thick haze (3,) in 0..255: near the horizon's (3,) in 0..1, greyer, sometimes tinted or darker."""
    horizon = np.minimum(horizon_rgb, 1.0)
    grey = np.full(3, horizon.mean())
    mixed = grey + (horizon - grey) * rng.uniform(0.0, 1.2)
    tint = 1.0 + rng.normal(0.0, 0.03, 3)
    darker = rng.uniform(0.55, 0.85) if rng.random() < 0.25 else rng.uniform(0.85, 1.1)
    return np.clip(255.0 * mixed * tint * darker, 40.0, 250.0)


def horizon_airlight(horizon_rgb: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """Colour of thick haze (3,) in 0..255 lit by the same sky: the horizon's (3,) in 0..255, within a few per cent.

    Source: Koschmieder's law, in which the airlight is the radiance of the sky at the horizon.
    """
    return np.clip(horizon_rgb * (1.0 + rng.normal(0.0, 0.02, 3)), 0.0, 255.0)


def _rgb(colour: NDArray[np.float64]) -> Rgb:
    red, green, blue = np.clip(colour, 0.0, 1.2)
    return float(red), float(green), float(blue)
