"""The calls that the server answers, by name. Each gets the service and the call's parameters.

A ValueError becomes the call's error answer; so does a wrong number of parameters, or another `vehicle` than the
world's, and an argument that asks for what is not simulated.
"""

import asyncio
import inspect
from collections.abc import Callable
from datetime import datetime
from difflib import get_close_matches
from typing import Any

from deckline.adapters.airsim.protocol import read_flag, read_number, read_vector
from deckline_sim.airsim_server.flight_commands import FLIGHT
from deckline_sim.airsim_server.image_requests import get_images, read_requests
from deckline_sim.airsim_server.scene_methods import SCENE_METHODS
from deckline_sim.airsim_server.service import Service, read_near_pose
from deckline_sim.airsim_server.settings import SCENE
from deckline_sim.airsim_server.sim_clock import SolarClock, read_time
from deckline_sim.airsim_server.structs import (
    Struct,
    camera_struct,
    collision_struct,
    geo_struct,
    kinematics_struct,
    multirotor_struct,
    pose_struct,
)

SERVER_VERSION = 4  # cosysairsim 3.5 asks for 4; classic airsim for 1
OLDEST_CLIENT = 1
WEATHER_PARAMETERS = ("Rain", "Roadwetness", "Snow", "RoadSnow", "MapleLeaf", "RoadLeaf", "Dust", "Fog", "Enabled")
WEATHER = {"Rain": "rain", "Roadwetness": "wet", "Fog": "fog"}  # those that are drawn, by their name in the state
PAUSE_POLL_S = 0.005
MOST_WIND_M_S = 100.0
NO_ROTORS = "the vehicle is kinematic, without thrust or rotors; moveByRollPitchYawZ leans it at a held height"
NO_LIDAR = "the vehicle has no lidar; DepthPerspective of simGetImages has the ranges of a camera's rays"
OWN_OBJECTS = "the scene's objects are the ship's own, which simListSceneObjects lists"
UNSUPPORTED = {  # AirSim's calls that have no counterpart here, and why
    **dict.fromkeys(("moveByRollPitchYawThrottle", "moveByRollPitchYawrateThrottle"), NO_ROTORS),
    **dict.fromkeys(("moveByAngleRatesZ", "moveByAngleRatesThrottle", "moveByMotorPWMs", "getRotorStates"), NO_ROTORS),
    **dict.fromkeys(("moveByManual", "moveByRC"), "there is no remote control; moveByVelocity flies by velocities"),
    **dict.fromkeys(("getLidarData", "getGPULidarData", "simSetLidarPose", "simSetGPULidarPose"), NO_LIDAR),
    **dict.fromkeys(("simSpawnObject", "simDestroyObject", "simSetObjectPose", "simSetObjectScale"), OWN_OBJECTS),
    "simAddVehicle": "one vehicle is simulated",
}


def enable_api_control(service: Service, enabled: bool, vehicle: str = "") -> None:
    """Without API control the vehicle brakes and hovers."""
    service.world.change(api_control=read_flag(enabled, "is_enabled"))
    if not enabled:
        service.world.vehicle.cancel()


def arm(service: Service, armed: bool, vehicle: str = "") -> bool:
    """Whether it was done: API control has to be on. A vehicle that is disarmed in the air hovers, and cannot fly."""
    armed, allowed = read_flag(armed, "arm"), service.world.state.api_control
    if allowed:
        service.world.change(armed=armed)
        if not armed:
            service.world.vehicle.cancel()
    return allowed


def reset(service: Service) -> None:
    service.world.reset()
    service.sensors.reset()


async def run_for(service: Service, seconds: float) -> None:
    """Run for a time; answer when it is over, or when another call pauses or resumes the time."""
    clock = service.world.clock
    clock.run_for(read_number(seconds, "seconds", 0.0, 1e6))
    run = clock.run
    while not clock.paused and clock.run is run:
        await asyncio.sleep(PAUSE_POLL_S)


