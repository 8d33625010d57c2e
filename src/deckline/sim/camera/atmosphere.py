"""Draws the air of a frame: which model, how thick, how high, how patchy, how coloured."""

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deckline.haze import Atmosphere, Triple, Wave, beta_from_visibility

Model = Literal["paper", "physical"]
PHYSICAL_SHARE = 0.5  # of the frames of preset train
WAVELENGTH_NM = np.array([610.0, 550.0, 465.0])  # middles of red, green and blue; visibility is quoted for green
HAZE_FROM_M = 1000.0  # visibility from which drops are small enough to colour the light; below it is fog
SCALE_HEIGHT_M = 1000.0  # of haze in the marine boundary layer
PATCH_WAVES = 5
MOST_COLOUR = 0.4  # deviation from grey, as a share, of drawn thick air: drops scatter all colours nearly alike
TINT = 0.04  # 1-sigma of the airlight's colour, from cold to warm
LEAST_PATCH_M = 1.0  # banks are far longer; shorter waves than a pixel only cost time
LEAST_SCALE_HEIGHT_M = 40.0  # no shallower bank is drawn; far above one, single precision would run out
OF_PHYSICAL = ("scale_height_m", "patchiness", "patch_m", "angstrom", "glow")  # what the paper's model does not know
# Carbonneau's rain attenuation, ITU-R P.1814: 1.076 R^0.67 dB/km, R in mm/h.
RAIN_DB_PER_KM, RAIN_EXPONENT = 1.076, 0.67
DB_PER_NEPER = 10.0 / math.log(10.0)


@dataclass(frozen=True)
class AirConfig:
    """The air; None: drawn widely for preset `train`, the stated default for the others.

    Args:
        model: `paper`: I = J t + A (1 - t) on 8-bit levels with one extinction; `physical`: in linear light, before
            exposure, with what follows, all of which needs it; default `paper`.
        scale_height_m: the extinction falls by e with each of these heights, at least 40; infinite: uniform air;
            default 1000.
        patchiness: 0 even, up to 0.9: banks of haze; default 0.
        patch_m: their wavelength, at least 1; default 400.
        angstrom: exponent of the extinction's fall with wavelength: 0 grey fog, 1.3 bluish haze; default 0.
        glow: how much brighter thick air is at the sun, as a share; default 1.

    Raises:
        ValueError: an unknown model, a number out of its range, or one that the paper's model does not know.
    """

    model: Model | None = None
    scale_height_m: float | None = None
    patchiness: float | None = None
    patch_m: float | None = None
    angstrom: float | None = None
    glow: float | None = None

    def __post_init__(self) -> None:
        if self.model is not None and self.model not in get_args(Model):
            raise ValueError(f"model must be one of {get_args(Model)}, got {self.model!r}")
        if self.scale_height_m is not None and not self.scale_height_m >= LEAST_SCALE_HEIGHT_M:
            raise ValueError(f"scale_height_m must be at least {LEAST_SCALE_HEIGHT_M:g}, got {self.scale_height_m}")
        if self.patch_m is not None and not self.patch_m >= LEAST_PATCH_M:
            raise ValueError(f"patch_m must be at least {LEAST_PATCH_M:g}, got {self.patch_m}")
        for name, high in (("patchiness", 0.9), ("angstrom", 4.0), ("glow", 20.0)):
            value = getattr(self, name)
            if value is not None and not 0 <= value <= high:
                raise ValueError(f"{name} must lie between 0 and {high}, got {value}")
        if self.model == "paper":
            self.refuse_physical("model is paper")

    def refuse_physical(self, why: str) -> None:
        """Refuse what the paper's model does not know.

        Args:
            why: what makes it the paper's model, for the message.

        Raises:
            ValueError: something of the physical model is given.
        """
        given = [name for name in OF_PHYSICAL if getattr(self, name) is not None]
        if given:
            raise ValueError(f"air: only model physical knows {', '.join(given)}, and {why}: set model to physical")


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
    drawn = _drawn(visibility_m, rng)
    values = drawn if wide else {"scale_height_m": SCALE_HEIGHT_M, "patchiness": 0.0, "patch_m": 400.0}
    values = {"angstrom": 0.0, "glow": 1.0} | values
    values |= {name: given for name in values if (given := getattr(config, name)) is not None}
    waves = draw_waves(values["patchiness"], values["patch_m"], rng)
    airlight = thick_air(np.asarray(horizon, dtype=np.float64), rng, wide)
    haze = 0.0 if math.isinf(visibility_m) else beta_from_visibility(visibility_m)
    extinction = haze * (WAVELENGTH_NM / WAVELENGTH_NM[1]) ** -values["angstrom"] + rain_extinction(rain_mm_h)
    return Atmosphere(
        extinction_per_m=_triple(extinction),
        airlight=_triple(airlight),
        base_z_m=float(sea_z_m),
        scale_height_m=values["scale_height_m"],
        glow=values["glow"],
        sun=_triple(np.asarray(sun, dtype=np.float64)),
        waves=waves,
    )


def _drawn(visibility_m: float, rng: np.random.Generator) -> dict[str, float]:
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


def thick_air(horizon: NDArray[np.float64], rng: np.random.Generator, wide: bool) -> NDArray[np.float64]:
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


def _triple(values: NDArray[np.float64]) -> Triple:
    first, second, third = values.tolist()
    return first, second, third
