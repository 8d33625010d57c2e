"""AirSim's flight commands. Each is answered when it ends: True when it was completed, False when it timed out or was
cancelled by another command, `cancelLastTask`, `reset`, a new pose or contact. Speeds m/s, angles degrees, times s of
the simulation."""

import asyncio
import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from deckline.adapters.airsim.protocol import quote, read_flag, read_number, read_vector
from deckline.geometry import attitude
from deckline_sim.airsim_server.kinematics import Vector, Yaw, lean_of, towards, wrap
from deckline_sim.airsim_server.path import ARRIVED_M, follow
from deckline_sim.airsim_server.service import Service
from deckline_sim.airsim_server.structs import read_geo, vector_struct
from deckline_sim.airsim_server.vehicle import DRAG_PER_S, FOLLOW_PER_S, Vehicle, VehicleCommand
from deckline_sim.airsim_server.world import World

TICK_S = 0.02  # of the wall clock: between two checks of a running command
LONG_S = 3e38  # AirSim's endless timeout
STOPPED_M_S = 0.1
TAKEOFF_M, TAKEOFF_M_S = 3.0, 1.0
HOME_M_S = 5.0
LANDING_PER_S, LANDING_M_S = 0.3, (0.5, 5.0)  # speed of descent for each metre of height; least and most
TURNED_RAD_S = 0.01  # a slower turn has ended
MOST_LEAN_DEG = 25.0  # commanded: 4.6 m/s^2 of the vehicle's largest acceleration
MAX_POINTS, MOST_M, MOST_M_S, MOST_DEG = 10_000, 1e6, 1e4, 1e6
DRIVETRAINS = (0, 1)  # AirSim's MaxDegreeOfFreedom; ForwardOnly: the nose to the direction of flight
ADAPTIVE = 1.0  # AirSim's default: the cross-track error lengthens the lookahead by its whole

Maker = Callable[[Vehicle], VehicleCommand]
RATE_ZERO: Mapping[str, Any] = {"is_rate": True, "yaw_or_rate": 0.0}


async def fly(world: World, make: Maker) -> bool:
    """Start a command and wait for its end; a ValueError where the vehicle may not fly."""
    if not world.state.api_control:
        raise ValueError("API control is off: call enableApiControl(True) first")
    if not world.state.armed:
        raise ValueError("the vehicle is not armed: call armDisarm(True) first")
    command = world.vehicle.start(make)
    while command.result is None:
        await asyncio.sleep(TICK_S)
        world.vehicle.update()
    return command.result


async def take_off(service: Service, timeout: float = 20.0, vehicle: str = "") -> bool:
    return await fly(service.world, lambda body: climb(body, read_timeout(timeout)))


async def land(service: Service, timeout: float = 60.0, vehicle: str = "") -> bool:
    """Straight down."""

    def steer(body: Vehicle) -> Vector:
        least, most = LANDING_M_S
        return np.array([0.0, 0.0, min(max(LANDING_PER_S * body.ground.height_m, least), most)])

    command = VehicleCommand(steer, lambda body: body.landed, timeout_s=read_timeout(timeout), lands=True)
    return await fly(service.world, lambda body: command)


async def go_home(service: Service, timeout: float = LONG_S, vehicle: str = "") -> bool:
    """To where the vehicle started."""
    world = service.world
    return await fly(world, lambda body: follow(body, [world.home_m], HOME_M_S, read_timeout(timeout)))


async def hover(service: Service, vehicle: str = "") -> bool:
    """Brake, and hold the position."""
    command = VehicleCommand(lambda body: np.zeros(3), lambda body: float(np.linalg.norm(body.velocity)) < STOPPED_M_S)
    return await fly(service.world, lambda body: command)


