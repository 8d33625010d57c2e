"""Flights to the ship: final approaches and the paper's profile, in wind and gusts, with a pilot's deviations."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import RigidTransform

from deckline.geometry import Camera, camera_mount
from deckline_sim.config import FlightConfig, Pointing, SimConfig
from deckline_sim.flight.viewpoints import (
    RAMP_CLEARANCE_M,
    STILL,
    TOUCHDOWN_M,
    ShipMotion,
    Viewpoint,
    deck_rise,
    pose_towards,
    runway_point,
    steady_pose,
    steady_velocity,
)
from deckline_sim.ship.layout import Layout

# The paper's profile enters the landing track at 5 km, descends to 300 m, passes 60 m at 800 m, and glides down to the
# deck. Our reading: heights above the deck; it enters at 400 m and reaches 300 m at 4 km; the last glide ends at the
# touchdown point, which makes it 3.95 degrees.
PROFILE_M = ((5000.0, 400.0), (4000.0, 300.0), (800.0, 60.0), (-TOUCHDOWN_M, 0.0))  # distance to the ramp, height
HOLDING_M = (10000.0, PROFILE_M[0][1])  # of the paper's holding track; our reading of its height
PAPERS_M = {"profile": PROFILE_M, "landing": (HOLDING_M, *PROFILE_M)}  # by trajectory
STEP_S = 0.01  # half the step over which velocities are taken
DEVIATION_M = (6.0, 2.0)  # how far a flown path strays to the side and in height
SHAKE_RAD = np.deg2rad([1.5, 0.5, 0.5])  # of roll, pitch and yaw
CLOSED = 0.7  # part of an approach after which the pilot has closed the first offsets; our choice
GUST_SCALE_M = 200.0  # Dryden length at 50 m height (202 m): MIL-F-8785C, low-altitude model
GUST_HZ = (0.02, 0.6)  # slower gusts are wind, faster ones an aircraft does not follow
GUST_WAVES = 24
PILOT_RAD_S = 0.5  # rate at which a pilot corrects a displacement; our choice
ROLL_PER_GUST = 0.02  # rad of roll for 1 m/s of side gust; our choice
WANDER_WAVES = 4
WANDER_HZ = (0.02, 0.1)  # of a flown path about the nominal one
SHAKE_HZ = (0.05, 0.4)  # of the attitude


@dataclass(frozen=True)
class ApproachFlight:
    """Speed, wind, offsets and turbulence of one flight, all random choices made."""

    speed_m_s: float
    headwind_m_s: float
    crosswind_m_s: float
    lateral_offset_m: float
    vertical_offset_m: float
    turbulence_m_s: float


@dataclass(frozen=True, eq=False)
class ApproachPath:
    """One flight from its first to its last frame."""

    layout: Layout  # of the ship as it lies at time 0
    motion: ShipMotion
    flight: ApproachFlight
    pointing: Pointing
    seed: int
    start_m: float  # distance to the ramp
    end_m: float
    height_m: Callable[[float], float]  # above the deck at a distance to the ramp
    closing_m_s: float  # over the deck, along the centre line
    wind_m_s: NDArray[np.float64]  # (2,) over the water, world
    touchdown_m: float  # beyond the ramp

    @property
    def duration_s(self) -> float:
        return (self.start_m - self.end_m) / self.closing_m_s


def approach_view(config: SimConfig, layout: Layout, index: int, motion: ShipMotion = STILL) -> Viewpoint:
    """Frame `index` of a final approach or of the paper's flight.

    Frames are equally spaced in time, those of a `landing` in the logarithm of the distance to the ramp: most of a
    flight from 10 km is far away. `profile` and `landing` start at 5 and 10 km whatever `start_m` is; the flight out is
    left out.

    Args:
        layout: the ship as it lies at time 0.

    Raises:
        ValueError: wind or ship too fast for the aircraft, or a flight that ends before it begins.
    """
    path = flight_path(config, layout, motion)
    part = index / max(config.frames - 1, 1)
    if config.trajectory == "landing":
        part = (path.start_m - path.start_m * (path.end_m / path.start_m) ** part) / (path.start_m - path.end_m)
    time_s = path.duration_s * part
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


def flight_path(config: SimConfig, layout: Layout, motion: ShipMotion) -> ApproachPath:
    """The flight of a recording, all random choices made; errors as for `approach_view`."""
    points_m, slope = PAPERS_M.get(config.trajectory), np.tan(np.deg2rad(config.flight.glideslope_deg))
    touchdown_m = config.flight.touchdown_m if points_m is None else TOUCHDOWN_M
    pointing: Pointing = config.flight.pointing or ("ahead" if points_m is None else "runway")
    start_m = config.start_m if points_m is None else points_m[0][0]
    if not config.end_m < start_m:
        raise ValueError(f"trajectory {config.trajectory} begins at {start_m:g} m, got end_m {config.end_m:g}")
    flight = draw_flight(config.flight, config.preset == "train", np.random.default_rng([config.seed, 5]))
    along = landing_direction(layout)
    wind = -flight.headwind_m_s * along - flight.crosswind_m_s * np.array([-along[1], along[0]])
    closing = closing_speed(along, steady_velocity(layout, motion)[:2], wind, flight.speed_m_s)
    height_m = (lambda range_m: (range_m + touchdown_m) * slope) if points_m is None else profile_height(points_m)
    return ApproachPath(
        layout, motion, flight, pointing, config.seed, start_m, config.end_m, height_m, closing, wind, touchdown_m
    )


def profile_height(points_m: tuple[tuple[float, float], ...] = PROFILE_M) -> Callable[[float], float]:
    """Height, m, at a distance to the ramp: through a flight's points, without a kink, straight to the last one."""
    points = np.array(points_m)
    slopes = np.diff(points[:, 1]) / np.diff(points[:, 0])
    between = np.where(slopes[:-1] == 0, 0.0, (slopes[:-1] + slopes[1:]) / 2)  # a level track stays level
    at_points = np.array([slopes[0], *between[:-1], slopes[-1], slopes[-1]])
    return CubicHermiteSpline(points[::-1, 0], points[::-1, 1], at_points[::-1])


