"""The calls that the server answers, by name. Each gets the service and the call's parameters.

A ValueError becomes the call's error answer; so does a wrong number of parameters, or another `vehicle` than the
world's. Parameters of AirSim that make no difference here are accepted and ignored.
"""

import inspect
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from deckline.adapters.airsim.clock import SolarClock, read_time
from deckline.adapters.airsim.images import Recorder, get_images, read_requests
from deckline.adapters.airsim.protocol import (
    Struct,
    camera_struct,
    geo_struct,
    kinematics_struct,
    multirotor_struct,
    pose_struct,
    read_flag,
    read_number,
    read_pose,
    unknown_pose_struct,
)
from deckline.adapters.airsim.settings import SCENE
from deckline.adapters.airsim.world import World

SERVER_VERSION = 4  # cosysairsim 3.5 asks for 4; classic airsim for 1
OLDEST_CLIENT = 1
SHIP = "Carrier"  # name of the ship's object: x forward, y starboard, z down, origin on the deck's stern
WEATHER = {0: "rain", 1: "wet", 7: "fog"}  # AirSim's WeatherParameter, those that have an effect
ENABLED = 8
WITHOUT_EFFECT = {2: "Snow", 3: "RoadSnow", 4: "MapleLeaf", 5: "RoadLeaf", 6: "Dust"}
FARTHEST_M = 1e6  # a position beyond this is a mistake, and more than the renderer's single precision can place


@dataclass(frozen=True, eq=False)
class Service:
    """What calls act on."""

    world: World
    render: Callable[..., Awaitable[Any]]  # do something on the world's thread, behind the work that waits there
    recorder: Recorder
    log: Callable[[str], None]

    def change(self, **values: Any) -> None:
        """Set parts of the world's state."""
        self.world.state = replace(self.world.state, **values)


def set_pose(service: Service, pose: Any, ignore_collision: bool = True, vehicle: str = "") -> None:
    """Put the vehicle somewhere; NaN keeps its position, its orientation or both."""
    service.change(world_from_body=_read_near_pose(pose, service.world.state.world_from_body))


def get_multirotor(service: Service, vehicle: str = "") -> Struct:
    time_ns = service.world.clock.nanoseconds(service.world.clock.seconds())
    return multirotor_struct(service.world.state.world_from_body, service.world.settings.origin, time_ns)


def get_object_pose(service: Service, name: str, ned: bool = True) -> Struct:
    """world_from_ship now; NaN for any other object, as AirSim answers."""
    if name != SHIP:
        service.log(f"simGetObjectPose: no object {name!r:.60}, only {SHIP!r}")
        return unknown_pose_struct()
    return pose_struct(service.world.ship_pose())


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
    """Mount a camera elsewhere on the vehicle; NaN keeps as for the vehicle."""
    world = service.world
    name = world.settings.find_camera(str(camera))
    service.change(mounts={**world.state.mounts, name: _read_near_pose(pose, world.mount(name))})


def set_camera_fov(service: Service, camera: Any, fov_deg: float, vehicle: str = "", external: bool = False) -> None:
    """Horizontal field of view, degrees."""
    name = service.world.settings.find_camera(str(camera))
    service.change(fovs_deg={**service.world.state.fovs_deg, name: read_number(fov_deg, "fov_degrees", 1.0, 150.0)})


def set_weather(service: Service, parameter: int, value: float) -> None:
    """Fog, rain and wetness, 0..1."""
    value = read_number(value, "weather intensity", 0.0, 1.0)
    if isinstance(parameter, bool) or not isinstance(parameter, int) or not 0 <= parameter <= ENABLED:
        raise ValueError(f"a weather parameter is a number between 0 and {ENABLED}, got {parameter!r:.40}")
    if parameter in WEATHER:
        service.change(**{WEATHER[parameter]: value})
    elif parameter == ENABLED:
        service.change(weather=value > 0.0)
    else:
        service.log(f"simSetWeatherParameter: {WITHOUT_EFFECT[parameter]} has no effect here")


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
        service.change(solar_clock=None)
        return
    date = datetime.now() if start == "" else read_time(start)
    speed = read_number(speed, "celestial_clock_speed", 0.0, 1e6) if move_sun else 0.0
    step_s = read_number(step_s, "update_interval_secs", 1e-3, 1e6)
    service.change(solar_clock=SolarClock(date, service.world.clock.seconds(), speed, step_s))


