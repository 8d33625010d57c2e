"""Everything around the ship in one frame: light, sky, sea or ground.

Colours are linear light or reflectance; light 1 is what a white horizontal surface in full daylight sends.
"""

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from deckline.haze import triple
from deckline_sim.config import Sky, TimeOfDay, WeatherConfig
from deckline_sim.scene.waves import STATE_HEIGHT_M, Waves, waves_from, wind_from_height
from deckline_sim.ship.mesh import Rgb

ELEVATION_DEG: dict[TimeOfDay, tuple[float, float]] = {"day": (12.0, 75.0), "dusk": (1.5, 12.0), "night": (12.0, 60.0)}
DUSK_DEG = 12.0  # a sun below this makes dusk
TIME_SHARES = (0.80, 0.12, 0.08)  # of day, dusk and night in training
SKY_SHARES = (0.40, 0.32, 0.28)  # of clear, broken and overcast skies in training
FAIR_CLEAR = 0.6  # part of the fair days without clouds
SUN_SET = 0.35  # part of the dusks after sunset
OPTICAL_DEPTH = np.array([0.08, 0.13, 0.23])  # of clear air overhead, red green blue: Rayleigh and thin haze
WARM, COOL = np.array([1.0, 0.62, 0.36]), np.array([0.62, 0.8, 1.0])
FAIR_STATES, ALL_STATES = (1, 4), (0, 6)  # lowest and highest sea state that is drawn
PLAIN_SEA = 0.2  # part of the training seas with hardly a wave, as simple renderers have them
LAND_RGB = np.array(
    [[0.30, 0.36, 0.18], [0.42, 0.44, 0.24], [0.45, 0.38, 0.28], [0.62, 0.55, 0.42], [0.20, 0.27, 0.15]]
)  # grass, crops, earth, sand and woods, as a display shows them
RIPPLE_RATIO = 9.0  # waves over ripples, in length
OPEN = WeatherConfig()  # everything is drawn


