"""AirSim's settings.json for the server: the vehicle, its cameras and recordings."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from deckline.adapters.airsim.protocol import read_flag, read_number
from deckline.files import MOST_CONFIG_BYTES, parse_plain, read_regular
from deckline.geometry import attitude
from deckline_sim.airsim_server.unused_settings import DISTANCE, MOUNT_KEYS, SENSOR_TYPES, unused_settings

VEHICLE = "SimpleFlight"  # AirSim's own name of a multirotor that settings.json does not name
SCENE, PLANAR, PERSPECTIVE, DEPTH_VIS, SEGMENTATION, NORMALS = 0, 1, 2, 3, 5, 6  # image types
ALL_TYPES = -1
MAX_PX = 4096  # of a picture's sides
MIN_INTERVAL_S = 0.01
STEREO_M = 0.125  # half the distance between the front cameras to the left and to the right; our choice
# Cameras without settings: all at the body's origin but the stereo pair. X, Y, Z in metres, yaw and pitch in degrees.
MOUNTS = {
    "front_center": (0.0, 0.0, 0.0),
    "front_right": (STEREO_M, 0.0, 0.0),
    "front_left": (-STEREO_M, 0.0, 0.0),
    "bottom_center": (0.0, 0.0, -90.0),
    "back_center": (0.0, 180.0, 0.0),
}  # y, yaw, pitch
ALIASES = {"0": "front_center", "1": "front_right", "2": "front_left", "3": "bottom_center", "4": "back_center"}
LEVEL = (0.0, 0.0, 0.0)  # as a mount
ORIGIN = (47.641468, -122.140165, 122.0)  # latitude, deg, longitude, deg, altitude, m: AirSim's


@dataclass(frozen=True)
class CaptureSetting:
    """A picture's size, px, and horizontal field of view, deg."""

    width: int
    height: int
    fov_deg: float


@dataclass(frozen=True, eq=False)
class CameraSetting:
    """A camera: body_from_mount, whose x axis is the viewing axis, and its captures by image type."""

    mount: RigidTransform
    captures: Mapping[int, CaptureSetting]

    def capture(self, image_type: int) -> CaptureSetting:
        return self.captures.get(image_type, self.captures[ALL_TYPES])


@dataclass(frozen=True, eq=False)
class DistanceSetting:
    """A distance sensor: body_from_mount, which measures along its x axis, and its limits, AirSim's defaults."""

    mount: RigidTransform
    nearest_m: float = 0.2
    farthest_m: float = 40.0


@dataclass(frozen=True, eq=False)
class AirSimSettings:
    """The values of settings.json, or its defaults."""

    cameras: Mapping[str, CameraSetting]
    vehicle: str = VEHICLE
    origin: tuple[float, float, float] = ORIGIN
    start: RigidTransform | None = None  # world_from_body; None: where a recorded approach begins
    distances: Mapping[str, DistanceSetting] = field(
        default_factory=lambda: {"Distance": DistanceSetting(RigidTransform.identity())}
    )
    sensors: Mapping[str, str] = field(default_factory=lambda: {kind: kind for kind in SENSOR_TYPES})  # kind by name
    clock_speed: float = 1.0  # simulated seconds in a second
    interval_s: float = 0.05  # between two recorded frames
    on_move: bool = False  # record only what differs in pose
    recorded: str = "front_center"  # camera
    text: str = "{}"
    unused: tuple[str, ...] = ()  # keys that have no effect here

    def find_distance(self, name: str) -> str:
        """A distance sensor's name, of "" the first one's; a ValueError when there is none."""
        if name and name not in self.distances:
            raise ValueError(f"no distance sensor {name[:40]!r}; there are {', '.join(self.distances)}")
        return name or next(iter(self.distances))

    def check_sensor(self, kind: str, name: str) -> None:
        """Raise a ValueError for a name that no sensor of a kind has."""
        if name and self.sensors.get(name) != kind:
            names = ", ".join(own for own in self.sensors if self.sensors[own] == kind)
            raise ValueError(f"no {kind} {name[:40]!r}; there are {names}")

    def find_camera(self, name: str) -> str:
        """A camera's own name, of a name or a number; a ValueError when there is none."""
        own = ALIASES.get(name, name) if name not in self.cameras else name
        if own not in self.cameras:
            raise ValueError(f"no camera {name[:40]!r}; there are {', '.join(self.cameras)}")
        return own


