"""The approaches that `deckline eval localization` and `eval integrity` fly, and what their sensors get wrong."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, Literal

import cv2
import numpy as np
import tyro
from numpy.typing import NDArray

from deckline.config import GRADES, RunConfig, Sensors
from deckline.extras import needs_extra
from deckline.options import RunOptions
from deckline.types import Frame

if TYPE_CHECKING:
    from deckline.sim import SimConfig

DEPTH_RANGE_M = 200.0  # of the depth camera; the simulator's default
DEPTH_PATCH_PX = 2.0  # neighbouring depths err together, as those of a matching window do; our choice
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
        options: of the configuration that flies. The simulator draws the errors of pose, calibration, depth and deck
            height from its sensors and moves the deck by its sea state.

    Raises:
        ValueError: a number out of its range.
    """

    frames: int = 45
    seed: int = 1000
    preset: Literal["paper", "cvn", "axial", "small", "runway"] = "paper"
    visibility: str = "500..3000"
    range_m: tuple[float, float] = (800.0, 20.0)
    fov_deg: float = 90.0
    options: Annotated[RunOptions, tyro.conf.arg(name="")] = field(default_factory=RunOptions)

    def __post_init__(self) -> None:
        if self.frames < 2:
            raise ValueError(f"--frames must be at least 2, got {self.frames}")
        if not self.range_m[1] < self.range_m[0]:
            raise ValueError(f"--range-m must be FAR NEAR with FAR beyond NEAR, got {self.range_m}")

    @cached_property
    def run(self) -> RunConfig:
        """The configuration that flies."""
        return self.options.run_config()

    def approach(self, number: int) -> "SimConfig":
        """What the simulator is asked for.

        Raises:
            ValueError: what it refuses.
            ImportError: the sim extra is not installed.
        """
        with needs_extra("sim"):
            from deckline.sim import SimConfig
            from deckline.sim.config import DepthConfig, MotionConfig, NavigationConfig
            from deckline.sim.record import parse_visibility
        sensors = self.run.sensors
        navigation = NavigationConfig(
            position_sigma_m=sensors.position_white_m,
            attitude_sigma_deg=sensors.attitude_white_deg,
            position_bias_m=sensors.position_drift_m,
            attitude_bias_deg=sensors.attitude_drift_deg,
            drift_s=sensors.drift_s,
        )
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
            motion=MotionConfig(self.run.deck.sea_state),
            depth=DepthConfig(DEPTH_RANGE_M),
            navigation=navigation,
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
            noisy = add_depth_noise(frame, config.run.sensors, rendered.seed, index)
            yield miscalibrate(noisy, config.run.sensors, rendered.seed)


def miscalibrate(frame: Frame, sensors: Sensors, seed: int) -> Frame:
    """A frame with the errors that a whole approach has in common: reported deck height, focal length, depth scale."""
    deck, focal, scale = np.random.default_rng([seed, CALIBRATION]).standard_normal(3)
    zoom = 1.0 + sensors.focal_fraction * float(focal)
    camera = replace(frame.camera, fx=zoom * frame.camera.fx, fy=zoom * frame.camera.fy)
    depth = None if frame.depth_m is None else frame.depth_m * np.float32(1.0 + sensors.depth_scale * scale)
    deck_z = None if frame.deck_z_m is None else frame.deck_z_m + sensors.deck_z_m * float(deck)
    return replace(frame, camera=camera, depth_m=depth, deck_z_m=deck_z)


def add_depth_noise(frame: Frame, sensors: Sensors, seed: int, index: int) -> Frame:
    """A frame whose depth camera errs by its stated noise, in patches."""
    if frame.depth_m is None or not np.isfinite(frame.depth_m).any():
        return frame
    noise = draw_patchy_noise(frame.depth_m.shape, np.random.default_rng([seed, index, DEPTH]))
    return replace(frame, depth_m=frame.depth_m * (1.0 + np.float32(sensors.depth_fraction) * noise))


def draw_patchy_noise(shape: tuple[int, ...], rng: np.random.Generator) -> NDArray[np.float32]:
    """Noise (H, W) of unit variance whose neighbours resemble each other."""
    white = rng.standard_normal(shape, np.float32)
    size = 2 * int(np.ceil(4 * DEPTH_PATCH_PX)) + 1
    kernel = cv2.getGaussianKernel(size, DEPTH_PATCH_PX, cv2.CV_32F)
    blurred = cv2.sepFilter2D(white, -1, kernel, kernel, borderType=cv2.BORDER_REFLECT)
    return np.asarray(blurred / np.float32((kernel**2).sum()), dtype=np.float32)


def describe_flights(config: FlightsConfig) -> str:
    """Ship, visibility, ranges, sensors, sea and seed in words."""
    sensors, (far_m, near_m) = config.run.sensors, config.range_m
    grade = next((name for name, graded in GRADES.items() if sensors == graded), None)
    navigation = grade or f"{sensors.position_m:g} m and {sensors.attitude_deg:g} degrees"
    return (
        f"{config.frames} frames, preset {config.preset}, V {config.visibility} m, {far_m:g} to {near_m:g} m, "
        f"navigation {navigation}, sea state {config.run.deck.sea_state:g}, seed {config.seed}"
    )


def flight_settings(flights: FlightsConfig) -> dict[str, Any]:
    """What is flown as plain values, without the options of the configuration that flies."""
    return {name: value for name, value in vars(flights).items() if name not in ("options", "run")}
