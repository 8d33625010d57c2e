"""Atmospheric scattering: I = J t + A (1 - t), t = exp(-beta d), d the ray length in metres.

`add_haze` is the paper's model, on 8-bit levels. `scatter` is the same model in linear light, of air that may be denser
near the water, patchy, coloured, and brighter towards the sun.
Source: Koschmieder's law. Visibility is quoted at 2 % contrast: V = 3.912 / beta.
"""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deckline.checks import check_numbers

Triple = tuple[float, float, float]
Wave = tuple[float, float, float, float]
MAX_FALL = 60.0  # scale heights; its exponential is a float32, and patches end at 100 km
CONTRAST_THRESHOLD = 0.02  # Koschmieder's 2 %; the meteorological optical range uses 5 %


def triple(values: ArrayLike) -> Triple:
    """Three numbers as plain floats."""
    first, second, third = np.asarray(values, dtype=np.float64).tolist()
    return first, second, third


def beta_from_visibility(visibility_m: float) -> float:
    """Extinction coefficient, 1/m. Infinite visibility gives 0."""
    if not visibility_m > 0:
        raise ValueError(f"visibility must be positive metres, got {visibility_m}")
    return float(-np.log(CONTRAST_THRESHOLD) / visibility_m)


def visibility_from_beta(beta_per_m: float) -> float:
    """Visibility, m, of an extinction coefficient. Zero extinction gives infinity."""
    if beta_per_m < 0:
        raise ValueError(f"extinction must not be negative, got {beta_per_m} 1/m")
    return float("inf") if beta_per_m == 0 else float(-np.log(CONTRAST_THRESHOLD) / beta_per_m)


def transmission(range_m: ArrayLike, beta_per_m: float) -> NDArray[np.float32]:
    """exp(-beta range) for ray lengths in metres; unknown (NaN) and infinite ranges transmit nothing."""
    ranges = np.nan_to_num(np.asarray(range_m, dtype=np.float32), nan=np.inf, posinf=np.inf)
    if beta_per_m == 0:
        return np.ones_like(ranges)
    return np.exp(-np.float32(beta_per_m) * ranges)


def blend_airlight(scene: NDArray[Any], airlight: NDArray[Any], t: NDArray[Any] | float) -> NDArray[Any]:
    """I = J t + A (1 - t): a scene J through air of transmission t and airlight A, of shapes that broadcast."""
    return np.asarray(scene * t + airlight * (1 - t))


def add_haze(
    clear_rgb: NDArray[np.uint8], range_m: ArrayLike, beta_per_m: float, airlight_rgb: ArrayLike
) -> NDArray[np.uint8]:
    """Hazy image (H, W, 3) uint8 from a clear one, ray lengths (H, W) in metres and airlight (3,) in 0..255."""
    t = transmission(range_m, beta_per_m)[..., None]
    if t.shape[:2] != clear_rgb.shape[:2]:
        raise ValueError(f"image is {clear_rgb.shape[:2]} but range is {t.shape[:2]}")
    airlight = np.asarray(airlight_rgb, dtype=np.float32)
    hazy = blend_airlight(clear_rgb.astype(np.float32), airlight, t)
    return np.clip(np.rint(hazy), 0, 255).astype(np.uint8)


@dataclass(frozen=True)
class Atmosphere:
    """Air that scatters light: plain numbers, so that a recording can hold it and a hazy picture be made again.

    Args:
        extinction_per_m: of red, green and blue light, at the height `base_z_m`.
        airlight: linear light of thick air, away from the sun.
        base_z_m: world z (down) of the water.
        scale_height_m: the extinction falls by e with each; infinite: the same at all heights.
        glow: how much brighter thick air is right at the sun, as a share of the airlight.
        glow_g: Henyey and Greenstein's asymmetry of that glow, 0 (everywhere) to 1 (a point).
        sun: unit vector from the sun to the ground, world.
        waves: patches: the extinction is multiplied by 1 + the sum of a cos(kx x + ky y + phase), each wave
            being (kx, ky in rad/m, phase in rad, a).

    Raises:
        ValueError: a number out of its range, or patches that would make the extinction negative.
    """

    extinction_per_m: Triple
    airlight: Triple
    base_z_m: float = 0.0
    scale_height_m: float = math.inf
    glow: float = 0.0
    glow_g: float = 0.75
    sun: Triple = (0.0, 0.0, 1.0)
    waves: tuple[Wave, ...] = ()

    def __post_init__(self) -> None:
        check_numbers(self, "atmosphere", "extinction_per_m", least=0)
        check_numbers(self, "atmosphere", "glow_g", least=0, below=1)
        if not self.scale_height_m > 0:
            raise ValueError(f"scale_height_m must be positive, got {self.scale_height_m}")
        if sum(abs(wave[3]) for wave in self.waves) > 1:
            raise ValueError(f"the patches' amplitudes must not add up to more than 1, got {self.waves}")

    def to_mapping(self) -> dict[str, Any]:
        """JSON values that `atmosphere_from_mapping` reads back; an infinite scale height is null."""
        return asdict(self) | {"scale_height_m": None if math.isinf(self.scale_height_m) else self.scale_height_m}


