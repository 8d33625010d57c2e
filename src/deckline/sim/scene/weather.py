"""Everything around the ship in one frame: light, sky, sea or ground. Colours are linear light or reflectance."""

from dataclasses import asdict, dataclass
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from deckline.sim.scene.daylight import (
    DUSK_DEG,
    Daylight,
    Sky,
    TimeOfDay,
    random_daylight,
    random_sky,
    random_time_of_day,
    sun_direction,
)
from deckline.sim.scene.waves import STATE_HEIGHT_M, Waves, waves_from, wind_from_height
from deckline.sim.ship.mesh import Rgb

__all__ = ["Weather", "WeatherConfig", "random_weather", "sun_direction"]

FAIR_STATES, ALL_STATES = (1, 4), (0, 6)  # lowest and highest sea state that is drawn
PLAIN_SEA = 0.2  # part of the training seas with hardly a wave, as simple renderers have them
LAND_RGB = np.array(
    [[0.30, 0.36, 0.18], [0.42, 0.44, 0.24], [0.45, 0.38, 0.28], [0.62, 0.55, 0.42], [0.20, 0.27, 0.15]]
)  # grass, crops, earth, sand and woods, as a display shows them
RIPPLE_RATIO = 9.0  # waves over ripples, in length


@dataclass(frozen=True)
class WeatherConfig:
    """What the weather shall be; None: as the preset has it, drawn widely for preset train, fair for the others.

    Args:
        time_of_day: `day`, `dusk` or `night`; None: mostly day in training, always day in the named presets.
        sky: `clear`, `broken` or `overcast`; None: any in training, not overcast in the named presets.
        sea_state: 0 (glassy) to 6 (waves of 5 m); None: 0 to 6 in training, 1 to 4 in the named presets.
        wind_m_s: at 10 m above the water; None: about what raises the sea.
        seed: what the preset leaves open is drawn from this number, the same for every frame and recording that has it;
            None: from the recording's own seed.

    Raises:
        ValueError: an unknown time or sky, or a number out of its range.
    """

    time_of_day: TimeOfDay | None = None
    sky: Sky | None = None
    sea_state: int | None = None
    wind_m_s: float | None = None
    seed: int | None = None

    def __post_init__(self) -> None:
        for name, kinds in (("time_of_day", TimeOfDay), ("sky", Sky)):
            value = getattr(self, name)
            if value is not None and value not in get_args(kinds):
                raise ValueError(f"{name} must be one of {get_args(kinds)} or None, got {value!r}")
        if self.sea_state is not None and not 0 <= self.sea_state <= 6:
            raise ValueError(f"sea_state must lie between 0 and 6, got {self.sea_state}")
        if self.wind_m_s is not None and not 0.0 <= self.wind_m_s <= 40.0:
            raise ValueError(f"wind_m_s must lie between 0 and 40, got {self.wind_m_s}")
        if self.seed is not None and self.seed < 0:
            raise ValueError(f"the weather's seed must not be negative, got {self.seed}")


@dataclass(frozen=True)
class Weather(Daylight):
    """Light, sky, sea and ground of one frame; plain numbers only."""

    sea_state: int
    wave_height_m: float  # significant
    wind_m_s: float
    wind_rad: float  # where the wind blows to, from north over east
    wave_length_m: float  # at the spectrum's peak
    wave_slope: float  # root mean square of the long waves, the next shorter ones, the swell and the undrawn rest
    ripple_slope: float
    swell_slope: float
    roughness: float
    swell_length_m: float
    gusts: float  # contrast of wind patches
    sea_rgb: Rgb  # what the water itself sends back, linear reflectance
    sea_sheen: float  # how much of the mirrored sky is seen
    glint: float  # of the sun; 1: as on a real sea
    whitecaps: float  # part of the sea under foam
    streaks: float  # of foam along the wind
    foam_rgb: Rgb  # linear reflectance
    fade_m: float  # the distance at which 1/e of the sea's contrast is left before the horizon
    wake: float  # opacity
    wake_length_m: float
    wake_spread: float  # half width gained per metre
    wake_hard: float  # 0: soft edges, 1: cut out
    wake_rgb: Rgb  # linear reflectance
    wet: float  # how much sky the deck mirrors
    ground_rgb: Rgb  # of land, as a display shows it in daylight
    field_rgb: Rgb
    field_m: float
    offset: tuple[float, float]  # of all noise


