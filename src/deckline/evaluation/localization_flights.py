"""The approaches that `deckline eval localization` and `eval integrity` fly, and what their sensors get wrong."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from deckline.extras import needs_extra
from deckline.flight import on_moving_deck
from deckline.localize import LocalizeConfig, NoiseConfig
from deckline.track import ErrorConfig, TrackConfig
from deckline.types import Frame

if TYPE_CHECKING:
    from deckline.sim import SimConfig

Navigation = Literal["good", "tactical", "exact"]


@dataclass(frozen=True)
class Unit:
    """1-sigma of a navigation unit's white noise and of its drift, along and about each axis."""

    position_sigma_m: float
    attitude_sigma_deg: float
    position_bias_m: float
    attitude_bias_deg: float


UNITS: dict[Navigation, Unit] = {  # as the simulator's NavigationConfig describes them
    "good": Unit(0.02, 0.005, 0.1, 0.02),
    "tactical": Unit(0.1, 0.02, 1.5, 0.1),
    "exact": Unit(0.0, 0.0, 0.0, 0.0),
}
DRIFT_S = 60.0  # time constant of the drift; the simulator's default
DEPTH_RANGE_M = 200.0  # of the depth camera; the simulator's default
DEPTH_PATCH_PX = 2.0  # neighbouring depths err together, as those of a matching window do; our choice
ERRORS = NoiseConfig()  # 1-sigma of what is not the unit's: deck height, focal length, depth samples and their scale
LEAST_RAD, LEAST_M, LEAST_SHARE = 1e-5, 1e-3, 1e-4  # of an exact sensor: the tracker wants more than nothing
CALIBRATION, DEPTH = 21, 22  # random streams


@dataclass(frozen=True)
class FlightsConfig:
    """Approaches to fly, each with its own seed, visibility and errors.

    Args:
        frames: of each approach, evenly spaced in time.
        seed: of the first approach; the others count on. The shipped weights never saw seeds from 1000 on.
        preset: the ship.
        visibility: of each approach, metres at 2 % contrast, LOW..HIGH or clear.
        range_m: distances to the ramp where an approach begins and ends.
        fov_deg: horizontal field of view.
        navigation: the unit that measures the pose; `exact` makes depths, calibration and deck height exact as well.
        sea_state: of the ship's motion, 0 to 6; the tracker is told.
        runway_width_m: spacing of the lines as localization and tracker are told it; they learn it otherwise.

    Raises:
        ValueError: a number out of its range.
    """

    frames: int = 45
    seed: int = 1000
    preset: Literal["paper", "cvn", "axial", "small", "runway"] = "paper"
    visibility: str = "500..3000"
    range_m: tuple[float, float] = (800.0, 20.0)
    fov_deg: float = 90.0
    navigation: Navigation = "good"
    sea_state: float = 0.0
    runway_width_m: float | None = None

    def __post_init__(self) -> None:
        if self.frames < 2:
            raise ValueError(f"--frames must be at least 2, got {self.frames}")
        if not self.range_m[1] < self.range_m[0]:
            raise ValueError(f"--range-m must be FAR NEAR with FAR beyond NEAR, got {self.range_m}")

    def approach(self, number: int) -> "SimConfig":
        """What the simulator is asked for.

        Raises:
            ValueError: what it refuses.
            ImportError: the sim extra is not installed.
        """
        with needs_extra("sim"):
            from deckline.sim import SimConfig
            from deckline.sim.camera.config import DepthConfig, NavigationConfig
            from deckline.sim.config import MotionConfig
            from deckline.sim.record import parse_visibility
        return SimConfig(
            preset=self.preset,
            trajectory="approach",
            frames=self.frames,
            visibility_m=parse_visibility(self.visibility),
            seed=self.seed + number,
            fov_deg=self.fov_deg,
            keep_clear=False,
            start_m=self.range_m[0],
            end_m=self.range_m[1],
            motion=MotionConfig(self.sea_state),
            depth=DepthConfig(DEPTH_RANGE_M),
            navigation=NavigationConfig(**vars(UNITS[self.navigation]), drift_s=DRIFT_S),
        )

    @property
    def localize(self) -> LocalizeConfig:
        """Localization, told of its sensors and of how far the deck moves about its reported height and slopes."""
        lines = LocalizeConfig(noise=self.noise, runway_width_m=self.runway_width_m)
        return on_moving_deck(lines, self.track) if self.sea_state else lines

    @property
    def track(self) -> TrackConfig:
        """The tracker, told of its sensors and of the sea."""
        unit, noise = UNITS[self.navigation], self.noise
        errors = ErrorConfig(
            attitude_rad=max(noise.attitude_rad, LEAST_RAD),
            position_m=max(noise.position_m, LEAST_M),
            attitude_white_rad=max(float(np.deg2rad(unit.attitude_sigma_deg)), LEAST_RAD),
            position_white_m=max(unit.position_sigma_m, LEAST_M),
            drift_s=DRIFT_S,
            deck_z_m=max(noise.deck_z_m, LEAST_M),
            depth_scale=max(noise.depth_scale, LEAST_SHARE),
        )
        return TrackConfig(runway_width_m=self.runway_width_m, errors=errors).at_sea_state(self.sea_state)

    @property
    def noise(self) -> NoiseConfig:
        """What localization is told of the sensors: their true 1-sigma, drift and noise together."""
        unit = UNITS[self.navigation]
        others = ("depth_fraction", "deck_z_m", "focal_fraction", "depth_scale")
        return replace(
            ERRORS,
            attitude_rad=float(np.deg2rad(np.hypot(unit.attitude_bias_deg, unit.attitude_sigma_deg))),
            position_m=float(np.hypot(unit.position_bias_m, unit.position_sigma_m)),
            **(dict.fromkeys(others, 0.0) if self.navigation == "exact" else {}),
        )