def atmosphere_from_mapping(values: Mapping[str, Any]) -> Atmosphere:
    """The atmosphere of `Atmosphere.to_mapping`.

    Raises:
        ValueError: a missing or an unknown key, or values that are none.
    """
    names = {item.name for item in fields(Atmosphere)}
    if set(values) != names:
        raise ValueError(f"an atmosphere has {sorted(names)}, got {sorted(values)}")
    triples = {name: tuple(float(x) for x in values[name]) for name in ("extinction_per_m", "airlight", "sun")}
    height = math.inf if values["scale_height_m"] is None else float(values["scale_height_m"])
    waves = tuple(tuple(float(x) for x in wave) for wave in values["waves"])
    return Atmosphere(**{**values, **triples, "scale_height_m": height, "waves": waves})


def world_rays(rays: NDArray[np.float32], world_from_camera: ArrayLike) -> tuple[NDArray[Any], NDArray[Any]]:
    """Unit directions (H, W, 3) in the world and lengths (H, W) of pixels' rays (H, W, 3) of the optical frame.

    Args:
        world_from_camera: rotation matrix (3, 3).
    """
    lengths = np.sqrt(np.einsum("hwc,hwc->hw", rays, rays))
    directions = (rays / lengths[..., None]) @ np.asarray(world_from_camera, dtype=np.float32).T
    return directions, lengths


def scatter(
    radiance: NDArray[np.float32],
    range_m: NDArray[np.float32],
    directions: NDArray[np.float32],
    eye_m: ArrayLike,
    atmosphere: Atmosphere,
) -> NDArray[np.float32]:
    """Linear light (H, W, 3) seen through air.

    Args:
        radiance: (H, W, 3) linear light without the air.
        range_m: (H, W) ray lengths; NaN in the sky.
        directions: (H, W, 3) unit, world.
        eye_m: (3,) camera, world.
    """
    if not any(atmosphere.extinction_per_m):
        return radiance
    path = air_path(range_m, directions, eye_m, atmosphere)[..., None]
    extinction = np.asarray(atmosphere.extinction_per_m, dtype=np.float32)
    t = np.exp(-path * (extinction if len(set(extinction.tolist())) > 1 else extinction[:1]))
    light = np.asarray(atmosphere.airlight, dtype=np.float32)
    if atmosphere.glow > 0:
        light = light * (1.0 + np.float32(atmosphere.glow) * sun_glow(directions, atmosphere)[..., None])
    # `blend_airlight` in another order, whose rounding the recordings of every seed have.
    return np.asarray(light + (radiance - light) * t, dtype=np.float32)


def air_path(
    range_m: NDArray[np.float32], directions: NDArray[np.float32], eye_m: ArrayLike, atmosphere: Atmosphere
) -> NDArray[np.float32]:
    """Length (H, W), m, of air as dense as at the water that lets as much light through as each ray's air.

    The density exp(-h / H) integrates in closed form: between heights h0 and h1 a ray of length d meets
    d H (exp(-h0 / H) - exp(-h1 / H)) / (h1 - h0).
    """
    eye = np.asarray(eye_m, dtype=np.float64)
    ranges = np.nan_to_num(range_m, nan=np.inf)
    if math.isinf(atmosphere.scale_height_m):
        reach = path = ranges
    else:
        level = (eye[2] - atmosphere.base_z_m) / atmosphere.scale_height_m  # minus the eye's height, in scale heights
        climb = -directions[..., 2] / np.float32(atmosphere.scale_height_m)
        reach = np.where(climb > 0, 1.0 / np.maximum(climb, np.float32(1e-12)), np.float32(np.inf))
        path = np.where(climb > 0, np.float32(math.exp(level)) * np.where(climb > 0, reach, 0), np.float32(np.inf))
        seen = np.isfinite(ranges)
        rise = np.where(seen, climb * np.where(seen, ranges, 0), 0)
        # From a ray's lower end, where the air is thickest: from far above the water the exponential would overflow.
        size, fall = np.abs(rise), np.maximum(-rise, 0)
        share = np.where(size < 1e-4, 1 - size / 2, -np.expm1(-size) / np.maximum(size, np.float32(1e-4)))
        path = np.where(seen, ranges * share * np.exp(np.float32(level) + fall), path)
        reach = np.where(seen, ranges * share * np.exp(np.minimum(fall, MAX_FALL)), reach)
    if atmosphere.waves:
        path = path * patches(reach, directions, eye, atmosphere.waves)
    return np.asarray(path, dtype=np.float32)


def patches(
    reach_m: NDArray[np.float32], directions: NDArray[np.float32], eye_m: NDArray[np.float64], waves: tuple[Wave, ...]
) -> NDArray[np.float32]:
    """Mean of the patches' factor (H, W) along rays of a length; each wave has a closed form. 1 along endless rays."""
    half = np.minimum(reach_m, np.float32(1e5)) / 2
    total: NDArray[Any] = np.ones_like(half)
    for kx, ky, phase, amplitude in waves:
        turn = (np.float32(kx) * directions[..., 0] + np.float32(ky) * directions[..., 1]) * half
        start = np.float32((kx * eye_m[0] + ky * eye_m[1] + phase) % (2 * math.pi))
        total += np.float32(amplitude) * np.cos(start + turn) * np.sinc(turn / np.float32(math.pi))
    return total


def sun_glow(directions: NDArray[np.float32], atmosphere: Atmosphere) -> NDArray[np.float32]:
    """Henyey and Greenstein's forward lobe (H, W) about the sun, 1 at its middle."""
    g = atmosphere.glow_g
    cosine = directions @ (-np.asarray(atmosphere.sun, dtype=np.float32))
    base = np.float32(1 + g * g) - np.float32(2 * g) * cosine
    return np.asarray(np.float32((1 - g) ** 3) / (base * np.sqrt(base)), dtype=np.float32)
