"""The ROS 2 node of the examples against a stand-in of rclpy: no ROS is there."""

import runpy
import sys
import time
from pathlib import Path
from types import ModuleType, SimpleNamespace

import cv2
import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from approach_scene import CAMERA, HEIGHT_M, LATERAL_M, LEFT, RIGHT, frame
from deckline.adapters.ros.encode import Encoder
from deckline.adapters.ros.messages import CAMERA as OPTICAL
from deckline.adapters.ros.messages import MAP_FROM_WORLD, UPRIGHT, camera_values, header
from deckline.detect import DETECTORS
from deckline_lab.rivals.classical import ClassicalDetector

EXAMPLES = Path(__file__).parent.parent.parent / "examples"
STORE = get_typestore(Stores.ROS2_HUMBLE)
PACKAGES = {
    "diagnostic_msgs": ["DiagnosticArray"],
    "geometry_msgs": ["PoseStamped", "PoseWithCovarianceStamped"],
    "nav_msgs": ["Odometry"],
    "sensor_msgs": ["CameraInfo", "CompressedImage", "Image"],
    "tf2_msgs": ["TFMessage"],
    "visualization_msgs": ["ImageMarker", "MarkerArray"],
}
COUNT = 4


def make(kind, **values):
    return STORE.deserialize_cdr(Encoder()(kind, values), kind)


class Node:
    """What the example uses of rclpy's Node; publishers take bytes, as rclpy's do."""

    def __init__(self, name):
        self.taken, self.sent = {}, {}

    def declare_parameter(self, name, default):
        return SimpleNamespace(value=self.stated.get(name, default))

    def create_subscription(self, kind, topic, take, qos):
        self.taken[topic] = take

    def create_publisher(self, kind, topic, depth):
        return SimpleNamespace(publish=lambda data: self.sent.setdefault(topic, []).append((kind, data)))

    def get_clock(self):
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=time.time_ns()))

    def get_logger(self):
        return SimpleNamespace(info=print)

    def destroy_node(self):
        pass


def paint(shown):
    """Its picture with the runway's lines."""
    image = np.full_like(shown.image_rgb, 60)
    for line in (LEFT, RIGHT):
        ends = shown.camera.project(shown.world_from_camera.inv().apply([line.p0_m, line.p1_m]))
        cv2.line(image, *np.rint(ends).astype(int).tolist(), (250, 250, 250), 2)
    return image


def spin(node):
    """Four pictures among eight poses."""
    node.taken["camera_info"](make("sensor_msgs/msg/CameraInfo", header=header(1.0, OPTICAL), **camera_values(CAMERA)))
    for index in range(2 * COUNT):
        shown, time_s = frame(index, 150.0 - index), time.time()
        placed = MAP_FROM_WORLD * shown.world_from_body * UPRIGHT
        move, turn = placed.translation, placed.rotation.as_quat()
        values = {
            "position": dict(zip("xyz", move.tolist(), strict=True)),
            "orientation": dict(zip("xyzw", turn.tolist(), strict=True)),
        }
        node.taken["pose"](make("geometry_msgs/msg/PoseStamped", header=header(time_s, "map"), pose=values))
        if index % 2:
            height, width = shown.image_rgb.shape[:2]
            picture = {"height": height, "width": width, "encoding": "rgb8", "data": paint(shown).tobytes()}
            picture |= {"step": 3 * width, "header": header(time_s - 0.05, OPTICAL)}
            node.taken["image"](make("sensor_msgs/msg/Image", **picture))
        time.sleep(0.15)
    node.taken["image"](make("sensor_msgs/msg/Image", encoding="nv21", header=header(time.time(), OPTICAL)))
    time.sleep(0.5)
    Node.last = node


@pytest.fixture
def rclpy(monkeypatch, tmp_path):
    parts = {
        "rclpy": {"init": lambda: None, "spin": spin, "try_shutdown": lambda: None},
        "rclpy.executors": {"ExternalShutdownException": type("ExternalShutdownException", (Exception,), {})},
        "rclpy.node": {"Node": Node},
        "rclpy.qos": {"qos_profile_sensor_data": None},
        **{f"{name}.msg": {kind: type(kind, (), {}) for kind in kinds} for name, kinds in PACKAGES.items()},
        **{name: {} for name in PACKAGES},
    }
    for name, values in parts.items():
        module = ModuleType(name)
        vars(module).update(values)
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setitem(DETECTORS, "classical", lambda engine: ClassicalDetector())  # finds lines in drawings
    (tmp_path / "deck.toml").write_text('[models]\ndehazer = "none"\ndetector = "classical"\n')
    Node.stated = {"config": str(tmp_path / "deck.toml"), "deck_z_m": -20.0, "stale_s": 20.0}


def test_pictures_and_poses_become_messages(rclpy, capsys):
    runpy.run_path(str(EXAMPLES / "ros2_node.py"), run_name="__main__")
    sent = Node.last.sent
    states = [STORE.deserialize_cdr(data, "diagnostic_msgs/msg/DiagnosticArray") for _, data in sent["/diagnostics"]]
    assert {kind.__name__ for kind, _ in sent["/diagnostics"]} == {"DiagnosticArray"}
    of_frames = [one for one in states if one.status[0].level != 3]
    assert of_frames and all(type(data) is bytes for _, data in sent["/deckline/annotations"])
    values = {pair.key: float(pair.value) for pair in of_frames[-1].status[0].values if pair.key.endswith("_m")}
    assert values["lateral_deviation_m"] == pytest.approx(LATERAL_M, abs=1.0)
    assert values["height_above_deck_m"] == pytest.approx(HEIGHT_M, abs=3.0)  # of a few rough pixels
    assert "'nv21' is not read" in capsys.readouterr().out
