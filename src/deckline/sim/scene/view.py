"""One picture: what is asked of the renderer, and what it gives."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from deckline.geometry import Camera
from deckline.sim.scene.weather import Weather

SAMPLES = 4  # per pixel, against jagged edges


class Label(IntEnum):
    """What a pixel shows."""

    SKY = 0
    SURFACE = 1  # water, or the ground around a runway on land
    DECK = 2
    STRUCTURE = 3  # all else of the ship: hull, island, aircraft on deck
    BACKGROUND = 4  # other ships, coast


@dataclass(frozen=True)
class Quality:
    """How carefully a picture is drawn; a poor one looks like other renderers' work."""

    samples: int = SAMPLES  # per pixel, this many or 1, which leaves jagged edges
    anisotropy: float = 16.0  # of the deck's texture filter; 1 smears far markings together


BEST = Quality()


@dataclass(frozen=True, eq=False)
class Scene:
    """The loaded ship, or its sea alone, as a pinhole camera has it before it."""

    camera: Camera
    world_from_camera: RigidTransform
    weather: Weather
    time_s: float = 0.0
    with_ship: bool = True
    quality: Quality = BEST
    world_from_ship: RigidTransform | None = None  # None: as the ship lies at rest


@dataclass(frozen=True, eq=False)
class View:
    """A rendered scene."""

    radiance: NDArray[np.float32]  # (H, W, 3) linear light; 1 is what a white surface in full daylight sends
    depth_m: NDArray[np.float32]  # (H, W) along the optical axis; NaN in the sky

    @property
    def nearness(self) -> NDArray[np.float32]:
        """1 / depth (H, W), 0 in the sky."""
        known = np.where(np.isnan(self.depth_m), np.float32(np.inf), self.depth_m)
        return np.asarray(1.0 / known, np.float32)


def random_quality(rng: np.random.Generator) -> Quality:
    """Mostly good."""
    anisotropy = float(rng.choice([1.0, 2.0, 4.0, 16.0], p=[0.15, 0.25, 0.25, 0.35]))
    return Quality(samples=1 if rng.random() < 0.15 else SAMPLES, anisotropy=anisotropy)