def random_weather(
    rng: np.random.Generator,
    fair: bool = False,
    config: WeatherConfig = WeatherConfig(),
    sun: NDArray[np.float64] | None = None,
) -> Weather:
    """From bright sun to moonlight, from glass to a sea of 5 m; `fair` keeps to days with few clouds.

    Args:
        rng: where everything not configured comes from.
        fair: as the named presets have it.
        config: what is not to be drawn.
        sun: (3,) from the sun to the ground, world, as the ship's shadows have it; None draws one. Without a configured
            time of day a low sun makes dusk.
    """
    time = config.time_of_day
    if time is None:
        low = sun is not None and sun[2] < np.sin(np.deg2rad(DUSK_DEG)) - 1e-9
        time = random_time_of_day(rng, fair) if sun is None else "dusk" if low else "day"
    sun = sun_direction(rng, time) if sun is None else sun
    sky = random_sky(rng, fair)
    light = random_daylight(rng, time, config.sky or sky, sun, fair)
    low_state, high_state = FAIR_STATES if fair else ALL_STATES
    drawn_state = int(rng.integers(low_state, high_state + 1))
    state = drawn_state if config.sea_state is None else config.sea_state
    height = STATE_HEIGHT_M[state] * rng.uniform(0.75, 1.25)
    usual_wind = (1.0 + wind_from_height(height)) * rng.uniform(0.8, 1.15)
    wind = usual_wind if config.wind_m_s is None else config.wind_m_s
    plain = rng.random() < PLAIN_SEA and not fair
    values = asdict(light) | _waves(rng, waves_from(height, wind, RIPPLE_RATIO), plain)
    values |= _water(rng, plain, fair) | _wake(rng) | _land(rng)
    offset = rng.uniform(0, 50, 2)
    return Weather(
        **values,
        sea_state=state,
        wind_m_s=float(wind),
        wind_rad=float(rng.uniform(-np.pi, np.pi)),
        fade_m=float(np.exp(rng.uniform(np.log(6000.0 if fair else 2500.0), np.log(60000.0)))),
        wet=max(0.0, rng.uniform(-0.5, 0.3 if fair else 0.9)),
        offset=(float(offset[0]), float(offset[1])),
    )


def _waves(rng: np.random.Generator, waves: Waves, plain: bool) -> dict[str, float]:
    gain = rng.uniform(0.0, 0.3) if plain else rng.uniform(0.6, 1.3)
    foam = 0.0 if plain else waves.foam * np.exp(rng.normal(0.0, 0.4))
    return {
        "wave_height_m": waves.height_m,
        "wave_length_m": waves.length_m * rng.uniform(0.7, 1.3),
        "wave_slope": gain * waves.wave_slope,
        "ripple_slope": gain * waves.ripple_slope * rng.uniform(0.5, 1.2),
        "swell_slope": gain * rng.uniform(0.0, 0.05),
        "swell_length_m": rng.uniform(80.0, 250.0),
        "roughness": waves.roughness * rng.uniform(0.6, 1.2),
        "gusts": rng.uniform(0.2, 1.2),
        "whitecaps": float(foam),
        "streaks": float(np.clip((waves.foam - 0.01) * 6.0, 0.0, 0.35)) * (not plain),
    }


def _water(rng: np.random.Generator, plain: bool, fair: bool) -> dict[str, float | Rgb]:
    """From navy and green-black to turquoise and grey."""
    deep = rng.uniform(0.008, 0.05) if rng.random() < 0.75 or fair else rng.uniform(0.05, 0.13)
    hue = rng.beta(0.9, 1.6)
    tint = np.array([0.15, 0.45, 1.0]) * (1.0 - hue) + np.array([0.25, 1.0, 0.9]) * hue
    grey = rng.uniform(0.0, 0.6) * (rng.random() < 0.5)
    colour = deep * (tint * (1.0 - grey) + grey * 0.7)
    foam = rng.uniform(0.45, 0.85) * np.array([rng.uniform(0.85, 1.0), rng.uniform(0.95, 1.0), 1.0])
    return {
        "sea_rgb": _rgb(colour),
        "sea_sheen": rng.uniform(0.05, 0.6) if plain else rng.uniform(0.4, 1.0),
        "glint": 0.0 if plain and rng.random() < 0.7 else rng.uniform(0.1, 0.8),
        "foam_rgb": _rgb(foam),
    }


def _wake(rng: np.random.Generator) -> dict[str, float | Rgb]:
    """From none over a churned band to a white fan."""
    seen, hard = rng.random() < 0.85, rng.random() < 0.25
    colour = rng.uniform(0.3, 0.85) * np.array([rng.uniform(0.75, 1.0), rng.uniform(0.9, 1.0), 1.0])
    return {
        "wake": rng.uniform(0.35, 1.0) if seen else 0.0,
        "wake_length_m": float(np.exp(rng.uniform(np.log(80.0), np.log(900.0)))),
        "wake_spread": rng.uniform(0.01, 0.2),
        "wake_hard": rng.uniform(0.7, 1.0) if hard else rng.uniform(0.0, 0.5),
        "wake_rgb": _rgb(colour),
    }


def _land(rng: np.random.Generator) -> dict[str, float | Rgb]:
    """Grass, crops, earth and sand."""
    ground, field = (LAND_RGB[rng.integers(len(LAND_RGB))] * rng.uniform(0.8, 1.2) for _ in range(2))
    return {"ground_rgb": _rgb(ground), "field_rgb": _rgb(field), "field_m": rng.uniform(60.0, 400.0)}


def _rgb(colour: NDArray[np.float64]) -> Rgb:
    red, green, blue = np.maximum(colour, 0.0)
    return float(red), float(green), float(blue)