def set_pose(service: Service, pose: Any, ignore_collision: bool = True, vehicle: str = "") -> None:
    """Set the vehicle's pose; a position or orientation with NaN stays as it is. It stays there until it flies."""
    if not read_flag(ignore_collision, "ignore_collision"):
        raise ValueError("ignore_collision False is not supported: the vehicle is put at the pose, whatever is there")
    service.world.vehicle.place(read_near_pose(pose, service.world.state.world_from_body))


def get_multirotor(service: Service, vehicle: str = "") -> Struct:
    motion = service.world.vehicle.read()
    return multirotor_struct(motion, service.world.settings.origin, service.world.clock.nanoseconds(motion.time_s))


def get_collision(service: Service, vehicle: str = "") -> Struct:
    """The last contact since the previous call."""
    collision, clock = service.world.vehicle.take_collision(), service.world.clock
    return collision_struct(collision, clock.nanoseconds(clock.seconds() if collision is None else collision.time_s))


def set_wind(service: Service, wind: Any) -> None:
    """Velocity of the air in the world, m/s."""
    service.world.vehicle.set_wind(read_vector(wind, "wind", MOST_WIND_M_S))


async def get_all_images(
    service: Service, requests: Any, vehicle: str = "", external: bool = False, annotation: str = ""
) -> list[Struct]:
    wanted = read_requests(requests, service.world.settings)
    responses: list[Struct] = await service.render(get_images, service.world, wanted)
    return responses


async def get_image(
    service: Service, camera: Any, image_type: int, vehicle: str = "", annotation: Any = "", external: bool = False
) -> bytes:
    """A PNG file."""
    responses = await get_all_images(service, [{"camera_name": str(camera), "image_type": image_type}])
    data: bytes = responses[0]["image_data_uint8"]
    return data


def get_camera(service: Service, camera: Any, vehicle: str = "", external: bool = False) -> Struct:
    world = service.world
    name = world.settings.find_camera(str(camera))
    return camera_struct(world.state.world_from_body * world.mount(name), world.camera(name, SCENE))


def set_camera_pose(service: Service, camera: Any, pose: Any, vehicle: str = "", external: bool = False) -> None:
    """Set a camera's mount on the vehicle; a position or orientation with NaN stays as it is."""
    world = service.world
    name = world.settings.find_camera(str(camera))
    world.change(mounts={**world.state.mounts, name: read_near_pose(pose, world.mount(name))})


def set_camera_fov(service: Service, camera: Any, fov_deg: float, vehicle: str = "", external: bool = False) -> None:
    """Horizontal field of view, degrees."""
    name = service.world.settings.find_camera(str(camera))
    service.world.change(
        fovs_deg={**service.world.state.fovs_deg, name: read_number(fov_deg, "fov_degrees", 1.0, 150.0)}
    )


def set_weather(service: Service, parameter: int, value: float) -> None:
    """Fog, rain and wetness, 0..1; a ValueError names a parameter that is not drawn."""
    value = read_number(value, "weather intensity", 0.0, 1.0)
    if isinstance(parameter, bool) or not isinstance(parameter, int) or not 0 <= parameter < len(WEATHER_PARAMETERS):
        last = len(WEATHER_PARAMETERS) - 1
        raise ValueError(f"a weather parameter is a number between 0 and {last}, got {parameter!r:.40}")
    name = WEATHER_PARAMETERS[parameter]
    if name == "Enabled":
        service.world.change(weather=value > 0.0)
    elif name in WEATHER:
        service.world.change(**{WEATHER[name]: value})
    else:
        raise ValueError(f"{name} ({parameter}) is not supported; {', '.join(WEATHER)} are")


def set_time_of_day(
    service: Service,
    enabled: bool,
    start: str = "",
    daylight_saving: bool = False,
    speed: float = 1.0,
    step_s: float = 60.0,
    move_sun: bool = True,
) -> None:
    """Sun or moon at a date and local solar time; without a date, of today's."""
    if not read_flag(enabled, "is_enabled"):
        service.world.change(solar_clock=None)
        return
    daylight_saving = read_flag(daylight_saving, "is_start_datetime_dst")
    date = datetime.now() if start == "" else read_time(start, daylight_saving)
    if not read_flag(move_sun, "move_sun"):
        raise ValueError("move_sun False is not supported: celestial_clock_speed 0 holds the sun at the date and time")
    speed = read_number(speed, "celestial_clock_speed", 0.0, 1e6)
    step_s = read_number(step_s, "update_interval_secs", 1e-3, 1e6)
    service.world.change(solar_clock=SolarClock(date, service.world.clock.seconds(), speed, step_s))


