"""ROS bags of a short approach, written by rosbags from hand-made messages."""

from pathlib import Path

import cv2
import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from approach_scene import CAMERA, LEFT, RIGHT, frame

COUNT = 4
START_S = 1000.0
ROS1, ROS2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)
ROS1.register({"tf2_msgs/msg/TFMessage": ROS2.fielddefs["tf2_msgs/msg/TFMessage"]})
PLUGINS = {"mcap": StoragePlugin.MCAP, "db3": StoragePlugin.SQLITE3}
MOUNT_M = [0.5, 0.1, -0.2]  # of the camera, forward, left, up of base_link
IMAGE, JPEG, INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/CameraInfo"
POSE, ODOMETRY, TF = "geometry_msgs/msg/PoseStamped", "nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage"


def make(store, kind, values):
    """A message whose fields that are not given are zero or empty."""
    fields = {}
    for name, (node, detail) in store.fielddefs[kind][1]:
        given = values.get(name, values.get(name.lower()))
        if node == Nodetype.NAME:
            fields[name] = make(store, detail, given or {})
        elif node == Nodetype.BASE:
            fields[name] = given if given is not None else {"string": "", "bool": False}.get(detail[0], 0)
        else:
            (inner, inner_detail), size = detail
            if inner == Nodetype.NAME:
                fields[name] = [make(store, inner_detail, item) for item in given or []]
            else:
                zeros = np.zeros(size if node == Nodetype.ARRAY else 0)
                fields[name] = np.asarray(zeros if given is None else given, inner_detail[0])
    return store.types[kind](**fields)


def write(path: Path, kind: str, rows) -> Path:
    """A bag of (topic, type, time in s, values); the path of what is to be opened."""
    store = ROS1 if kind == "bag" else ROS2
    path = path.with_suffix(".bag") if kind == "bag" else path
    opened = Writer1(path) if kind == "bag" else Writer2(path, version=9, storage_plugin=PLUGINS[kind])
    with opened as writer:
        connections = {}
        for topic, msgtype, time_s, values in rows:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, msgtype, typestore=store)
            message = make(store, msgtype, values)
            data = store.serialize_ros1(message, msgtype) if kind == "bag" else store.serialize_cdr(message, msgtype)
            writer.write(connections[topic], round(1e9 * time_s), data)
    return path


def header(time_s, frame_id=""):
    return {"stamp": {"sec": int(time_s), "nanosec": round(1e9 * (time_s % 1))}, "frame_id": frame_id}


def vector(values):
    return dict(zip("xyz", values, strict=True))


def quaternion(rotation):
    return dict(zip("xyzw", rotation.as_quat().tolist(), strict=True))


def seen(index):
    """Frame `index` of the approach with its lines painted."""
    found = frame(index, 150.0 - 2 * index)
    found.image_rgb[:] = 60
    for line in (LEFT, RIGHT):
        along = line.p0_m + np.linspace(0.0, 1.0, 2)[:, None] * (line.p1_m - line.p0_m)
        ends = found.camera.project(found.world_from_camera.inv().apply(along))
        cv2.line(found.image_rgb, *np.rint(ends).astype(int).tolist(), (250, 250, 250), 2)
    return found


def enu_pose(found):
    """Position and orientation of base_link, forward-left-up, in East-North-Up."""
    north, east, down = found.world_from_body.translation
    enu_from_ned = Rotation.from_matrix([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
    turned = enu_from_ned * found.world_from_body.rotation * Rotation.from_euler("x", 180, degrees=True)
    return {"position": vector([east, north, -down]), "orientation": quaternion(turned)}


def image(time_s, pixels, encoding="rgb8"):
    height, width = pixels.shape[:2]
    data = np.ascontiguousarray(pixels).view(np.uint8).reshape(-1)
    values = {"height": height, "width": width, "encoding": encoding, "step": len(data) // height, "data": data}
    return {"header": header(time_s, "camera_optical_frame"), **values}


def info(time_s):
    k = [CAMERA.fx, 0, CAMERA.cx, 0, CAMERA.fy, CAMERA.cy, 0, 0, 1]
    values = {"height": CAMERA.height, "width": CAMERA.width, "distortion_model": "plumb_bob", "d": np.zeros(5), "k": k}
    return {"header": header(time_s, "camera_optical_frame"), **values}


def transform(time_s, parent, child, pose):
    moved = {"translation": pose["position"], "rotation": pose["orientation"]}
    return {"header": header(time_s, parent), "child_frame_id": child, "transform": moved}


def rows(poses="pose", camera_info=True, depth=None, mount=True, start_s=START_S, count=COUNT):
    """Messages of the approach; `poses`: pose, odometry, tf, or anything else for none."""
    optical = Rotation.from_euler("ZYX", [-90, 0, -90], degrees=True)  # REP 103: z forward, x right, y down
    if mount:
        placed = {"position": vector(MOUNT_M), "orientation": quaternion(optical)}
        yield "/tf_static", TF, start_s, {"transforms": [transform(0, "base_link", "camera_optical_frame", placed)]}
    for index in range(count):
        found, time_s = seen(index), start_s + 0.25 * index
        pose = enu_pose(found)
        if poses == "pose":
            yield "/pose", POSE, time_s, {"header": header(time_s, "map"), "pose": pose}
        if poses == "odometry":
            values = {"header": header(time_s, "odom"), "child_frame_id": "base_link", "pose": {"pose": pose}}
            yield "/odom", ODOMETRY, time_s, values
        if poses == "tf":
            yield "/tf", TF, time_s, {"transforms": [transform(time_s, "map", "base_link", pose)]}
        if camera_info:
            yield "/camera/camera_info", INFO, time_s, info(time_s)
        if depth is not None:
            yield "/camera/depth", IMAGE, time_s, image(time_s, *depth)
        yield "/camera/image", IMAGE, time_s + 0.01, image(time_s, found.image_rgb)