@dataclass(frozen=True)
class Daylight:
    """Sun or moon, sky and clouds in one frame; directions are world NED."""

    sun: tuple[float, float, float]  # from the sun (at night the moon) to the ground
    sun_rgb: Rgb  # what a white surface that faces it sends
    ambient_rgb: Rgb  # what a white horizontal surface sends of the sky's light
    horizon_rgb: Rgb  # radiance of the sky at the horizon, away from the sun
    zenith_rgb: Rgb
    sky_curve: float  # small: the horizon's colour is a narrow band
    sun_glow: float  # around the sun
    glow_rgb: Rgb
    sun_disc: float
    cloud_rgb: Rgb
    cloud_shade: float  # how much darker their undersides are, 0..1
    cloud_cover: float  # 0 none, 1 closed
    cloud_scale: float
    cloud_soft: float
    shadow: float  # how dark shadows are, 0..1: some renderers have none
    flood_rgb: Rgb  # what a white surface sends of the ship's flood lights
    lamps: float  # brightness of a deck lamp of strength 1; 0 by day


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
    rng: np.random.Generator, fair: bool = False, config: WeatherConfig = OPEN, sun: NDArray[np.float64] | None = None
) -> Weather:
    """From bright sun to moonlight, from a calm sea to waves of 5 m; `fair`: a day with few clouds.

    Args:
        rng: draws all that is not configured.
        fair: weather of the named presets.
        config: fixed values.
        sun: (3,) from the sun to the ground, world, of the ship's shadows; None: drawn. Without a configured
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
    ground, field = (LAND_RGB[rng.integers(len(LAND_RGB))] * rng.uniform(0.8, 1.2) for _ in range(2))
    return {"ground_rgb": _rgb(ground), "field_rgb": _rgb(field), "field_m": rng.uniform(60.0, 400.0)}


def random_time_of_day(rng: np.random.Generator, fair: bool = False) -> TimeOfDay:
    """Mostly day; a fair one always."""
    times: tuple[TimeOfDay, ...] = ("day", "dusk", "night")
    drawn = times[rng.choice(3, p=TIME_SHARES)]
    return "day" if fair else drawn


def sun_direction(rng: np.random.Generator, time_of_day: TimeOfDay = "day") -> NDArray[np.float64]:
    """Unit vector (3,) from the sun, at night from the moon, to the ground, world NED."""
    azimuth, elevation = rng.uniform(-np.pi, np.pi), np.deg2rad(rng.uniform(*ELEVATION_DEG[time_of_day]))
    return np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])


def random_sky(rng: np.random.Generator, fair: bool) -> Sky:
    """Clear, broken or overcast; fair days are not overcast."""
    skies: tuple[Sky, ...] = ("clear", "broken", "overcast")
    drawn = skies[rng.choice(3, p=SKY_SHARES)]
    fair_sky: Sky = "clear" if rng.random() < FAIR_CLEAR else "broken"
    return fair_sky if fair else drawn


def random_daylight(
    rng: np.random.Generator, time_of_day: TimeOfDay, sky: Sky, sun: NDArray[np.float64], fair: bool
) -> Daylight:
    """Light of a time and a sky under a sun (3,): from true to life to the saturated colours of games."""
    horizon, zenith, ambient, beam = _colours(rng, time_of_day, sky, float(sun[2]))
    saturation = rng.uniform(0.95, 1.3) if fair else rng.uniform(0.8, 1.9)
    horizon, zenith, ambient = (
        rgb.mean() * np.clip(1.0 + saturation * (rgb / rgb.mean() - 1.0), 0.05, None)
        for rgb in (horizon, zenith, ambient)
    )
    hidden = sky == "overcast"
    level = float(horizon.mean())
    dark = {"day": 0.0, "dusk": 0.35, "night": 1.0}[time_of_day]
    lamp = np.array([1.0, rng.uniform(0.75, 1.0), rng.uniform(0.5, 1.0)])
    cover = {"clear": 0.0, "broken": rng.uniform(0.25, 0.4 if fair else 0.7), "overcast": rng.uniform(0.7, 1.0)}[sky]
    lit = level * (rng.uniform(0.9, 1.2) if hidden else rng.uniform(1.1, 1.9))
    warm = np.array([1.0, 0.75, 0.6]) if time_of_day == "dusk" and not hidden else 1.0
    return Daylight(
        sun=triple(sun),
        sun_rgb=_rgb(beam),
        ambient_rgb=_rgb(ambient),
        horizon_rgb=_rgb(horizon),
        zenith_rgb=_rgb(zenith),
        sky_curve=float(np.exp(rng.uniform(np.log(0.06), np.log(0.8)))),
        sun_glow=0.0 if hidden else rng.uniform(0.1, 1.0),
        glow_rgb=_rgb(level * (np.array([1.3, 0.8, 0.5]) if time_of_day == "dusk" else np.array([1.0, 0.97, 0.9]))),
        sun_disc=0.0 if hidden else 30.0 if time_of_day == "day" else 8.0,
        cloud_rgb=_rgb(lit * warm * np.array([1.0, 1.0, 1.02])),
        cloud_shade=rng.uniform(0.05, 0.3) if hidden else rng.uniform(0.15, 0.8),
        cloud_cover=cover,
        cloud_scale=float(np.exp(rng.uniform(np.log(0.03), np.log(0.25)))),
        cloud_soft=rng.uniform(0.04, 0.22) if sky == "broken" else rng.uniform(0.15, 0.4),
        shadow=1.0 if fair or rng.random() < 0.75 else rng.uniform(0.0, 0.7),
        flood_rgb=_rgb(dark * np.exp(rng.uniform(np.log(0.3), np.log(6.0))) * level * lamp),
        lamps=float(dark * rng.uniform(5.0, 50.0) * level),
    )


def _colours(
    rng: np.random.Generator, time_of_day: TimeOfDay, sky: Sky, sun_up: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Horizon, zenith, light of the sky, light of the sun; each (3,)."""
    beam = np.exp(-OPTICAL_DEPTH * rng.uniform(0.6, 1.6) / max(sun_up, 0.06)) * rng.uniform(0.75, 1.1)
    blue = np.array([rng.uniform(0.3, 0.55), rng.uniform(0.6, 0.75), 1.0])
    level = 0.3 + 0.7 * np.sqrt(sun_up)
    red = rng.uniform(0.55, 0.97)
    horizon = rng.uniform(0.4, 0.75) * level * np.array([red, (1.0 + red) / 2 + rng.uniform(-0.02, 0.05), 1.0])
    zenith = rng.uniform(0.16, 0.45) * level * blue
    ambient = rng.uniform(0.12, 0.3) * level * np.array([0.8, 0.92, 1.1])
    if time_of_day == "dusk":
        fall = rng.uniform(0.25, 0.9)
        warmth = WARM * rng.uniform(0.0, 1.0) + COOL * rng.uniform(0.15, 0.7)
        horizon = 0.45 * fall * warmth / warmth.max()
        zenith, ambient = zenith * fall * 0.5, ambient * fall * 1.4
        beam = beam * (0.0 if rng.random() < SUN_SET else fall)
    elif time_of_day == "night":
        fall = np.exp(rng.uniform(np.log(0.0008), np.log(0.008)))
        horizon, zenith = fall * COOL * rng.uniform(0.8, 1.2, 3), fall * rng.uniform(0.3, 0.8) * COOL
        ambient, beam = fall * COOL * rng.uniform(0.4, 1.0), fall * COOL * rng.uniform(0.0, 1.0)
    if sky == "overcast":
        grey = ambient.mean() + 0.35 * beam.mean() * sun_up
        tint = 1.0 + rng.uniform(-0.06, 0.06) * np.array([-1.0, 0.0, 1.0])
        ambient = grey * rng.uniform(0.8, 1.6) * tint
        horizon, zenith = ambient * rng.uniform(0.6, 1.1), ambient * rng.uniform(0.6, 1.2)
        beam = beam * rng.uniform(0.0, 0.06)
    elif sky == "broken" and rng.random() < 0.25:  # the sun behind a cloud
        beam, ambient = beam * rng.uniform(0.05, 0.4), ambient * 1.3
    return horizon, zenith, ambient, beam


def _rgb(colour: NDArray[np.float64]) -> Rgb:
    return triple(np.maximum(colour, 0.0))
