"""The calls that the server answers, by name. Each gets the service and the call's parameters.

A ValueError becomes the call's error answer; so does a wrong number of parameters. Parameters that AirSim has and that
make no difference here are taken and left alone.
"""

import asyncio
import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any

from deckline.adapters.airsim.daytime import Daytime, read_time
from deckline.adapters.airsim.images import read_request, read_requests, recorded_frame, take_images
from deckline.adapters.airsim.recorder import Recorder
from deckline.adapters.airsim.settings import SCENE
from deckline.adapters.airsim.structs import (
    Struct,
    camera_info,
    geo_point,
    kinematics,
    multirotor_state,
    no_pose,
    pose_struct,
    read_pose,
    real,
)
from deckline.adapters.airsim.world import World
from deckline.types import Frame

SERVER_VERSION = 4  # cosysairsim 3.5 asks for 4; classic airsim for 1
OLDEST_CLIENT = 1
SHIP = "Carrier"  # name of the ship's object: x forward, y starboard, z down, origin on the deck's stern
PARAMETERS = {0: "rain", 1: "wet", 7: "fog"}  # AirSim's WeatherParameter, those that have an effect
ENABLED = 8
WITHOUT_EFFECT = {2: "Snow", 3: "RoadSnow", 4: "MapleLeaf", 5: "RoadLeaf", 6: "Dust"}


@dataclass(frozen=True, eq=False)
class Service:
    """What calls act on."""

    world: World
    renderer: Executor  # one thread: the world's own
    recorder: Recorder
    log: Callable[[str], None]

    async def on_renderer(self, work: Callable[..., Any], *args: Any) -> Any:
        """Do something on the world's thread, behind what waits there already."""
        return await asyncio.get_running_loop().run_in_executor(self.renderer, work, *args)

    async def frame(self) -> Frame:
        """What the recorded camera sees now."""
        frame: Frame = await self.on_renderer(recorded_frame, self.world)
        return frame

    def change(self, **values: Any) -> None:
        """Set parts of the world's state."""
        self.world.state = replace(self.world.state, **values)


def get_pose(service: Service, vehicle: str = "") -> Struct:
    """world_from_body."""
    _vehicle(service, vehicle)
    return pose_struct(service.world.state.world_from_body)


def set_pose(service: Service, pose: Any, ignore_collision: bool = True, vehicle: str = "") -> None:
    """Put the vehicle somewhere; NaN keeps its position, its orientation or both."""
    _vehicle(service, vehicle)
    service.change(world_from_body=read_pose(pose, service.world.state.world_from_body))


def get_kinematics(service: Service, vehicle: str = "") -> Struct:
    """The true pose; the vehicle has no speed."""
    _vehicle(service, vehicle)
    return kinematics(service.world.state.world_from_body)


def get_multirotor(service: Service, vehicle: str = "") -> Struct:
    """The whole state of a vehicle in flight."""
    _vehicle(service, vehicle)
    time_ns = service.world.clock.nanoseconds(service.world.clock.seconds())
    return multirotor_state(service.world.state.world_from_body, service.world.settings.origin, time_ns)


def get_home(service: Service, vehicle: str = "") -> Struct:
    """Where the world's origin is on the Earth."""
    _vehicle(service, vehicle)
    return geo_point((0.0, 0.0, 0.0), service.world.settings.origin)


def get_object_pose(service: Service, name: str, ned: bool = True) -> Struct:
    """world_from_ship now; NaN for any other object, as AirSim answers."""
    if name != SHIP:
        service.log(f"simGetObjectPose: no object {name!r:.60}, only {SHIP!r}")
        return no_pose()
    return pose_struct(service.world.ship_pose())


def enable_control(service: Service, enabled: bool, vehicle: str = "") -> None:
    """Taken and remembered: calls are obeyed in any case."""
    _vehicle(service, vehicle)
    service.change(api_control=_flag(enabled, "is_enabled"))


def is_controlled(service: Service, vehicle: str = "") -> bool:
    """What was last said."""
    _vehicle(service, vehicle)
    return service.world.state.api_control


def arm(service: Service, armed: bool, vehicle: str = "") -> bool:
    """Taken: there are no motors."""
    _vehicle(service, vehicle)
    _flag(armed, "arm")
    return True


async def get_images(
    service: Service, requests: Any, vehicle: str = "", external: bool = False, annotation: str = ""
) -> list[Struct]:
    """Pictures of one instant."""
    _vehicle(service, vehicle)
    wanted = read_requests(requests, service.world.settings)
    responses: list[Struct] = await service.on_renderer(take_images, service.world, wanted)
    return responses


async def get_image(
    service: Service, camera: Any, image_type: int, vehicle: str = "", annotation: Any = "", external: bool = False
) -> bytes:
    """One picture as a PNG file."""
    _vehicle(service, vehicle)
    wanted = read_request({"camera_name": str(camera), "image_type": image_type}, service.world.settings)
    responses: list[Struct] = await service.on_renderer(take_images, service.world, [wanted])
    data: bytes = responses[0]["image_data_uint8"]
    return data