async def move_on_path(
    service: Service,
    path: Any,
    speed: float,
    timeout: float = LONG_S,
    drivetrain: int = 0,
    yaw_mode: Any = RATE_ZERO,
    lookahead: float = -1.0,
    adaptive: float = 1.0,
    vehicle: str = "",
) -> bool:
    if not isinstance(path, list) or not 0 < len(path) <= MAX_POINTS:
        raise ValueError(f"path must be a list of 1 to {MAX_POINTS} positions, got {quote(path)}")
    if adaptive != ADAPTIVE:
        raise ValueError(f"adaptive_lookahead must be {ADAPTIVE:g}: nothing else is supported, got {adaptive!r:.40}")
    points = [read_vector(point, "path", MOST_M) for point in path]
    yaw = read_yaw(yaw_mode, drivetrain)
    ahead_m, speed = read_number(lookahead, "lookahead", -1.0, MOST_M), read_number(speed, "velocity", 0.01, MOST_M_S)
    if ahead_m == 0.0 or (yaw.is_rate and yaw.along):
        raise ValueError("lookahead cannot be 0" if ahead_m == 0.0 else "ForwardOnly takes no yaw rate")
    return await fly(service.world, lambda body: follow(body, points, speed, read_timeout(timeout), yaw, ahead_m))


async def move_to_point(
    service: Service,
    x: float,
    y: float,
    z: float,
    speed: float,
    timeout: float = LONG_S,
    drivetrain: int = 0,
    yaw_mode: Any = RATE_ZERO,
    lookahead: float = -1.0,
    adaptive: float = 1.0,
    vehicle: str = "",
    *,
    geographic: bool = False,
) -> bool:
    """`geographic`: x, y and z are latitude, deg, longitude, deg, and altitude, m."""
    point = {"x_val": x, "y_val": y, "z_val": z}
    if geographic:
        point = vector_struct(read_geo(x, y, z, service.world.settings.origin))
    return await move_on_path(service, [point], speed, timeout, drivetrain, yaw_mode, lookahead, adaptive)


async def move_to_z(
    service: Service,
    z: float,
    speed: float,
    timeout: float = LONG_S,
    yaw_mode: Any = RATE_ZERO,
    lookahead: float = -1.0,
    adaptive: float = 1.0,
    vehicle: str = "",
) -> bool:
    """Over the present position."""
    x, y, _ = service.world.vehicle.read().pose.translation.tolist()
    return await move_to_point(service, x, y, z, speed, timeout, 0, yaw_mode, lookahead, adaptive)


async def move_by_velocity(
    service: Service,
    vx: float,
    vy: float,
    vz: float,
    duration: float,
    drivetrain: int = 0,
    yaw_mode: Any = RATE_ZERO,
    vehicle: str = "",
    *,
    in_body: bool = False,
    at_z: bool = False,
) -> bool:
    """For a duration. `in_body`: forward and right of the present heading; `at_z`: `vz` is a height, world z."""
    across = [read_number(value, name, -MOST_M_S, MOST_M_S) for value, name in ((vx, "vx"), (vy, "vy"))]
    down = read_number(vz, "z" if at_z else "vz", *((-MOST_M, MOST_M) if at_z else (-MOST_M_S, MOST_M_S)))
    yaw, duration = read_yaw(yaw_mode, drivetrain), read_timeout(duration)

    def make(body: Vehicle) -> VehicleCommand:
        cos, sin = (math.cos(body.yaw), math.sin(body.yaw)) if in_body else (1.0, 0.0)
        level = [across[0] * cos - across[1] * sin, across[0] * sin + across[1] * cos]

        def steer(body: Vehicle) -> Vector:
            vertical = towards(np.array([0.0, 0.0, down - body.position[2]]), MOST_M_S)[2] if at_z else down
            return np.array([*level, vertical])

        return VehicleCommand(steer, yaw=yaw, timeout_s=duration, timed=True)

    return await fly(service.world, make)


async def move_by_attitude(
    service: Service,
    roll: float,
    pitch: float,
    yaw: float,
    z: float,
    duration: float,
    vehicle: str = "",
    *,
    by_rate: bool = False,
) -> bool:
    """Lean by roll and pitch, rad, at a height, world z, for a duration. `yaw`: heading, rad; `by_rate`: rad/s."""
    named = (("roll", roll), ("pitch", pitch), ("yaw", yaw))
    roll, pitch, yaw = (read_number(value, name, -MOST_DEG, MOST_DEG) for name, value in named)
    lean_deg = math.degrees(math.acos(math.cos(roll) * math.cos(pitch)))
    if lean_deg > MOST_LEAN_DEG:
        raise ValueError(
            f"roll and pitch lean it by {lean_deg:.1f} deg: the vehicle leans by {MOST_LEAN_DEG:g} at most"
        )
    z, turn, duration = read_number(z, "z", -MOST_M, MOST_M), Yaw(by_rate, yaw), read_timeout(duration)

    def steer(body: Vehicle) -> Vector:
        drag = DRAG_PER_S * (body.velocity - body.wind)[:2]
        across = body.velocity[:2] + (lean_of(attitude(roll, pitch, body.yaw)) - drag) / FOLLOW_PER_S
        return np.array([*across, towards(np.array([0.0, 0.0, z - body.position[2]]), MOST_M_S)[2]])

    return await fly(service.world, lambda body: VehicleCommand(steer, yaw=turn, timeout_s=duration, timed=True))


