"""What a camera makes of linear light: exposure, white balance, vignetting, blur, tone, noise and JPEG."""

from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from deckline.haze import Triple
from deckline_sim.config import SensorConfig, Tone

LUMINANCE = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)  # ITU-R BT.709
TARGET = 0.27  # what automatic exposure makes of a picture's metered light; level 0.55 of a plain display
GAIN_LIMITS = (0.02, 120.0)  # of automatic exposure: nights stay dark
CORNER_TAN = np.tan(np.deg2rad(30.0))  # vignetting 1 is cos^4 of a lens that sees its corners 30 degrees off axis
BLUR_REACH = 3.0  # sigmas
DISPLAY_GAMMA = 2.2  # a plain display's level is light to the power of one over this
STEPS = 16384  # of a table, equally spaced in the square root of light, where levels lie nearly evenly
FILMIC = (2.51, 0.03, 2.43, 0.59, 0.14)  # Narkowicz 2015, "ACES filmic tone mapping curve": a, b, c, d, e
WHITE = {"gamma": 1.0, "srgb": 1.0, "filmic": 7.24}  # light from which on a curve shows full white

# A curve is (tone, gamma, contrast, black): gamma is an exponent on the level, contrast bends it about its middle,
# black is the level that no light has.
Curve = tuple[Tone, float, float, float]


@dataclass(frozen=True)
class Sensor:
    """One camera's settings in one frame: plain numbers, recorded with it."""

    gain: Triple = (1.0, 1.0, 1.0)
    """Exposure and white balance on linear light: red, green, blue."""
    tone: Tone = "gamma"
    """Tone curve."""
    gamma: float = 1.0
    """Exponent on the level."""
    contrast: float = 0.0
    """-1..1, bends levels about their middle."""
    black: float = 0.0
    """Level 0..1 without light."""
    saturation: float = 1.0
    """0 grey, 1 unchanged."""
    vignetting: float = 0.0
    """0 none; 1 falls to 56 % in the corners."""
    blur_px: float = 0.0
    """1-sigma of the lens' blur, px."""
    noise: float = 0.0
    """1-sigma of read-out noise, 8-bit levels."""
    electrons: float = 0.0
    """Full well at gain 1, electrons, for shot noise; 0: none."""
    pattern: float = 0.0
    """1-sigma of each row's and each column's fixed offset, 8-bit levels."""
    pattern_seed: int = 0
    """Seed of the fixed pattern."""
    jpeg_quality: int = 0
    """1..100; 0: no JPEG."""

    @property
    def curve(self) -> Curve:
        return self.tone, self.gamma, self.contrast, self.black


def meter(radiance: NDArray[np.float32]) -> float:
    """Light of a picture (H, W, 3) as automatic exposure sees it: the mean of its display levels, as light."""
    light = np.maximum(radiance @ LUMINANCE, 0.0)
    return float(np.mean(light ** (1 / DISPLAY_GAMMA)) ** DISPLAY_GAMMA)


def draw_sensor(config: SensorConfig, strength: float, scene_level: float, rng: np.random.Generator) -> Sensor:
    """Settings that stray by `strength` (0: not at all, 1: as far as training wants).

    Args:
        scene_level: the light, as `meter` gives it, that automatic exposure goes by.
    """
    automatic = (TARGET / max(scene_level, 1e-6)) ** rng.uniform(0.75, 1.0)
    stops, warmth, green = strength * rng.normal(0.0, [0.7, 0.1, 0.03])
    stops = stops if config.exposure_ev is None else config.exposure_ev
    exposure = float(np.clip(automatic, *GAIN_LIMITS)) * 2.0**stops
    balance = np.exp([warmth, green, -warmth]) if config.white_balance is None else np.asarray(config.white_balance)
    red, green, blue = (float(gain) for gain in exposure * balance)
    sensor = Sensor(gain=(red, green, blue), **_draw_strays(strength, rng))
    given = {item.name: getattr(config, item.name) for item in fields(config)}
    for name in ("exposure_ev", "white_balance"):
        del given[name]
    return replace(sensor, **{name: value for name, value in given.items() if value is not None})