def fly(config: FlightsConfig, approach: int) -> Iterator[Frame]:
    """The frames of one approach as its sensors have them.

    Raises:
        OSError: no OpenGL through EGL on this machine.
    """
    with needs_extra("sim"):
        from deckline.sim.simulate import Simulator
    rendered = config.approach(approach)
    with Simulator(rendered) as simulator:
        for index in range(config.frames):
            frame = simulator.frame(index)
            exact = config.navigation == "exact"
            yield frame if exact else miscalibrated(noisy_depth(frame, rendered.seed, index), rendered.seed)


def miscalibrated(frame: Frame, seed: int) -> Frame:
    """A frame with the errors that a whole approach has in common: reported deck height, focal length, depth scale."""
    deck, focal, scale = np.random.default_rng([seed, CALIBRATION]).standard_normal(3)
    zoom = 1.0 + ERRORS.focal_fraction * float(focal)
    camera = replace(frame.camera, fx=zoom * frame.camera.fx, fy=zoom * frame.camera.fy)
    depth = None if frame.depth_m is None else frame.depth_m * np.float32(1.0 + ERRORS.depth_scale * scale)
    deck_z = None if frame.deck_z_m is None else frame.deck_z_m + ERRORS.deck_z_m * float(deck)
    return replace(frame, camera=camera, depth_m=depth, deck_z_m=deck_z)


def noisy_depth(frame: Frame, seed: int, index: int) -> Frame:
    """A frame whose depth camera errs by what localization is told, in patches."""
    if frame.depth_m is None or not np.isfinite(frame.depth_m).any():
        return frame
    noise = patchy(frame.depth_m.shape, np.random.default_rng([seed, index, DEPTH]))
    return replace(frame, depth_m=frame.depth_m * (1.0 + np.float32(ERRORS.depth_fraction) * noise))


def patchy(shape: tuple[int, ...], rng: np.random.Generator) -> NDArray[np.float32]:
    """Noise (H, W) of unit variance whose neighbours resemble each other."""
    white = rng.standard_normal(shape, np.float32)
    size = 2 * int(np.ceil(4 * DEPTH_PATCH_PX)) + 1
    kernel = cv2.getGaussianKernel(size, DEPTH_PATCH_PX, cv2.CV_32F)
    blurred = cv2.sepFilter2D(white, -1, kernel, kernel, borderType=cv2.BORDER_REFLECT)
    return np.asarray(blurred / np.float32((kernel**2).sum()), dtype=np.float32)