def draw_flight(config: FlightConfig, train: bool, rng: np.random.Generator) -> ApproachFlight:
    """Numbers that the configuration leaves open; `train`: as preset `train` has them."""
    drawn = {
        "headwind_m_s": rng.uniform(0.0, 12.0),
        "crosswind_m_s": np.clip(rng.normal(0.0, 4.0), -12.0, 12.0),
        "lateral_offset_m": rng.normal(0.0, 20.0),
        "vertical_offset_m": rng.normal(0.0, 4.0),
        "turbulence_m_s": rng.uniform(0.0, 2.0),
    }
    chosen = {name: getattr(config, name) for name in drawn}
    open_ones = {name: float(drawn[name]) if train else 0.0 for name, value in chosen.items() if value is None}
    return ApproachFlight(config.speed_m_s, **(chosen | open_ones))


def closing_speed(
    along: NDArray[np.float64], ship_m_s: NDArray[np.float64], wind_m_s: NDArray[np.float64], speed_m_s: float
) -> float:
    """Speed, m/s, over the moving deck along a unit vector (2,) for an aircraft of a speed through the air.

    Solves |ship + c along - wind| = speed.

    Args:
        ship_m_s, wind_m_s: horizontal velocities (2,) over the water.

    Raises:
        ValueError: the wind is too strong for that speed.
    """
    drift = ship_m_s - wind_m_s
    ahead = float(drift @ along)
    inside = ahead**2 - float(drift @ drift) + speed_m_s**2
    closing = -ahead + np.sqrt(max(inside, 0.0))
    if inside < 0 or closing < 1.0:
        raise ValueError(
            f"an aircraft of {speed_m_s:g} m/s cannot approach a deck that moves at "
            f"{np.linalg.norm(drift):.1f} m/s through the air: choose less wind or a slower ship"
        )
    return float(closing)


def remaining_offset(phase: float) -> float:
    """Part of the first offset that is left at a part 0..1 of the way; its rate starts and ends at 0."""
    x = float(np.clip(phase / CLOSED, 0.0, 1.0))
    return 1.0 - x**3 * (10.0 - 15.0 * x + 6.0 * x * x)


def wander(time_s: float, band_hz: tuple[float, float], rng: np.random.Generator) -> float:
    """A sum of sines about 1 in size at a time, the same function for the same rng state."""
    size = WANDER_WAVES
    amplitude, frequency, start = rng.normal(size=size), rng.uniform(*band_hz, size), rng.uniform(0, 2 * np.pi, size)
    return float(np.sum(amplitude * np.sin(2 * np.pi * frequency * time_s + start)) / np.sqrt(size / 2))