METHODS: dict[str, Callable[..., Any]] = {
    "ping": lambda service: True,
    "getServerVersion": lambda service: SERVER_VERSION,
    "getMinRequiredClientVersion": lambda service: OLDEST_CLIENT,
    "reset": reset,
    "enableApiControl": enable_api_control,
    "isApiControlEnabled": lambda service, vehicle="": service.world.state.api_control,
    "armDisarm": arm,
    "cancelLastTask": lambda service, vehicle="": service.world.vehicle.cancel(),
    "simPause": lambda service, paused: service.world.clock.pause(read_flag(paused, "is_paused")),
    "simIsPaused": lambda service: service.world.clock.paused,
    "simContinueForTime": run_for,
    "simSetWind": set_wind,
    "simGetVehiclePose": lambda service, vehicle="": pose_struct(service.world.state.world_from_body),
    "simSetVehiclePose": set_pose,
    "simGetGroundTruthKinematics": lambda service, vehicle="": kinematics_struct(service.world.vehicle.read()),
    "getMultirotorState": get_multirotor,
    "simGetCollisionInfo": get_collision,
    "getHomeGeoPoint": lambda service, vehicle="": geo_struct(service.world.home_m, service.world.settings.origin),
    "simGetImages": get_all_images,
    "simGetImage": get_image,
    "simGetCameraInfo": get_camera,
    "simSetCameraPose": set_camera_pose,
    "simSetCameraFov": set_camera_fov,
    "simSetFov": set_camera_fov,
    "simGetCurrentFieldOfView": lambda service, camera, vehicle="", external=False: get_camera(service, camera)["fov"],
    "simEnableWeather": lambda service, enabled: service.world.change(weather=read_flag(enabled, "enable")),
    "simSetWeatherParameter": set_weather,
    "simSetTimeOfDay": set_time_of_day,
    "startRecording": lambda service: service.recorder.start(),
    "stopRecording": lambda service: service.recorder.stop(),
    "isRecording": lambda service: service.recorder.is_on,
    "listVehicles": lambda service: [service.world.settings.vehicle],
    "getSettingsString": lambda service: service.world.settings.text,
}
METHODS |= SCENE_METHODS | FLIGHT
SIGNATURES = {name: inspect.signature(handler) for name, handler in METHODS.items()}


def is_flight(method: str) -> bool:
    """Whether clients call a method without waiting for its answer: a flight command, there or not."""
    return method in FLIGHT or method.startswith("moveBy")


async def call_method(service: Service, method: str, params: tuple[Any, ...]) -> Any:
    """The result of a call; a ValueError for a method or vehicle that is not here, and for wrong parameters."""
    if method in UNSUPPORTED:
        raise ValueError(f"{method} is not supported: {UNSUPPORTED[method]}")
    if method not in METHODS:
        near = ", ".join(get_close_matches(method[:80], METHODS)) or "none is like it"
        raise ValueError(f"no method {method!r:.80} here ({near}); docs/airsim.md lists the {len(METHODS)} there are")
    try:
        arguments = SIGNATURES[method].bind(service, *params).arguments
    except TypeError as error:
        raise ValueError(f"{method}: {len(params)} parameters: {error}") from None
    own = service.world.settings.vehicle
    try:
        if (vehicle := arguments.get("vehicle", "")) not in ("", own):
            raise ValueError(f"no vehicle {vehicle!r:.60}; there is {own!r}")
        if read_flag(arguments.get("external", False), "external"):
            raise ValueError("external True is not supported: all cameras are the vehicle's")
        result = METHODS[method](service, *params)
        return await result if inspect.isawaitable(result) else result
    except ValueError as error:
        raise ValueError(f"{method}: {' '.join(str(error).split())}") from None
