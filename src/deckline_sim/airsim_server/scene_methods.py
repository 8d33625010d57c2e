"""The calls about the scene's objects, about what cameras detect, and the vehicle's sensors, by name."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from deckline.adapters.airsim.protocol import read_flag, read_number
from deckline_sim.airsim_server import objects
from deckline_sim.airsim_server.image_requests import read_image_type
from deckline_sim.airsim_server.kinematics import VehicleMotion
from deckline_sim.airsim_server.sensors import SimulatedSensors, environment_struct
from deckline_sim.airsim_server.service import Service, read_near_pose
from deckline_sim.airsim_server.structs import Struct, pose_struct, unknown_pose_struct

MOST_FILTER_NAMES = 16  # of one camera and image type


def list_objects(service: Service, name_regex: str = ".*") -> list[str]:
    return objects.find(objects.object_names(service.world), name_regex, is_regex=True)


def get_object_pose(service: Service, name: str, ned: bool = True) -> Struct:
    """The pose now; NaN for an object that is not there, as AirSim answers."""
    if not read_flag(ned, "ned"):
        raise ValueError("ned False is not supported: poses are in metres, North-East-Down")
    pose = objects.object_pose(service.world, name, *service.world.snapshot())
    if pose is None:
        service.log(f"simGetObjectPose: no object {name!r:.60}; there are {', '.join(list_objects(service))}")
        return unknown_pose_struct()
    return pose_struct(pose)


def set_object_id(service: Service, name: str, number: int, is_regex: bool = False) -> bool:
    """Whether an object has the name. ID -1 hides an object from segmentation pictures."""
    if isinstance(number, bool) or not isinstance(number, int) or not -1 <= number <= objects.MOST_ID:
        raise ValueError(f"an object's ID is a number between -1 and {objects.MOST_ID}, got {number!r:.40}")
    ids = objects.object_ids(service.world, service.world.state)
    named = objects.find(list(ids), name, read_flag(is_regex, "is_name_regex"))
    service.world.change(object_ids=ids | dict.fromkeys(named, number))
    return bool(named)


def get_object_id(service: Service, name: str) -> int:
    """-1 for an object that is not there."""
    return objects.object_ids(service.world, service.world.state).get(str(name), -1)


def set_filter(
    service: Service, camera: Any, image_type: int, change: Callable[[objects.DetectionFilter], objects.DetectionFilter]
) -> None:
    """Change the filter of a camera's detections."""
    key = (service.world.settings.find_camera(str(camera)), read_image_type(image_type))
    filters = service.world.state.filters
    service.world.change(filters={**filters, key: change(filters.get(key, objects.DetectionFilter()))})


def add_filter_name(
    service: Service, camera: Any, image_type: int, name: str, vehicle: str = "", annotation: Any = ""
) -> None:
    """A name with * and ?, upper and lower case alike."""
    if not isinstance(name, str) or len(name) > objects.LONGEST:
        raise ValueError(f"mesh_name has at most {objects.LONGEST} characters, got {str(name)[:40]!r}")

    def add(old: objects.DetectionFilter) -> objects.DetectionFilter:
        names = tuple(dict.fromkeys((name, *old.names)))
        if len(names) > MOST_FILTER_NAMES:
            raise ValueError(f"a filter has at most {MOST_FILTER_NAMES} mesh names: call simClearDetectionMeshNames")
        return replace(old, names=names)

    set_filter(service, camera, image_type, add)


def set_filter_radius(
    service: Service, camera: Any, image_type: int, radius_cm: float, vehicle: str = "", annotation: Any = ""
) -> None:
    radius_m = read_number(radius_cm, "radius_cm", 0.0, 1e9) / 100.0
    set_filter(service, camera, image_type, lambda old: replace(old, radius_m=radius_m))


def clear_filter(service: Service, camera: Any, image_type: int, vehicle: str = "", annotation: Any = "") -> None:
    set_filter(service, camera, image_type, lambda old: replace(old, names=()))


async def get_detections(
    service: Service, camera: Any, image_type: int, vehicle: str = "", annotation: Any = ""
) -> list[Struct]:
    name = service.world.settings.find_camera(str(camera))
    found: list[Struct] = await service.render(objects.detections, service.world, name, read_image_type(image_type))
    return found


def sensor_method(measure: Callable[[SimulatedSensors, VehicleMotion, float], Struct]) -> Callable[..., Struct]:
    """The call that reads a sensor, by one of its names or without one."""

    def read(service: Service, name: Any = "", vehicle: str = "") -> Struct:
        service.world.settings.check_sensor(measure.__name__, str(name))
        motion = service.world.vehicle.read()
        return service.sensors.read(measure.__name__, motion, lambda *args: measure(service.sensors, *args))

    return read


async def get_distance(service: Service, name: Any = "", vehicle: str = "") -> Struct:
    world = service.world
    key = world.settings.find_distance(str(name))
    setting = replace(world.settings.distances[key], mount=world.distance_mount(key))
    motion = world.vehicle.read()
    true_m = await service.render(world.distance, motion.pose * setting.mount, motion.time_s)
    return service.sensors.read(f"distance {key}", motion, lambda *_: service.sensors.distance(setting, true_m))


def set_distance_pose(service: Service, name: Any, pose: Any, vehicle: str = "") -> None:
    """Set a distance sensor's mount on the vehicle; a position or orientation with NaN stays as it is."""
    world = service.world
    key = world.settings.find_distance(str(name))
    mounts = world.state.distance_mounts
    world.change(distance_mounts={**mounts, key: read_near_pose(pose, world.distance_mount(key))})


def get_environment(service: Service, vehicle: str = "") -> Struct:
    return environment_struct(service.world.vehicle.read(), service.world.settings.origin)


# The sensors but the distance sensors are one of a kind, which several names may have.
SCENE_METHODS: dict[str, Callable[..., Any]] = {
    "simListSceneObjects": list_objects,
    "simGetObjectPose": get_object_pose,
    "simSetSegmentationObjectID": set_object_id,
    "simGetSegmentationObjectID": get_object_id,
    "simAddDetectionFilterMeshName": add_filter_name,
    "simSetDetectionFilterRadius": set_filter_radius,
    "simClearDetectionMeshNames": clear_filter,
    "simGetDetections": get_detections,
    "getImuData": sensor_method(SimulatedSensors.imu),
    "getGpsData": sensor_method(SimulatedSensors.gps),
    "getBarometerData": sensor_method(SimulatedSensors.barometer),
    "getMagnetometerData": sensor_method(SimulatedSensors.magnetometer),
    "getDistanceSensorData": get_distance,
    "simSetDistanceSensorPose": set_distance_pose,
    "simGetGroundTruthEnvironment": get_environment,
}