def gust(time_s: float, sigma_m_s: float, speed_m_s: float, rng: np.random.Generator) -> tuple[float, float]:
    """Gust along one axis, m/s, and how far it has moved the aircraft, m, the same function for the same rng state.

    Sines with the amplitudes of Dryden's longitudinal spectrum (MIL-F-8785C), scaled to the sigma inside the band. The
    aircraft moves with a gust and its pilot corrects the displacement, so slow gusts do not add up.
    """
    edges = 2 * np.pi * np.geomspace(*GUST_HZ, GUST_WAVES + 1)
    omega = np.sqrt(edges[:-1] * edges[1:])
    power = np.diff(edges) / (1.0 + (GUST_SCALE_M / speed_m_s * omega) ** 2)
    amplitude = sigma_m_s * np.sqrt(2.0 * power / power.sum())
    angle = omega * time_s + rng.uniform(0.0, 2 * np.pi, GUST_WAVES)
    velocity = np.sum(amplitude * np.sin(angle))
    moved = np.sum(amplitude * (PILOT_RAD_S * np.sin(angle) - omega * np.cos(angle)) / (PILOT_RAD_S**2 + omega**2))
    return float(velocity), float(moved)


def landing_direction(layout: Layout) -> NDArray[np.float64]:
    """Unit vector (2,) of the centre line in the world, seen from above."""
    delta = (runway_point(layout, 1.0) - runway_point(layout, 0.0))[:2]
    return delta / np.hypot(*delta)


def pose_at(path: ApproachPath, time_s: float) -> tuple[RigidTransform, RigidTransform]:
    """world_from_body and body_from_camera at a time."""
    position, shake = position_at(path, time_s), shake_at(path, time_s)
    target = runway_point(steady_layout(path, time_s), path.touchdown_m)
    if path.pointing == "ahead":
        shake[2] += crab_angle(path)
        return pose_towards(position, target, shake), camera_mount()
    through_air = (position_at(path, time_s + STEP_S) - position_at(path, time_s - STEP_S)) / (2 * STEP_S)
    through_air[:2] -= path.wind_m_s
    body = pose_towards(position, position + through_air, shake)
    gaze = pose_towards(position, target, np.zeros(3)) * camera_mount()
    return body, RigidTransform.from_components(np.zeros(3), body.rotation.inv() * gaze.rotation)


def position_at(path: ApproachPath, time_s: float) -> NDArray[np.float64]:
    """Position (3,) in the world at a time."""
    rng = np.random.default_rng([path.seed, 1])
    flight, left = path.flight, remaining_offset(time_s / path.duration_s)
    range_m = path.start_m - path.closing_m_s * time_s
    shrink = np.clip(range_m / path.start_m, 0.15, 1.0)  # a pilot closes the deviations
    lateral, vertical = (shrink * size * wander(time_s, WANDER_HZ, rng) for size in DEVIATION_M)
    (_, aside), (_, up) = gusts_at(path, time_s)
    height = path.height_m(range_m) + vertical + left * flight.vertical_offset_m + up
    lowest = RAMP_CLEARANCE_M + deck_rise(path.layout, path.motion, time_s, path.layout.centre_m[0])
    lateral += left * flight.lateral_offset_m + aside
    return runway_point(steady_layout(path, time_s), -range_m, lateral, max(height, lowest))


def shake_at(path: ApproachPath, time_s: float) -> NDArray[np.float64]:
    """Deviation (3,) of roll, pitch and yaw, rad, at a time."""
    rng = np.random.default_rng([path.seed, 6])
    (side, _), (rise, _) = gusts_at(path, time_s)
    turned = np.array([ROLL_PER_GUST * side, -rise / path.flight.speed_m_s, -side / path.flight.speed_m_s])
    return turned + SHAKE_RAD * [wander(time_s, SHAKE_HZ, rng) for _ in range(3)]


def gusts_at(path: ApproachPath, time_s: float) -> list[tuple[float, float]]:
    """Gust, m/s, and displacement, m, to the right and upwards at a time."""
    rng = np.random.default_rng([path.seed, 7])
    return [gust(time_s, path.flight.turbulence_m_s, path.flight.speed_m_s, rng) for _ in range(2)]


def steady_layout(path: ApproachPath, time_s: float) -> Layout:
    """The ship where it has sailed to, without its roll, pitch and heave, which an aircraft does not follow."""
    return path.layout.at_pose(steady_pose(path.layout, path.motion, time_s))


def crab_angle(path: ApproachPath) -> float:
    """How far the nose points to the right of the way over the deck, rad."""
    along = landing_direction(path.layout)
    ship = steady_velocity(path.layout, path.motion)[:2]
    through_air = ship + path.closing_m_s * along - path.wind_m_s
    return float(np.arctan2(along[0] * through_air[1] - along[1] * through_air[0], through_air @ along))
