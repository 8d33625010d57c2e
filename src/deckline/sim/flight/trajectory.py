"""Where the aircraft is on a flight to the ship: final approaches, and the paper's profile."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import RigidTransform

from deckline.geometry import Camera, camera_mount
from deckline.sim.config import SimConfig
from deckline.sim.flight.flight import (
    AS_STATED,
    ROLL_PER_GUST,
    SHAKE_HZ,
    WANDER_HZ,
    Flight,
    FlightConfig,
    Pointing,
    closing_speed,
    draw_flight,
    gust,
    offset_left,
    wander,
)
from deckline.sim.flight.motion import STILL, Motion, deck_rise, steady_pose, steady_velocity
from deckline.sim.flight.random_views import RAMP_CLEARANCE_M, TOUCHDOWN_M
from deckline.sim.flight.viewpoint import Viewpoint, looking, runway_point
from deckline.sim.ship.layout import Layout

# The paper's profile (SPEC section 5): it enters the landing track at 5 km, descends to 300 m, passes 60 m at 800 m,
# and glides down to the deck. Our reading: heights above the deck; it enters at 400 m and reaches 300 m at 4 km; the
# last glide ends at the touchdown point, which makes it 3.95 degrees.
PROFILE_M = ((5000.0, 400.0), (4000.0, 300.0), (800.0, 60.0), (-TOUCHDOWN_M, 0.0))  # distance to the ramp, height
STEP_S = 0.01  # half the step over which velocities are taken
DEVIATION_M = (6.0, 2.0)  # how far a flown path strays to the side and in height
SHAKE_RAD = np.deg2rad([1.5, 0.5, 0.5])  # of roll, pitch and yaw


@dataclass(frozen=True, eq=False)
class Path:
    """One flight from its first to its last frame."""

    layout: Layout  # the ship as it lies at time 0
    motion: Motion
    flight: Flight
    pointing: Pointing
    seed: int
    start_m: float  # distance to the ramp
    end_m: float
    height_m: Callable[[float], float]  # above the deck at a distance to the ramp
    closing_m_s: float  # over the deck, along the centre line
    wind_m_s: NDArray[np.float64]  # (2,) over the water, world

    @property
    def duration_s(self) -> float:
        return (self.start_m - self.end_m) / self.closing_m_s


def approach_view(
    config: SimConfig, layout: Layout, index: int, flight: FlightConfig = AS_STATED, motion: Motion = STILL
) -> Viewpoint:
    """Frame `index` of a final approach down the glideslope, frames equally spaced in time.

    Args:
        layout: the ship as it lies at time 0.
    """
    slope = np.tan(np.deg2rad(flight.glideslope_deg))
    path = flight_path(
        config, layout, flight, motion, "ahead", config.start_m, lambda range_m: (range_m + TOUCHDOWN_M) * slope
    )
    return path_view(config, path, index)


def profile_view(
    config: SimConfig, layout: Layout, index: int, flight: FlightConfig = AS_STATED, motion: Motion = STILL
) -> Viewpoint:
    """Frame `index` of the paper's profile from 5 km, frames equally spaced in time.

    The flight out to 10 km and back, during which the paper's aircraft sees no deck, is left out. `start_m` of the
    configuration has no say, `end_m` has.

    Args:
        layout: the ship as it lies at time 0.
    """
    path = flight_path(config, layout, flight, motion, "runway", PROFILE_M[0][0], profile_height())
    return path_view(config, path, index)


def profile_height() -> Callable[[float], float]:
    """Height, m, at a distance to the ramp: through the profile's points, straight after the third, without a kink."""
    points = np.array(PROFILE_M)
    slopes = np.diff(points[:, 1]) / np.diff(points[:, 0])
    at_points = [slopes[0], (slopes[0] + slopes[1]) / 2, slopes[2], slopes[2]]
    return CubicHermiteSpline(points[::-1, 0], points[::-1, 1], at_points[::-1])


def flight_path(
    config: SimConfig,
    layout: Layout,
    flight: FlightConfig,
    motion: Motion,
    pointing: Pointing,
    start_m: float,
    height_m: Callable[[float], float],
) -> Path:
    """The flight of a recording, all random choices made; `pointing` unless the flight says it.

    Raises:
        ValueError: wind or ship too fast for the aircraft, or a flight that ends before it begins.
    """
    if not config.end_m < start_m:
        raise ValueError(f"trajectory {config.trajectory} begins at {start_m:g} m, got end_m {config.end_m:g}")
    drawn = draw_flight(flight, config.preset == "train", np.random.default_rng([config.seed, 5]))
    along = landing_direction(layout)
    wind = -drawn.headwind_m_s * along - drawn.crosswind_m_s * np.array([-along[1], along[0]])
    ship = steady_velocity(layout, motion)[:2]
    closing = closing_speed(along, ship, wind, drawn.speed_m_s)
    return Path(
        layout, motion, drawn, flight.pointing or pointing, config.seed, start_m, config.end_m, height_m, closing,
        wind,
    )  # fmt: skip