def _draw_strays(strength: float, rng: np.random.Generator) -> dict[str, Any]:
    """Everything but the gain. Draws as many random numbers whatever the strength."""
    kinds, wide = rng.random(6), strength >= 1.0
    tone: Tone = "filmic" if kinds[0] < 0.3 else "srgb" if kinds[0] < 0.55 else "gamma"
    noise, blur = strength * rng.gamma(1.5, 1.4), rng.uniform(0.3, 1.1)
    electrons = np.exp(rng.uniform(np.log(1e3), np.log(3e4))) / max(strength, 1e-3) ** 2
    values: dict[str, Any] = {
        "gamma": float(np.exp(rng.normal(0.0, 0.12 * strength))),
        "contrast": float(np.clip(rng.normal(0.0, 0.3 * strength), -0.6, 0.6)),
        "saturation": float(np.exp(rng.normal(0.0, 0.2 * strength))),
        "blur_px": float(blur) if kinds[1] < 0.4 * strength else 0.0,
        "noise": float(noise),
        "electrons": float(electrons) if strength > 0 else 0.0,
    }
    black, vignetting, pattern = rng.uniform(0.0, 0.08), rng.uniform(0.1, 1.0), rng.gamma(1.0, 0.4)
    quality, seed = int(rng.integers(25, 98)), int(rng.integers(2**31))
    if wide:
        values |= {"tone": tone, "black": float(black) * (kinds[2] < 0.3)}
        values |= {"vignetting": float(vignetting) * (kinds[3] < 0.4), "pattern_seed": seed}
        values |= {"pattern": float(pattern) * (kinds[5] < 0.25)}
        values |= {"jpeg_quality": quality if kinds[4] < 0.4 else 0}
    return values


def develop(radiance: NDArray[np.float32], sensor: Sensor) -> NDArray[np.uint8]:
    """Image (H, W, 3) of linear light: vignetting, exposure, white balance, blur, saturation and tone; no noise."""
    levels = tone_table(sensor.curve)
    scale = np.asarray(sensor.gain, np.float32) / np.float32(WHITE[sensor.tone])
    light = radiance * scale
    if sensor.vignetting > 0:
        light *= falloff(radiance.shape[0], radiance.shape[1], sensor.vignetting)
    if sensor.blur_px > 0:
        light = blur(light, sensor.blur_px)
    if sensor.saturation != 1.0:
        grey = (light @ LUMINANCE)[..., None]
        light *= np.float32(sensor.saturation)
        light += np.float32(1.0 - sensor.saturation) * grey
    np.clip(light, 0.0, 1.0, out=light)
    np.sqrt(light, out=light)
    light *= np.float32(STEPS - 1)
    light += np.float32(0.5)
    return levels[light.astype(np.uint16)]


@lru_cache(maxsize=8)
def falloff(height: int, width: int, vignetting: float) -> NDArray[np.float32]:
    """Share of the light (H, W, 1) that a lens with vignetting lets through: cos^4 of the angle off the axis."""
    v, u = np.arange(height) - (height - 1) / 2, np.arange(width) - (width - 1) / 2
    r2 = (u**2 + v[:, None] ** 2) / ((height / 2) ** 2 + (width / 2) ** 2) * CORNER_TAN**2
    return (1.0 - vignetting * (1.0 - 1.0 / (1.0 + r2) ** 2)).astype(np.float32)[..., None]


def blur(light: NDArray[np.float32], sigma_px: float) -> NDArray[np.float32]:
    """Gaussian blur of a picture (H, W, 3), its border repeated."""
    reach = int(np.ceil(BLUR_REACH * sigma_px))
    bell = np.exp(-0.5 * (np.arange(reach + 1) / sigma_px) ** 2)
    weights = (bell / (2 * bell.sum() - bell[0])).astype(np.float32)
    out: NDArray[Any] = light
    for axis in (0, 1):
        length = out.shape[axis]
        pads = [(reach, reach) if a == axis else (0, 0) for a in range(3)]
        padded = np.moveaxis(np.pad(out, pads, mode="edge"), axis, 0)
        summed: NDArray[Any] = np.multiply(padded[reach : reach + length], weights[0])
        for k in range(1, reach + 1):
            both = padded[reach - k : reach - k + length] + padded[reach + k : reach + k + length]
            both *= weights[k]
            summed += both
        out = np.moveaxis(summed, 0, axis)
    return np.ascontiguousarray(out)