def get_camera(service: Service, camera: Any, vehicle: str = "", external: bool = False) -> Struct:
    """Pose in the world, field of view, projection matrix."""
    _vehicle(service, vehicle)
    world = service.world
    name = world.settings.camera(str(camera))
    return camera_info(world.state.world_from_body * world.mount(name), world.camera(name, SCENE))


def set_camera_pose(service: Service, camera: Any, pose: Any, vehicle: str = "", external: bool = False) -> None:
    """Mount a camera elsewhere on the vehicle; NaN keeps as for the vehicle."""
    _vehicle(service, vehicle)
    world = service.world
    name = world.settings.camera(str(camera))
    service.change(mounts={**world.state.mounts, name: read_pose(pose, world.mount(name))})


def set_camera_fov(service: Service, camera: Any, fov_deg: float, vehicle: str = "", external: bool = False) -> None:
    """Horizontal field of view, degrees."""
    _vehicle(service, vehicle)
    name, fov = service.world.settings.camera(str(camera)), _within(fov_deg, "fov_degrees", 1.0, 150.0)
    service.change(fovs_deg={**service.world.state.fovs_deg, name: fov})


def get_fov(service: Service, camera: Any, vehicle: str = "", external: bool = False) -> float:
    """Horizontal field of view, degrees."""
    return float(get_camera(service, camera, vehicle)["fov"])


def enable_weather(service: Service, enabled: bool) -> None:
    """Whether fog, rain and wetness count."""
    service.change(weather=_flag(enabled, "enable"))


def set_weather(service: Service, parameter: int, value: float) -> None:
    """Fog, rain and wetness, 0..1."""
    value = _within(value, "weather intensity", 0.0, 1.0)
    if isinstance(parameter, bool) or not isinstance(parameter, int) or not 0 <= parameter <= ENABLED:
        raise ValueError(f"a weather parameter is a number between 0 and {ENABLED}, got {parameter!r:.40}")
    if parameter in PARAMETERS:
        service.change(**{PARAMETERS[parameter]: value})
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
    """Sun or moon at a date and local solar time, now when none is given."""
    if not _flag(enabled, "is_enabled"):
        service.change(daytime=None)
        return
    begun = datetime.now() if start == "" else read_time(start)
    turning = _within(speed, "celestial_clock_speed", 0.0, 1e6) if move_sun else 0.0
    step = _within(step_s, "update_interval_secs", 1e-3, 1e6)
    service.change(daytime=Daytime(begun, service.world.clock.seconds(), turning, step))


def pause(service: Service, paused: bool) -> None:
    """Let the time stand still, or run on."""
    service.world.clock.pause(_flag(paused, "is_paused"))


def run_for(service: Service, seconds: float) -> None:
    """Let the time run so many seconds, then stand still."""
    service.world.clock.run_for(_within(seconds, "seconds", 0.0, 1e6))


METHODS: dict[str, Callable[..., Any]] = {
    "ping": lambda service: True,
    "getServerVersion": lambda service: SERVER_VERSION,
    "getMinRequiredClientVersion": lambda service: OLDEST_CLIENT,
    "reset": lambda service: service.world.reset(),
    "enableApiControl": enable_control,
    "isApiControlEnabled": is_controlled,
    "armDisarm": arm,
    "simPause": pause,
    "simIsPaused": lambda service: service.world.clock.paused,
    "simContinueForTime": run_for,
    "simGetVehiclePose": get_pose,
    "simSetVehiclePose": set_pose,
    "simGetGroundTruthKinematics": get_kinematics,
    "getMultirotorState": get_multirotor,
    "getHomeGeoPoint": get_home,
    "simGetObjectPose": get_object_pose,
    "simGetImages": get_images,
    "simGetImage": get_image,
    "simGetCameraInfo": get_camera,
    "simSetCameraPose": set_camera_pose,
    "simSetCameraFov": set_camera_fov,
    "simSetFov": set_camera_fov,
    "simGetCurrentFieldOfView": get_fov,
    "simEnableWeather": enable_weather,
    "simSetWeatherParameter": set_weather,
    "simSetTimeOfDay": set_time_of_day,
    "startRecording": lambda service: service.recorder.start(),
    "stopRecording": lambda service: service.recorder.stop(),
    "isRecording": lambda service: service.recorder.on,
    "listVehicles": lambda service: [service.world.settings.vehicle],
    "getSettingsString": lambda service: service.world.settings.text,
}


def unknown(method: str, known: Sequence[str] = tuple(METHODS)) -> str:
    """What is said of a method that there is not."""
    return f"no method {method!r:.80}; there are {len(known)}: {', '.join(sorted(known))}"


def _vehicle(service: Service, name: Any) -> None:
    there = service.world.settings.vehicle
    if name not in ("", there):
        raise ValueError(f"no vehicle {name!r:.60}; there is {there!r}")


def _flag(value: Any, name: str) -> bool:
    if not isinstance(value, bool):
        raise ValueError(f"{name} must be true or false, got {value!r:.40}")
    return value


def _within(value: Any, name: str, low: float, high: float) -> float:
    number = real(value, name)
    if math.isnan(number) or not low <= number <= high:
        raise ValueError(f"{name} must lie between {low:g} and {high:g}, got {number:g}")
    return number
