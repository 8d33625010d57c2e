"""How long the shutter is open, how the camera moves meanwhile, and what rain falls."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform

from deckline.geometry import Camera
from deckline.haze import Triple

BLUR_CHANCE, RAIN_CHANCE, SPRAY_CHANCE = 0.22, 0.08, 0.03  # of a frame of preset train
EXPOSURE_S = (1 / 1000, 1 / 25)  # drawn, lowest and highest
FALL_M_S = 9.0  # of large raindrops: Gunn and Kinzer 1949
RAIN_MM_H = (2.0, 60.0)  # drawn: light to torrential
SHAKE_DEG_S = 5.0  # 1-sigma of the camera's turning in flight that training wants
BLUR_LIMIT = 0.02  # of the picture's width: more turning is not drawn


@dataclass(frozen=True)
class FilmConfig:
    """What happens during the exposure; None: drawn for preset `train`, the stated default for the others.

    Args:
        exposure_s: how long the shutter is open; 0: no motion blur; default 0.
        shake_deg_s: 1-sigma of the camera's turning about each axis, beside its flight; seen while the shutter is open;
            default 0. Unless it is given, the picture smears by 2 % of its width at most.
        rain_mm_h: rainfall, which also thickens the air unless the visibility is infinite; default 0.
        lens_drops: drops on the lens; default 0.

    Raises:
        ValueError: a negative number.
    """

    exposure_s: float | None = None
    shake_deg_s: float | None = None
    rain_mm_h: float | None = None
    lens_drops: int | None = None

    def __post_init__(self) -> None:
        for name, high in (("exposure_s", 1.0), ("shake_deg_s", 1000.0), ("rain_mm_h", 500.0), ("lens_drops", 1000)):
            value = getattr(self, name)
            if value is not None and not 0 <= value <= high:
                raise ValueError(f"{name} must lie between 0 and {high}, got {value}")


@dataclass(frozen=True)
class Exposure:
    """One frame's exposure: plain numbers, recorded with it."""

    exposure_s: float = 0.0
    moved_m: Triple = (0.0, 0.0, 0.0)  # of the camera while the shutter is open, in its optical frame
    turned_rad: Triple = (0.0, 0.0, 0.0)  # rotation vector of the same
    rain_mm_h: float = 0.0
    rain_m_s: Triple = (0.0, FALL_M_S, 0.0)  # velocity of the drops, optical frame
    streak_contrast: float = 1.0  # 1: as physics has it; more is what drawn rain looks like
    lens_drops: int = 0
    lens_seed: int = 0  # of the drops on the lens
    seed: int = 0  # of the falling ones

    @property
    def still(self) -> bool:
        """Whether the picture is what the renderer drew."""
        return not (any(self.moved_m) or any(self.turned_rad) or self.rain_mm_h > 0 or self.lens_drops > 0)


def draw_exposure(
    config: FilmConfig,
    camera: Camera,
    world_from_camera: RigidTransform,
    velocity_m_s: ArrayLike,
    turning_rad_s: ArrayLike,
    recording: np.random.Generator,
    frame: np.random.Generator,
    wide: bool,
) -> Exposure:
    """Exposure of a camera that flies with a velocity (3,) relative to the ship and turns at a rate (3,), both world.

    `recording` draws the shutter, the rain and where drops sit on the lens, `frame` what is new in every frame.
    """
    kinds = recording.random(3)
    drawn_s = float(np.exp(recording.uniform(*np.log(EXPOSURE_S)))) if kinds[0] < BLUR_CHANCE else 0.0
    drawn_rain = float(np.exp(recording.uniform(*np.log(RAIN_MM_H)))) if kinds[1] < RAIN_CHANCE else 0.0
    contrast, lens_seed = float(np.exp(recording.uniform(0.0, np.log(8.0)))), int(recording.integers(2**31))
    exposure_s = _setting(config.exposure_s, drawn_s, wide)
    rain = _setting(config.rain_mm_h, drawn_rain, wide)
    wet = wide and (rain > 0 or kinds[2] < SPRAY_CHANCE)
    drops = int(recording.poisson(recording.uniform(0.0, 25.0))) if wet else 0
    turned = np.deg2rad(_setting(config.shake_deg_s, SHAKE_DEG_S, wide)) * frame.normal(size=3) * exposure_s
    optical = world_from_camera.rotation.inv()
    turned = turned + optical.apply(np.asarray(turning_rad_s, dtype=np.float64)) * exposure_s
    limit = BLUR_LIMIT * camera.width / camera.fx
    if config.shake_deg_s is None:
        turned = turned * min(1.0, limit / max(float(np.linalg.norm(turned)), 1e-12))
    flown = optical.apply(np.asarray(velocity_m_s, dtype=np.float64))
    return Exposure(
        exposure_s=exposure_s,
        moved_m=_triple(flown * exposure_s),
        turned_rad=_triple(turned),
        rain_mm_h=rain,
        rain_m_s=_triple(optical.apply([0.0, 0.0, FALL_M_S]) - flown),
        streak_contrast=contrast if wide else 1.0,
        lens_drops=drops if config.lens_drops is None else config.lens_drops,
        lens_seed=lens_seed,
        seed=int(frame.integers(2**31)),
    )


def _setting(given: float | None, drawn: float, wide: bool) -> float:
    return given if given is not None else drawn if wide else 0.0


def _triple(values: NDArray[np.float64]) -> Triple:
    first, second, third = values.tolist()
    return first, second, third