def noise_sigma(sensor: Sensor) -> NDArray[np.float32]:
    """1-sigma (256,), 8-bit steps, of a pixel at each level: read-out noise, and shot noise through the tone curve."""
    if sensor.electrons == 0:
        return np.full(256, sensor.noise, dtype=np.float32)
    light = light_of_levels(sensor.curve).astype(np.float64)
    step = 1e-3 + 0.01 * light
    low = np.maximum(light - step, 0.0)
    slope = 255.0 * (tone_level(light + step, sensor.curve) - tone_level(low, sensor.curve)) / (light + step - low)
    held = sensor.electrons / np.sqrt(max(sensor.gain[1], 1.0))  # half the stops come from the shutter and the iris
    return np.sqrt(sensor.noise**2 + slope**2 * light / held).astype(np.float32)


def add_noise(rgb: NDArray[np.uint8], sensor: Sensor, rng: np.random.Generator) -> NDArray[np.uint8]:
    """Shot and read-out noise and the sensor's fixed pattern on an image (H, W, 3)."""
    if sensor.noise == 0 and sensor.electrons == 0 and sensor.pattern == 0:
        return rgb
    noisy = rng.standard_normal(rgb.shape, dtype=np.float32)
    noisy *= noise_sigma(sensor)[rgb]
    noisy += rgb
    if sensor.pattern > 0:
        fixed = np.random.default_rng(sensor.pattern_seed)
        height, width = rgb.shape[:2]
        columns, rows = fixed.standard_normal((1, width, 1)), fixed.standard_normal((height, 1, 1))
        noisy += (sensor.pattern * (rows + columns)).astype(np.float32)
    np.rint(noisy, out=noisy)
    return np.clip(noisy, 0, 255, out=noisy).astype(np.uint8)


def jpeg(rgb: NDArray[np.uint8], quality: int) -> NDArray[np.uint8]:
    """The image (H, W, 3) after JPEG at a quality 1..100."""
    _, coded = cv2.imencode(".jpg", rgb[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
    decoded = np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR), dtype=np.uint8)
    return np.ascontiguousarray(decoded[..., ::-1])


def finish(rgb: NDArray[np.uint8], sensor: Sensor, rng: np.random.Generator) -> NDArray[np.uint8]:
    """The recorded image of a developed one: noise, then JPEG if the sensor compresses."""
    noisy = add_noise(rgb, sensor, rng)
    return jpeg(noisy, sensor.jpeg_quality) if sensor.jpeg_quality else noisy


def tone_level(light: NDArray[np.float64], curve: Curve) -> NDArray[np.float64]:
    """Level 0..1 of exposed linear light, 1 being white of the plain curves."""
    tone, gamma, contrast, black = curve
    x = np.clip(light, 0.0, WHITE[tone])
    if tone == "srgb":  # IEC 61966-2-1
        level = np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 0.0031308) ** (1 / 2.4) - 0.055)
    else:
        if tone == "filmic":
            a, b, c, d, e = FILMIC
            x = np.clip(x * (a * x + b) / (x * (c * x + d) + e), 0.0, 1.0)
        level = x ** (1.0 / DISPLAY_GAMMA)
    level = level**gamma
    level = level + contrast * level * (1 - level) * (2 * level - 1)
    return black + (1 - black) * level


@lru_cache(maxsize=64)
def tone_table(curve: Curve) -> NDArray[np.uint8]:
    """8-bit level of `STEPS` amounts of light, 0 to WHITE, equally spaced in their square root."""
    return np.rint(255.0 * tone_level(_light(curve), curve)).astype(np.uint8)


@lru_cache(maxsize=64)
def light_of_levels(curve: Curve) -> NDArray[np.float32]:
    """Light (256,) that a curve shows as each level; levels out of its reach get its darkest or brightest."""
    light = _light(curve)
    return np.interp(np.arange(256) / 255.0, tone_level(light, curve), light).astype(np.float32)


def _light(curve: Curve) -> NDArray[np.float64]:
    return WHITE[curve[0]] * np.linspace(0.0, 1.0, STEPS) ** 2