async def rotate_to_yaw(
    service: Service, yaw: float, timeout: float = LONG_S, margin: float = 5.0, vehicle: str = ""
) -> bool:
    angle = math.radians(read_number(yaw, "yaw", -MOST_DEG, MOST_DEG))
    margin = math.radians(read_number(margin, "margin", 0.0, 360.0)) + 1e-3

    def is_done(body: Vehicle) -> bool:
        return abs(wrap(body.yaw - angle)) <= margin and abs(body.yaw_rate) <= TURNED_RAD_S

    timeout = read_timeout(timeout)
    return await fly(
        service.world, lambda body: VehicleCommand(hold(body), is_done, Yaw(is_rate=False, value=angle), timeout)
    )


async def rotate_by_yaw_rate(service: Service, yaw_rate: float, duration: float, vehicle: str = "") -> bool:
    yaw = Yaw(value=math.radians(read_number(yaw_rate, "yaw_rate", -MOST_DEG, MOST_DEG)))
    duration = read_timeout(duration)
    return await fly(service.world, lambda body: VehicleCommand(hold(body), yaw=yaw, timeout_s=duration, timed=True))


def climb(body: Vehicle, timeout_s: float) -> VehicleCommand:
    """Straight up by TAKEOFF_M in the world, also from a moving deck."""
    goal = body.position[2] - TAKEOFF_M

    def steer(body: Vehicle) -> Vector:
        return towards(np.array([0.0, 0.0, goal - body.position[2]]), TAKEOFF_M_S)

    return VehicleCommand(steer, lambda body: abs(body.position[2] - goal) <= ARRIVED_M, timeout_s=timeout_s)


def hold(body: Vehicle) -> Callable[[Vehicle], Vector]:
    """Steers to the present position."""
    place = body.position
    return lambda body: towards(place - body.position, MOST_M_S)


def read_timeout(value: Any) -> float:
    return read_number(value, "timeout or duration", -math.inf, math.inf)


def read_yaw(mode: Any, drivetrain: Any) -> Yaw:
    """A YawMode and a DrivetrainType."""
    if isinstance(drivetrain, bool) or drivetrain not in DRIVETRAINS:
        raise ValueError(f"drivetrain must be 0 (MaxDegreeOfFreedom) or 1 (ForwardOnly), got {drivetrain!r:.40}")
    mode = mode if isinstance(mode, Mapping) else {}
    is_rate = read_flag(mode.get("is_rate"), "yaw_mode.is_rate")
    angle = math.radians(read_number(mode.get("yaw_or_rate"), "yaw_mode.yaw_or_rate", -MOST_DEG, MOST_DEG))
    return Yaw(is_rate, angle, along=bool(drivetrain))


FLIGHT: dict[str, Callable[..., Any]] = {
    "takeoff": take_off,
    "land": land,
    "goHome": go_home,
    "hover": hover,
    "moveOnPath": move_on_path,
    "moveToPosition": move_to_point,
    "moveToGPS": partial(move_to_point, geographic=True),
    "moveToZ": move_to_z,
    "moveByVelocity": move_by_velocity,
    "moveByVelocityZ": partial(move_by_velocity, at_z=True),
    "moveByVelocityBodyFrame": partial(move_by_velocity, in_body=True),
    "moveByVelocityZBodyFrame": partial(move_by_velocity, in_body=True, at_z=True),
    "moveByRollPitchYawZ": move_by_attitude,
    "moveByRollPitchYawrateZ": partial(move_by_attitude, by_rate=True),
    "rotateToYaw": rotate_to_yaw,
    "rotateByYawRate": rotate_by_yaw_rate,
}
