"""Where the aircraft is: final approaches, and unrelated views around the glide path."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from deckline.geometry import Camera, attitude, camera_mount
from deckline.sim.config import SimConfig
from deckline.sim.layout import Layout, world_points
from deckline.sim.paint import axes

GLIDESLOPE_RAD = np.deg2rad(3.5)  # SPEC section 7
TOUCHDOWN_M = 70.0  # from the ramp: 230 ft, SPEC section 7
RAMP_CLEARANCE_M = 3.05  # 10 ft, SPEC section 7
SPEED_M_S = 65.0
APPARENT_WIDTH = (0.012, 1.0)  # the runway's width at the ramp over the image's, for a view worth training on


@dataclass(frozen=True, eq=False)
class Viewpoint:
    """Pose, camera and time of one frame."""

    world_from_body: RigidTransform
    camera: Camera
    time_s: float


def looking(
    position_m: NDArray[np.float64], target_m: NDArray[np.float64], nudge_rad: NDArray[np.float64]
) -> RigidTransform:
    """world_from_body at a position whose nose points at a target, then turned by (roll, pitch, yaw)."""
    delta = target_m - position_m
    yaw, pitch = np.arctan2(delta[1], delta[0]), np.arctan2(-delta[2], np.hypot(delta[0], delta[1]))
    return RigidTransform.from_components(position_m, attitude(nudge_rad[0], pitch + nudge_rad[1], yaw + nudge_rad[2]))


def smooth_noise(phase: float, rng: np.random.Generator, waves: int = 4) -> float:
    """A sum of sines about 1 in size at a phase in 0..1, the same function for the same rng state."""
    amplitude, frequency, start = rng.normal(size=waves), rng.uniform(0.3, 6.0, waves), rng.uniform(0, 2 * np.pi, waves)
    return float(np.sum(amplitude * np.sin(2 * np.pi * frequency * phase + start)) / np.sqrt(waves / 2))


def approach_view(config: SimConfig, layout: Layout, index: int) -> Viewpoint:
    """Frame `index` of a final approach down the glideslope, frames equally spaced in time."""
    rng = np.random.default_rng([config.seed, 1])
    phase = index / max(config.frames - 1, 1)
    range_m = config.start_m + (config.end_m - config.start_m) * phase
    shrink = np.clip(range_m / config.start_m, 0.15, 1.0)  # a pilot closes the deviations
    lateral, vertical = 12.0 * shrink * smooth_noise(phase, rng) * 0.5, 4.0 * shrink * smooth_noise(phase, rng) * 0.5
    nudge = np.deg2rad([1.5, 0.5, 0.5]) * [smooth_noise(phase, rng) for _ in range(3)]
    along, right, _ = axes(*layout.centre_m)
    height = (range_m + TOUCHDOWN_M) * np.tan(GLIDESLOPE_RAD)
    height = max(height + vertical, RAMP_CLEARANCE_M)
    ramp = layout.centre_m[0]
    position = world_points(layout, (ramp - range_m * along + lateral * right)[None], height)[0]
    target = world_points(layout, (ramp + TOUCHDOWN_M * along)[None])[0]
    camera = Camera.from_fov(config.width, config.height, np.deg2rad(config.fov_deg))
    time_s = (config.start_m - range_m) / SPEED_M_S
    return Viewpoint(looking(position, target, nudge), camera, time_s)


def random_view(config: SimConfig, layout: Layout, index: int, rng: np.random.Generator) -> Viewpoint:
    """A view from somewhere around the glide path that shows enough of the runway, mostly more than half."""
    enough = 0.2 if rng.random() < 0.12 else 0.65
    for _ in range(40):
        view = draw_view(config, layout, index, rng)
        if runway_in_view(view, layout) >= enough:
            break
    return view


def runway_in_view(view: Viewpoint, layout: Layout) -> float:
    """Part of the two edge lines, measured along the deck, that lies inside the image, 0..1."""
    steps = np.linspace(0.0, 1.0, 12)[:, None]
    points = np.concatenate([line[0] + steps * (line[1] - line[0]) for line in (layout.left_m, layout.right_m)])
    optical = (view.world_from_body * camera_mount()).inv().apply(world_points(layout, points))
    pixels = view.camera.project(optical)
    with np.errstate(invalid="ignore"):
        inside = np.all((pixels >= 0) & (pixels <= [view.camera.width - 1, view.camera.height - 1]), axis=1)
    return float(inside.mean())


def draw_view(config: SimConfig, layout: Layout, index: int, rng: np.random.Generator) -> Viewpoint:
    """Range, elevation, lateral offset, roll and where in the image the runway shall be."""
    range_m, fov_rad = draw_range(config, layout, rng)
    along, right, length = axes(*layout.centre_m)
    elevation = np.deg2rad(rng.uniform(2.0, 8.0))
    height = max((range_m + TOUCHDOWN_M) * np.tan(elevation), RAMP_CLEARANCE_M)
    lateral = range_m * rng.uniform(-0.2, 0.2)
    ramp = layout.centre_m[0]
    position = world_points(layout, (ramp - range_m * along + lateral * right)[None], height)[0]
    target = world_points(layout, (ramp + rng.uniform(0.0, 0.5) * length * along)[None])[0]
    camera = Camera.from_fov(config.width, config.height, fov_rad)
    du, dv = np.clip(rng.normal(0.0, 0.22, 2), -0.45, 0.45) * [camera.width, camera.height]
    roll = np.deg2rad(np.clip(rng.normal(0.0, 4.0), -8.0, 8.0))
    nudge = np.array([roll, np.arctan(dv / camera.fy), -np.arctan(du / camera.fx)])
    return Viewpoint(looking(position, target, nudge), camera, float(index))


def draw_range(config: SimConfig, layout: Layout, rng: np.random.Generator) -> tuple[float, float]:
    """Distance to the ramp, m, and horizontal field of view, rad."""
    low, high = np.log(config.ranges_m)
    width = float(np.hypot(*(layout.right_m[0] - layout.left_m[0])))
    fixed = config.preset != "train" or config.fixed_fov
    for _ in range(100):
        range_m = float(np.exp(rng.uniform(low, high)))
        fov_rad = np.deg2rad(config.fov_deg if fixed else np.exp(rng.uniform(np.log(10.0), np.log(90.0))))
        apparent = width / (2 * range_m * np.tan(fov_rad / 2))
        if fixed or APPARENT_WIDTH[0] <= apparent <= APPARENT_WIDTH[1]:
            break
    return range_m, float(fov_rad)
