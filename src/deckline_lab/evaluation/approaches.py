"""The approaches that evaluations fly, rendered or with a modelled detector, and what their sensors get wrong.

Without pictures, true lines are projected, and points and depth drawn about them from a stated model: thousands of
frames a minute, so that rare things can be counted. What a picture would show of its own, such as glare or clutter, is
not in them.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from deckline.checks import check_numbers
from deckline.config import GRADES, RunConfig, Sensors
from deckline.config_file import read_config
from deckline.geometry import Camera
from deckline.options import FlightOptions, RunOptions
from deckline.types import Detection, Frame, LinePoints, Segment, Truth
from deckline_sim.camera.measure import measure_pose, miscalibrate, navigation_unit
from deckline_sim.config import DepthConfig, FlightConfig, MotionConfig, SimConfig
from deckline_sim.flight.approach import approach_view
from deckline_sim.flight.viewpoints import draw_motion, ship_pose
from deckline_sim.landing.modelled_detector import correlated_noise
from deckline_sim.ship.layout import class_layout, truth_segments
from deckline_sim.ship.ship_class import load_class
from deckline_sim.visibility import draw_visibility, parse_visibility

DEPTH_RANGE_M = 200.0  # of the depth camera; the simulator's default
DEPTH_PATCH_PX = 2.0  # neighbouring depths err together, as those of a matching window do; our choice
DEPTH = 22  # random stream
PATCH_PX = 2  # depth is filled in so far around every point; localization samples 1 px around it
SAMPLES = 2000  # along a line, to find what of it is in the image
BORDER_PX = 1.0
POINTS, MOTION, AIR = 31, 32, 33  # random streams


@dataclass(frozen=True)
class PointNoise:
    """The detector: what it finds of a line in view, and how wrong it is.

    sigma_px is about what `deckline eval chain` prints for the shipped one near the paper's deck; the shares are our
    choice.

    Args:
        seen_share: how far lines are seen, of the visibility at 2 % contrast.
        rows: points on a line, evenly spaced in the image's rows; never closer than a tenth of a pixel.
        sigma_px: 1-sigma of u, which the detector also reports.
        correlation: of the errors of neighbouring points.
        outlier_share: of the points, anywhere within outlier_px of the line.
        outlier_px: how far outliers lie off, at most.
        missed_share: of the lines in a frame, not seen at all.
    """

    seen_share: float = 0.7
    rows: int = 40
    sigma_px: float = 0.3
    correlation: float = 0.5
    outlier_share: float = 0.02
    outlier_px: float = 20.0
    missed_share: float = 0.01


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
        speed_m_s: of the aircraft through still air.
        noise: TOML file of the modelled detector, such as `sigma_px = 0.5`.
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
    speed_m_s: float = 65.0
    noise: Path | None = None
    options: FlightOptions = field(default_factory=RunOptions)

    def __post_init__(self) -> None:
        check_numbers(self, "", "frames", least=2)
        if not self.range_m[1] < self.range_m[0]:
            raise ValueError(f"--range-m must be FAR NEAR with FAR beyond NEAR, got {self.range_m}")

    @cached_property
    def run(self) -> RunConfig:
        """The configuration that flies."""
        return self.options.run_config()

    @cached_property
    def point_noise(self) -> PointNoise:
        """The modelled detector."""
        return PointNoise() if self.noise is None else read_config(PointNoise, self.noise)

    def approach(self, number: int) -> SimConfig:
        """What the simulator is asked for; a ValueError where it refuses."""
        sensors, wanted = self.run.sensors, self.run.approach
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
            flight=FlightConfig(
                glideslope_deg=wanted.glideslope_deg, touchdown_m=wanted.touchdown_m, speed_m_s=self.speed_m_s
            ),
            depth=DepthConfig(DEPTH_RANGE_M),
            navigation=navigation_unit(sensors),
        )


def fly(config: FlightsConfig, approach: int) -> Iterator[Frame]:
    """The frames of one approach as its sensors have them; an OSError without OpenGL through EGL."""
    from deckline_sim.simulate import ShipSimulator  # needs OpenGL

    rendered = config.approach(approach)
    with ShipSimulator(rendered) as simulator:
        for index in range(config.frames):
            frame = simulator.frame(index)
            noisy = add_depth_noise(frame, config.run.sensors, rendered.seed, index)
            yield miscalibrate(noisy, config.run.sensors, rendered.seed)


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
        f"{config.speed_m_s:g} m/s, "
        f"navigation {navigation}, sea state {config.run.deck.sea_state:g}, seed {config.seed}"
    )


def flight_settings(flights: FlightsConfig) -> dict[str, Any]:
    """What is flown as plain values, without the options of the configuration that flies and the modelled detector."""
    others = ("options", "run", "noise", "point_noise")
    return {name: value for name, value in vars(flights).items() if name not in others}


class Sighting(NamedTuple):
    """One frame of a flight, and its detected lines where the detector is modelled."""

    frame: Frame
    detection: Detection | None = None


def fly_points(config: SimConfig, sensors: Sensors, noise: PointNoise) -> Iterator[Sighting]:
    """Every frame of an approach with the modelled detector's points; its sensors err as in rendered flights.

    The picture is grain, another in every frame, as a camera's is.
    """
    layout = class_layout(load_class(config.preset))
    motion = draw_motion(config.motion, False, np.random.default_rng([config.seed, MOTION]))
    visibility_m = draw_visibility(config.visibility_m, np.random.default_rng([config.seed, AIR]))
    size = (config.height + config.frames, config.width, 3)
    grain = np.random.default_rng([config.seed, POINTS]).integers(0, 256, size, np.uint8)
    far_m, depth_sigma = noise.seen_share * visibility_m, sensors.depth_fraction
    for index in range(config.frames):
        view = approach_view(config, layout, index, motion)
        segments = truth_segments(layout.at_pose(ship_pose(layout, motion, view.time_s)))
        rng = np.random.default_rng([config.seed, POINTS, index])
        camera, pose = view.camera, view.world_from_camera
        left, right = (draw_points(segment, pose, camera, far_m, noise, rng) for segment in segments)
        depth = sparse_depth(camera, pose, segments, [left, right], depth_sigma, rng)
        truth = Truth(*segments, visibility_m=visibility_m, world_from_body=view.world_from_body)
        frame = Frame(
            f"point_{config.seed}_{index}",
            view.time_s,
            grain[index : index + config.height],
            camera,
            view.body_from_camera,
            depth_m=depth,
            world_from_body=measure_pose(view.world_from_body, view.time_s, config.navigation, config.seed),
            deck_z_m=float(layout.world_from_ship.translation[2]),
            truth=truth,
        )
        yield Sighting(miscalibrate(frame, sensors, config.seed), Detection(left, right))


def draw_points(
    segment: Segment,
    world_from_camera: RigidTransform,
    camera: Camera,
    far_m: float,
    noise: PointNoise,
    rng: np.random.Generator,
) -> LinePoints:
    """Noisy points of a true line, as far as it is in the image and nearer than `far`.

    None where it is missed or shorter than 2 px.
    """
    along = segment.p0_m + np.linspace(0.0, 1.0, SAMPLES)[:, None] * (segment.p1_m - segment.p0_m)
    pixels = camera.project(world_from_camera.inv().apply(along))
    with np.errstate(invalid="ignore"):
        inside = np.all((pixels >= BORDER_PX) & (pixels <= [camera.width - 2, camera.height - 2]), axis=1)
    inside &= np.linalg.norm(along - world_from_camera.translation, axis=1) < far_m
    missed = rng.random() < noise.missed_share
    if missed or inside.sum() < 2 or np.ptp(pixels[inside, 1]) < 2.0:
        return LinePoints.empty()
    v = pixels[inside, 1]
    rows = np.linspace(v.min(), v.max(), min(noise.rows, int(10 * np.ptp(v))))
    order = np.argsort(v)
    u = np.interp(rows, v[order], pixels[inside, 0][order])
    u += noise.sigma_px * correlated_noise(len(rows), noise.correlation, rng)
    stray = rng.random(len(rows)) < noise.outlier_share
    u[stray] += rng.uniform(-noise.outlier_px, noise.outlier_px, int(stray.sum()))
    inside = (u >= 0) & (u <= camera.width - 1)
    points = np.column_stack([u, rows])[inside]
    return LinePoints(points, np.full(len(points), 0.9), np.full(len(points), noise.sigma_px))


def sparse_depth(
    camera: Camera,
    pose: RigidTransform,
    segments: tuple[Segment, Segment],
    seen: list[LinePoints],
    sigma: float,
    rng: np.random.Generator,
) -> NDArray[np.float32]:
    """Depth (H, W) of the deck around the points seen, the rest NaN, as is what lies beyond the depth camera's reach.

    The segments are both true lines, which span the deck's plane. A depth errs by its part `sigma`, with one draw for
    each point, as a matching window has.
    """
    depth = np.full((camera.height, camera.width), np.nan, dtype=np.float32)
    window = np.array([(du, dv) for dv in range(-PATCH_PX, PATCH_PX + 1) for du in range(-PATCH_PX, PATCH_PX + 1)])
    normal = np.cross(segments[0].p1_m - segments[0].p0_m, segments[1].p0_m - segments[0].p0_m)
    for points in seen:
        if not len(points):
            continue
        pixels = np.rint(points.points_px).astype(int)[:, None] + window
        rays = pose.rotation.apply(camera.rays(pixels.reshape(-1, 2)))  # of length 1 along the optical axis
        true = ((segments[0].p0_m - pose.translation) @ normal) / (rays @ normal)
        true = np.where((true > 0) & (true <= DEPTH_RANGE_M), true, np.nan).reshape(pixels.shape[:2])
        true *= 1.0 + sigma * rng.standard_normal(len(points))[:, None]
        inside = np.all((pixels >= 0) & (pixels < [camera.width, camera.height]), axis=2)
        depth[pixels[inside][:, 1], pixels[inside][:, 0]] = true[inside]
    return depth