METHODS: dict[str, Callable[..., Any]] = {
    "ping": lambda service: True,
    "getServerVersion": lambda service: SERVER_VERSION,
    "getMinRequiredClientVersion": lambda service: OLDEST_CLIENT,
    "reset": lambda service: service.world.reset(),
    "enableApiControl": lambda service, enabled, vehicle="": service.change(
        api_control=read_flag(enabled, "is_enabled")
    ),
    "isApiControlEnabled": lambda service, vehicle="": service.world.state.api_control,
    "armDisarm": lambda service, armed, vehicle="": read_flag(armed, "arm") or True,  # there are no motors
    "simPause": lambda service, paused: service.world.clock.pause(read_flag(paused, "is_paused")),
    "simIsPaused": lambda service: service.world.clock.paused,
    "simContinueForTime": lambda service, seconds: service.world.clock.run_for(
        read_number(seconds, "seconds", 0.0, 1e6)
    ),
    "simGetVehiclePose": lambda service, vehicle="": pose_struct(service.world.state.world_from_body),
    "simSetVehiclePose": set_pose,
    "simGetGroundTruthKinematics": lambda service, vehicle="": kinematics_struct(service.world.state.world_from_body),
    "getMultirotorState": get_multirotor,
    "getHomeGeoPoint": lambda service, vehicle="": geo_struct((0.0, 0.0, 0.0), service.world.settings.origin),
    "simGetObjectPose": get_object_pose,
    "simGetImages": get_all_images,
    "simGetImage": get_image,
    "simGetCameraInfo": get_camera,
    "simSetCameraPose": set_camera_pose,
    "simSetCameraFov": set_camera_fov,
    "simSetFov": set_camera_fov,
    "simGetCurrentFieldOfView": lambda service, camera, vehicle="", external=False: get_camera(service, camera)["fov"],
    "simEnableWeather": lambda service, enabled: service.change(weather=read_flag(enabled, "enable")),
    "simSetWeatherParameter": set_weather,
    "simSetTimeOfDay": set_time_of_day,
    "startRecording": lambda service: service.recorder.start(),
    "stopRecording": lambda service: service.recorder.stop(),
    "isRecording": lambda service: service.recorder.is_on,
    "listVehicles": lambda service: [service.world.settings.vehicle],
    "getSettingsString": lambda service: service.world.settings.text,
}
SIGNATURES = {name: inspect.signature(handler) for name, handler in METHODS.items()}


async def call_method(service: Service, method: str, params: tuple[Any, ...]) -> Any:
    """The result of a call; a ValueError for an unknown method or vehicle and for wrong parameters."""
    if method not in METHODS:
        raise ValueError(f"no method {method!r:.80}; there are {len(METHODS)}: {', '.join(sorted(METHODS))}")
    try:
        arguments = SIGNATURES[method].bind(service, *params).arguments
    except TypeError as error:
        raise ValueError(f"{method}: {len(params)} parameters: {error}") from None
    own = service.world.settings.vehicle
    try:
        if (vehicle := arguments.get("vehicle", "")) not in ("", own):
            raise ValueError(f"no vehicle {vehicle!r:.60}; there is {own!r}")
        result = METHODS[method](service, *params)
        return await result if inspect.isawaitable(result) else result
    except ValueError as error:
        raise ValueError(f"{method}: {' '.join(str(error).split())}") from None


def _read_near_pose(value: Any, default: RigidTransform) -> RigidTransform:
    """A pose that can be rendered; parts with NaN are those of `default`."""
    pose = read_pose(value, "pose", default)
    if np.abs(pose.translation).max() > FARTHEST_M:
        position = pose.translation.tolist()
        raise ValueError(f"pose: position {position} is farther than {FARTHEST_M:g} m from the origin")
    return pose