def read_settings(path: Path, default: CaptureSetting) -> AirSimSettings:
    """A settings.json; `default` is for cameras that it leaves out. A ValueError names the invalid value."""
    text = read_regular(path, MOST_CONFIG_BYTES).decode("utf-8-sig", errors="replace")
    try:
        values = parse_plain(json.loads, text)
    except ValueError as error:
        raise ValueError(f"{path}: not valid JSON: {error}") from None
    try:
        return parse_settings(_mapping(values, "settings"), default, text)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def parse_settings(values: Mapping[str, Any], default: CaptureSetting, text: str = "{}") -> AirSimSettings:
    """Settings of the parsed file, of an empty one AirSim's five cameras; a ValueError names the invalid value."""
    defaults = _mapping(values.get("CameraDefaults", {}), "CameraDefaults")
    common = _captures(defaults, {ALL_TYPES: default}, "CameraDefaults")
    vehicles = _mapping(values.get("Vehicles", {}), "Vehicles")
    if len(vehicles) > 1:
        raise ValueError(f"Vehicles names {', '.join(vehicles)}: one vehicle is simulated, leave one")
    vehicle, own = next(iter(vehicles.items()), (VEHICLE, {}))
    own = _mapping(own, f"Vehicles.{vehicle}")
    given = _mapping(own.get("Cameras", {}), "Cameras")
    cameras = {name: CameraSetting(_mount({}, usual, name), common) for name, usual in MOUNTS.items()}
    for name, camera in given.items():
        place = f"Cameras.{name}"
        camera = _mapping(camera, place)
        key = ALIASES.get(name, name)
        cameras[key] = CameraSetting(_mount(camera, MOUNTS.get(key, LEVEL), place), _captures(camera, common, place))
    start = _mount(own, LEVEL, f"Vehicles.{vehicle}") if any(key in own for key in MOUNT_KEYS) else None
    speed = read_number(values.get("ClockSpeed", 1.0), "ClockSpeed", 1e-3, 100.0)
    settings = AirSimSettings(cameras, vehicle, _origin(values), start, clock_speed=speed, text=text)
    sensors = _mapping(own.get("Sensors", {}), "Sensors")
    if distances := _distances(sensors):
        settings = replace(settings, distances=distances)
    numbers = {name: sensor.get("SensorType") for name, sensor in sensors.items()}
    named = {name: kind for name in numbers for kind, number in SENSOR_TYPES.items() if numbers[name] == number}
    settings = replace(settings, sensors={**settings.sensors, **named})
    settings = _recording(settings, _mapping(values.get("Recording", {}), "Recording"))
    return replace(settings, unused=unused_settings(values, vehicle))


def _recording(settings: AirSimSettings, values: Mapping[str, Any]) -> AirSimSettings:
    """The settings with the values of Recording; pictures and depth are recorded of the first camera it names."""
    recorded = settings.recorded
    if cameras := _objects(values, "Cameras", "Recording"):
        recorded = settings.find_camera(str(cameras[0].get("CameraName", cameras[0].get("CameraID", "0"))))
    interval_s = values.get("RecordInterval", settings.interval_s)
    interval_s = read_number(interval_s, "RecordInterval", MIN_INTERVAL_S, 3600.0)
    on_move = read_flag(values.get("RecordOnMove", False), "RecordOnMove")
    return replace(settings, interval_s=interval_s, on_move=on_move, recorded=recorded)


def _distances(sensors: Mapping[str, Any]) -> Mapping[str, DistanceSetting]:
    """The distance sensors of a vehicle's Sensors."""
    found = {}
    for name, sensor in sensors.items():
        place = f"Sensors.{name}"
        if _mapping(sensor, place).get("SensorType") == DISTANCE:
            nearest = read_number(sensor.get("MinDistance", 0.2), f"{place}.MinDistance", 0.0, 1e4)
            farthest = read_number(sensor.get("MaxDistance", 40.0), f"{place}.MaxDistance", nearest, 1e4)
            found[name] = DistanceSetting(_mount(sensor, LEVEL, place), nearest, farthest)
    return found


def _captures(
    values: Mapping[str, Any], common: Mapping[int, CaptureSetting], place: str
) -> Mapping[int, CaptureSetting]:
    captures = dict(common)
    for item in _objects(values, "CaptureSettings", place):
        kind = int(read_number(item.get("ImageType", SCENE), "ImageType", ALL_TYPES, 11))
        base = captures.get(kind, captures[ALL_TYPES])
        captures[kind] = CaptureSetting(
            int(read_number(item.get("Width", base.width), f"{place}.Width", 1, MAX_PX)),
            int(read_number(item.get("Height", base.height), f"{place}.Height", 1, MAX_PX)),
            read_number(item.get("FOV_Degrees", base.fov_deg), f"{place}.FOV_Degrees", 1.0, 150.0),
        )
    return captures


def _mount(values: Mapping[str, Any], usual: tuple[float, float, float], place: str) -> RigidTransform:
    """body_from_mount of X, Y, Z, Roll, Pitch, Yaw; what is not given is as in `usual`, a value of MOUNTS."""

    def read(name: str, default: float, most: float) -> float:
        return read_number(values.get(name, default), f"{place}.{name}", -most, most)

    right_m, yaw_deg, pitch_deg = usual
    angles = np.deg2rad([read("Roll", 0.0, 360.0), read("Pitch", pitch_deg, 360.0), read("Yaw", yaw_deg, 360.0)])
    position_m = [read("X", 0.0, 1e4), read("Y", right_m, 1e4), read("Z", 0.0, 1e4)]
    return RigidTransform.from_components(position_m, attitude(*angles))


def _origin(values: Mapping[str, Any]) -> tuple[float, float, float]:
    place = _mapping(values.get("OriginGeopoint", {}), "OriginGeopoint")
    limits = (("Latitude", 89.0), ("Longitude", 180.0), ("Altitude", 1e5))
    numbers = [
        read_number(place.get(name, usual), name, -most, most)
        for (name, most), usual in zip(limits, ORIGIN, strict=True)
    ]
    return numbers[0], numbers[1], numbers[2]


def _objects(values: Mapping[str, Any], key: str, place: str) -> list[Mapping[str, Any]]:
    items = values.get(key, [])
    if not isinstance(items, list):
        raise ValueError(f"{place}.{key} must be a list, got {type(items).__name__}")
    return [_mapping(item, f"{place}.{key}") for item in items]


def _mapping(value: Any, place: str) -> Mapping[str, Any]:
    if not isinstance(value, dict):
        raise ValueError(f"{place} must be an object, got {type(value).__name__}")
    return value
