"""The names of what a settings.json asks for and the server does not do."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

MOUNT_KEYS = ("X", "Y", "Z", "Roll", "Pitch", "Yaw")  # m and deg
TOP_KEYS = (
    *("SettingsVersion", "SeeDocsAt", "SimMode", "ClockSpeed", "OriginGeopoint"),
    *("CameraDefaults", "Vehicles", "Recording"),
)
SIM_MODES = ("", "Multirotor", "ComputerVision")
VEHICLE_TYPES = ("simpleflight", "computervision")  # in lower case
ORIGIN_KEYS = ("Latitude", "Longitude", "Altitude")
CAPTURE_KEYS = ("ImageType", "Width", "Height", "FOV_Degrees")
DISTANCE = 5  # AirSim's SensorType; the sensors below are always there
SENSOR_TYPES = {"barometer": 1, "imu": 2, "gps": 3, "magnetometer": 4}  # by AirSim's own names
DISTANCE_KEYS = ("MinDistance", "MaxDistance", *MOUNT_KEYS)
RECORDING_KEYS = ("RecordInterval", "RecordOnMove", "Cameras")
RECORDED_TYPES = ("0", "1", "2")  # every recording has pictures and depth
RECORDED_KEYS = ("CameraName", "CameraID", "VehicleName", "ImageType", "PixelsAsFloat", "Compress")

Values = Mapping[str, Any]


def unused_settings(values: Values, vehicle: str) -> tuple[str, ...]:
    """Dotted names of the keys without effect, of a parsed settings.json whose values are valid."""
    own, recording = values.get("Vehicles", {}).get(vehicle, {}), values.get("Recording", {})
    place = f"Vehicles.{vehicle}"
    found = [*_others(values, TOP_KEYS), *_other_value(values, "SimMode", SIM_MODES)]
    found += _others(values.get("OriginGeopoint", {}), ORIGIN_KEYS, "OriginGeopoint")
    found += _camera(values.get("CameraDefaults", {}), "CameraDefaults")
    found += _others(own, ("Cameras", "VehicleType", "Sensors", *MOUNT_KEYS), place)
    found += _other_value(own, "VehicleType", VEHICLE_TYPES, place)
    for name, camera in own.get("Cameras", {}).items():
        found += _camera(camera, f"{place}.Cameras.{name}", MOUNT_KEYS)
    for name, sensor in own.get("Sensors", {}).items():
        found += _sensor(sensor, f"{place}.Sensors.{name}")
    found += _others(recording, RECORDING_KEYS, "Recording")
    found += _recorded(recording.get("Cameras", []))
    return tuple(dict.fromkeys(found))


def _others(values: Values, used: Iterable[str], place: str = "") -> Iterator[str]:
    """The keys beyond those used, and `Enabled` where it differs from what is done: sensors on, no recording yet."""
    for key in values:
        is_so = key == "Enabled" and values[key] is (place != "Recording")
        if key not in used and not is_so:
            yield f"{place}.{key}" if place else key


def _other_value(values: Values, key: str, known: Iterable[str], place: str = "") -> Iterator[str]:
    value = values.get(key, "")
    if value and str(value) not in known and str(value).lower() not in known:
        yield f"{place}.{key} {str(value)[:40]!r}" if place else f"{key} {str(value)[:40]!r}"


def _camera(values: Values, place: str, used: tuple[str, ...] = ()) -> Iterator[str]:
    yield from _others(values, ("CaptureSettings", *used), place)
    for capture in values.get("CaptureSettings", []):
        yield from _others(capture, CAPTURE_KEYS, f"{place}.CaptureSettings")


def _sensor(values: Values, place: str) -> Iterator[str]:
    kind = values.get("SensorType")
    if kind == DISTANCE:
        yield from _others(values, ("SensorType", *DISTANCE_KEYS), place)
    elif kind in SENSOR_TYPES.values():
        yield from _others(values, ("SensorType",), place)
    else:
        yield place


def _recorded(cameras: list[Values]) -> Iterator[str]:
    """Cameras beyond the first, image types but Scene and depth, and unknown keys."""
    names = [str(camera.get("CameraName", camera.get("CameraID", "0"))) for camera in cameras]
    yield from (f"Recording.Cameras {name[:40]!r}" for name in names if name != names[0])
    for camera in cameras:
        yield from _others(camera, RECORDED_KEYS, "Recording.Cameras")
        yield from _other_value(camera, "ImageType", RECORDED_TYPES, "Recording.Cameras")