def landing_direction(layout: Layout) -> NDArray[np.float64]:
    """Unit vector (2,) of the centre line in the world, seen from above."""
    delta = (runway_point(layout, 1.0) - runway_point(layout, 0.0))[:2]
    return delta / np.hypot(*delta)


def path_view(config: SimConfig, path: Path, index: int) -> Viewpoint:
    """Frame `index` of a flight."""
    time_s = path.duration_s * index / max(config.frames - 1, 1)
    camera = Camera.from_fov(config.width, config.height, np.deg2rad(config.fov_deg))
    (body, mount), before, after = (pose_at(path, time_s + step) for step in (0.0, -STEP_S, STEP_S))
    turned = (before[0] * before[1]).rotation.inv() * (after[0] * after[1]).rotation
    return Viewpoint(
        body,
        camera,
        time_s,
        body_from_camera=mount,
        velocity_m_s=(after[0].translation - before[0].translation) / (2 * STEP_S),
        angular_rate_rad_s=mount.rotation.apply(turned.as_rotvec()) / (2 * STEP_S),
    )


def pose_at(path: Path, time_s: float) -> tuple[RigidTransform, RigidTransform]:
    """world_from_body and body_from_camera at a time."""
    position, shake = position_at(path, time_s), shake_at(path, time_s)
    target = runway_point(steady_layout(path, time_s), TOUCHDOWN_M)
    if path.pointing == "ahead":
        shake[2] += crab_angle(path)
        return looking(position, target, shake), camera_mount()
    through_air = (position_at(path, time_s + STEP_S) - position_at(path, time_s - STEP_S)) / (2 * STEP_S)
    through_air[:2] -= path.wind_m_s
    body = looking(position, position + through_air, shake)
    gaze = looking(position, target, np.zeros(3)) * camera_mount()
    return body, RigidTransform.from_components(np.zeros(3), body.rotation.inv() * gaze.rotation)


def position_at(path: Path, time_s: float) -> NDArray[np.float64]:
    """Position (3,) in the world at a time."""
    rng = np.random.default_rng([path.seed, 1])
    flight, left = path.flight, offset_left(time_s / path.duration_s)
    range_m = path.start_m - path.closing_m_s * time_s
    shrink = np.clip(range_m / path.start_m, 0.15, 1.0)  # a pilot closes the deviations
    lateral, vertical = (shrink * size * wander(time_s, WANDER_HZ, rng) for size in DEVIATION_M)
    (_, aside), (_, up) = gusts_at(path, time_s)
    height = path.height_m(range_m) + vertical + left * flight.vertical_offset_m + up
    lowest = RAMP_CLEARANCE_M + deck_rise(path.layout, path.motion, time_s, path.layout.centre_m[0])
    lateral += left * flight.lateral_offset_m + aside
    return runway_point(steady_layout(path, time_s), -range_m, lateral, max(height, lowest))


def shake_at(path: Path, time_s: float) -> NDArray[np.float64]:
    """Roll, pitch and yaw (3,) by which the attitude strays at a time."""
    rng = np.random.default_rng([path.seed, 6])
    (side, _), (rise, _) = gusts_at(path, time_s)
    turned = np.array([ROLL_PER_GUST * side, -rise / path.flight.speed_m_s, -side / path.flight.speed_m_s])
    return turned + SHAKE_RAD * [wander(time_s, SHAKE_HZ, rng) for _ in range(3)]


def gusts_at(path: Path, time_s: float) -> list[tuple[float, float]]:
    """Gust, m/s, and displacement, m, to the right and upwards at a time."""
    rng = np.random.default_rng([path.seed, 7])
    return [gust(time_s, path.flight.turbulence_m_s, path.flight.speed_m_s, rng) for _ in range(2)]


def steady_layout(path: Path, time_s: float) -> Layout:
    """The ship where it has sailed to, without its roll, pitch and heave, which an aircraft does not follow."""
    return path.layout.posed(steady_pose(path.layout, path.motion, time_s))


def crab_angle(path: Path) -> float:
    """How far the nose points to the right of the way over the deck, rad."""
    along = landing_direction(path.layout)
    ship = steady_velocity(path.layout, path.motion)[:2]
    through_air = ship + path.closing_m_s * along - path.wind_m_s
    return float(np.arctan2(along[0] * through_air[1] - along[1] * through_air[0], through_air @ along))
