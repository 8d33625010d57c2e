"""The ROS 2 node against a stand-in of rclpy: no ROS is there."""

import math
import time
from dataclasses import replace

import cv2
import numpy as np
import pytest
import ros_stand_in
from ros_stand_in import STORE, LifecycleNode

from approach_scene import CAMERA, HEIGHT_M, LATERAL_M, LEFT, RIGHT, chain, frame
from deckline.adapters.ros.encode import Encoder
from deckline.adapters.ros.messages import MAP_FROM_WORLD, UPRIGHT, camera_values, header
from deckline.config import Approach
from deckline.detect import DETECTORS
from deckline.geometry import attitude, camera_mount
from deckline.report.records import GUIDANCE, frame_record
from deckline.types import PoseSource, Status
from deckline_lab.rivals.classical import ClassicalDetector

OPTICAL, WORLD = "front_optical", "odom"  # not the names that deckline gives frames
MOUNT = camera_mount([2.0, 0.5, -0.5], attitude(0.0, 0.0, 0.1))  # turned by 5.7 degrees: 12 m sideways at the ramp
COUNT = 4


def make(kind, **values):
    return STORE.deserialize_cdr(Encoder()(kind, values), kind)


def code(status):
    """Its number in a Guidance."""
    return {name: value for name, _, value in STORE.fielddefs["deckline_msgs/msg/Guidance"][0]}[status.name]


def parts(transform, move, turn):
    quaternion = transform.rotation.as_quat().tolist()
    return {
        move: dict(zip("xyz", transform.translation.tolist(), strict=True)),
        turn: dict(zip("xyzw", quaternion, strict=True)),
    }


def picture_of(shown, time_s):
    """An Image with the runway's lines."""
    image = np.full_like(shown.image_rgb, 60)
    for line in (LEFT, RIGHT):
        ends = shown.camera.project(shown.world_from_camera.inv().apply([line.p0_m, line.p1_m]))
        cv2.line(image, *np.rint(ends).astype(int).tolist(), (250, 250, 250), 2)
    height, width = image.shape[:2]
    values = {"height": height, "width": width, "encoding": "rgb8", "data": image.tobytes(), "step": 3 * width}
    return make("sensor_msgs/msg/Image", header=header(time_s, OPTICAL), **values)


class Robot:
    """What surrounds the node: topics and transitions."""

    def __init__(self, node):
        self.node = node

    def send(self, topic, message):
        self.node.taken[topic][0](message)

    def start(self):
        assert self.node.on_configure(None) == "success"
        assert self.node.on_activate(None) == "success"

    def state_camera(self, **changes):
        info = camera_values(CAMERA) | changes
        self.send("camera_info", make("sensor_msgs/msg/CameraInfo", header=header(1.0, OPTICAL), **info))

    def state_mount(self):
        moved = {"header": header(0.0, "base_link"), "child_frame_id": OPTICAL}
        moved["transform"] = parts(UPRIGHT * MOUNT, "translation", "rotation")
        self.send("/tf_static", make("tf2_msgs/msg/TFMessage", transforms=[moved]))

    def send_pose(self, shown, time_s):
        pose = parts(MAP_FROM_WORLD * shown.world_from_body * UPRIGHT, "position", "orientation")
        self.send("pose", make("geometry_msgs/msg/PoseStamped", header=header(time_s, WORLD), pose=pose))

    def send_odometry(self, shown, time_s, body):
        pose = {"pose": parts(MAP_FROM_WORLD * shown.world_from_body * UPRIGHT, "position", "orientation")}
        values = {"header": header(time_s, WORLD), "child_frame_id": body, "pose": pose}
        self.send("odom", make("nav_msgs/msg/Odometry", **values))

    def fly(self, pose_offset_s=0.0, picture_offset_s=0.0, is_mounted=True):
        """The guidance of four pictures among eight poses; their clocks may be ahead."""
        self.start()
        self.state_camera()
        if is_mounted:
            self.state_mount()
        for index in range(2 * COUNT):
            shown, time_s = replace(frame(index, 150.0 - index), body_from_camera=MOUNT), time.time()
            self.send_pose(shown, time_s + pose_offset_s)
            if index % 2:
                self.send("image", picture_of(shown, time_s - 0.05 + picture_offset_s))
            time.sleep(0.15)
        time.sleep(0.5)
        return self.read("/deckline/guidance")

    def read(self, topic):
        kinds = {publisher.sent is self.node.sent[topic]: publisher.kind for publisher in self.node.publishers_}
        return [STORE.deserialize_cdr(data, kinds[True].kind) for data in self.node.sent[topic]]


@pytest.fixture
def ros(monkeypatch, tmp_path):
    ros_stand_in.install(monkeypatch)
    monkeypatch.setitem(DETECTORS, "classical", lambda engine: ClassicalDetector())  # finds lines in drawings
    (tmp_path / "deck.toml").write_text('[models]\ndehazer = "none"\ndetector = "classical"\n')
    stated = {"config": str(tmp_path / "deck.toml"), "deck_z_m": -20.0, "stale_s": 20.0, "pose": "pose"}
    monkeypatch.setattr(LifecycleNode, "stated", stated)
    import deckline_ros.node

    yield deckline_ros.node


@pytest.fixture
def robot(ros):
    made = Robot(ros.DecklineNode())
    yield made
    made.node.release()


def test_pictures_poses_and_the_static_mount_become_guidance(robot):
    last = [one for one in robot.fly() if not math.isnan(one.lateral_deviation_m.value)][-1]
    assert last.lateral_deviation_m.value == pytest.approx(LATERAL_M, abs=1.0)  # of a few rough pixels
    assert last.height_above_deck_m.value == pytest.approx(HEIGHT_M, abs=3.0)
    assert last.lateral_deviation_m.sigma > 0 and math.isnan(last.lateral_deviation_widths.value)
    assert last.header.frame_id == "base_link" and 0.0 < last.age_s < 5.0
    (state,) = robot.read("/diagnostics")[-1].status
    values = {pair.key: pair.value for pair in state.values}
    assert float(values["lateral_deviation_m"]) == pytest.approx(last.lateral_deviation_m.value, abs=1e-3)
    assert {one.header.frame_id for one in robot.read("/deckline/annotations")} == {OPTICAL}


def test_the_offset_of_the_poses_clock_is_applied(robot, tmp_path):
    with (tmp_path / "deck.toml").open("a") as file:
        file.write("[navigation]\noffset_s = 40.0\n")
    last = robot.fly(pose_offset_s=40.0)[-1]
    assert last.pose_source == PoseSource.NAVIGATION
    assert last.lateral_deviation_m.value == pytest.approx(LATERAL_M, abs=1.0)


@pytest.mark.parametrize(
    ("body", "is_taken"), [("base_link", True), ("/base_link", True), ("", True), ("imu_link", False)]
)
def test_odometry_of_another_body_is_refused(robot, body, is_taken):
    robot.node.values |= {"pose": "", "odom": "odom"}
    robot.start()
    for time_s in (1.0, 1.2):
        robot.send_odometry(frame(), time_s, body)
    found = robot.node._find_pose(1.1)
    if is_taken:
        np.testing.assert_allclose(found.as_matrix(), frame().world_from_body.as_matrix(), atol=1e-9)
        assert robot.node.lines == []
    else:
        assert found is None
        assert all("'imu_link'" in line and "'base_link'" in line for line in robot.node.lines) and robot.node.lines


@pytest.mark.parametrize(("asked", "edges"), [(False, None), (True, {(WORLD, "deck")})])
def test_tf_has_the_deck_alone_and_on_request(robot, asked, edges):
    robot.node.values["publish_tf"] = asked
    robot.start()
    robot.send_pose(frame(), 1.0)
    result = chain(frame())
    robot.node._publish(result, frame_record(result, Approach()) | {"live": {"age_s": 0.05}})
    found = robot.read("/tf") if "/tf" in robot.node.sent else None
    assert edges == (found and {(one.header.frame_id, one.child_frame_id) for one in found[0].transforms})
    (guided,) = robot.read("/deckline/guidance")
    assert guided.status == code(Status.UNVERIFIED)
    assert guided.distance_to_ramp_m.value == pytest.approx(result.guidance.distance_to_ramp_m.value, rel=1e-8)
    assert {marker.header.frame_id for marker in robot.read("/deckline/lines")[0].markers[1:]} == {WORLD}


def test_a_camera_without_a_mount_is_refused_with_its_frame(robot):
    robot.node.values["stale_s"] = 0.3
    sent = robot.fly(is_mounted=False)
    assert {one.status for one in sent} == {code(Status.STALE)}
    assert OPTICAL in sent[-1].reason and "/tf_static" in sent[-1].reason


@pytest.mark.parametrize(("topic", "scale"), [("/direct/image_raw", 1.0), ("/camera/image_rect", 0.5)])
def test_the_projection_of_camera_info_counts_for_rectified_pictures_alone(robot, topic, scale):
    robot.node.resolve_topic_name = lambda name: topic
    robot.start()
    robot.state_camera(p=(np.diag([0.5, 0.5, 1.0]) @ np.reshape(camera_values(CAMERA)["p"], (3, 4))).ravel())
    assert robot.node._camera.camera.fx == pytest.approx(scale * CAMERA.fx)


def test_pictures_and_poses_from_the_future_are_refused(robot):
    robot.node.values["stale_s"] = 0.3
    sent = robot.fly(pose_offset_s=5.0, picture_offset_s=5.0)  # a wrong clock of the whole robot
    assert {one.status for one in sent} == {code(Status.STALE)}
    assert "in the future" in sent[-1].reason
    late = [line for line in robot.node.lines if "in the future" in line]
    assert sum("a pose" in line for line in late) == 2 * COUNT == len(late) - 1
    assert robot.node._find_pose(time.time()) is None


def test_pictures_from_the_past_are_stale(robot):
    robot.node.values["stale_s"] = 3.0
    sent = robot.fly(pose_offset_s=-60.0, picture_offset_s=-60.0)
    assert {one.status for one in sent} == {code(Status.STALE)}


def test_transitions_start_and_end_what_is_sent(robot):
    robot.start()
    taken = set(robot.node.taken)
    assert {"image", "camera_info", "pose", "/tf_static"} == taken
    robot.node.values["image_transport"] = "compressed"
    for _ in range(2):  # a second flight of the same node
        assert robot.node.on_deactivate(None) == "success"
        count = len(robot.node.sent["/deckline/guidance"])
        time.sleep(0.7)
        assert len(robot.node.sent["/deckline/guidance"]) == count
        assert robot.node.on_activate(None) == "success"
    assert robot.node.on_deactivate(None) == robot.node.on_cleanup(None) == "success"
    assert robot.node.taken == {} and robot.node.publishers_ == []
    robot.start()
    assert "image/compressed" in robot.node.taken and "image" not in robot.node.taken


@pytest.mark.parametrize(
    "values",
    [
        {"image_transport": "theora"},
        {"config": "nowhere.toml"},
        {"pose": "/mavros/local_position/pose", "odom": "/odom"},
    ],
)
def test_parameters_that_cannot_be_used_are_one_line(robot, values):
    """Two sources of poses cannot either."""
    robot.node.values |= values
    assert robot.node.on_configure(None) == "failure"
    (line,) = robot.node.lines
    assert all(value in line for value in values.values())
    assert robot.node.taken == {} and robot.node.publishers_ == []


@pytest.mark.parametrize("stated", ["pose", "odom", ""])
def test_poses_come_from_the_stated_topic_alone(robot, stated):
    robot.node.values |= {"pose": "", "odom": ""} | ({stated: f"/own/{stated}"} if stated else {})
    robot.start()
    taken = set(robot.node.taken) - {"image", "camera_info", "/tf_static"}
    assert taken == ({f"/own/{stated}"} if stated else set())
    assert ["no pose" in line for line in robot.node.lines] == ([] if stated else [True])


def test_damaged_messages_are_named_and_left_out(robot):
    robot.node.values["stale_s"] = 0.3
    robot.start()
    robot.send("image", make("sensor_msgs/msg/Image", encoding="nv21", header=header(time.time(), OPTICAL)))
    robot.send("camera_info", make("sensor_msgs/msg/CameraInfo", k=np.ones(9), binning_x=2))
    bad = make("geometry_msgs/msg/PoseStamped", header=header(1.0, WORLD))
    robot.send("pose", bad)  # a quaternion of zeros
    time.sleep(0.5)
    assert any("'nv21'" in line for line in robot.node.lines)
    assert sum("left out" in line for line in robot.node.lines) == 2


def test_parameters_are_typed_and_described(ros):
    described = ros.DecklineNode().described
    for name, one in described.items():
        default, kind, _ = ros.PARAMETERS[name]
        assert one.name == name and one.description
        assert type(default) is ros_stand_in.PARAMETER_TYPES[one.type] and one.type == kind
    (bounds,) = described["stale_s"].floating_point_range
    assert bounds.from_value < ros.PARAMETERS["stale_s"][0] < bounds.to_value


def test_sensors_and_static_transforms_have_their_quality_of_service(robot):
    robot.start()
    qos = {topic: qos for topic, (_, qos) in robot.node.taken.items()}
    assert {qos[topic].reliability for topic in ("image", "camera_info", "pose")} == {"best effort"}
    assert (qos["/tf_static"].reliability, qos["/tf_static"].durability) == ("reliability", "durability")


def test_a_flight_that_breaks_ends_the_process_with_1(ros, monkeypatch):
    def spin(node):
        node.on_configure(None)
        node._flight.forecast = None  # not callable: a fault in the chain
        node.on_activate(None)
        robot = Robot(node)
        robot.send("image", picture_of(frame(), time.time()))
        node._thread.join(10.0)

    monkeypatch.setattr(ros.rclpy, "spin", spin, raising=False)
    assert ros.main() == 1


def test_the_message_has_every_number_and_status_of_a_record():
    constants, fields = STORE.fielddefs["deckline_msgs/msg/Guidance"]
    names = {name for name, _ in fields}
    assert set(GUIDANCE) <= names
    codes = {name: value for name, _, value in constants}
    assert codes.pop("UNKNOWN") == 0  # of a message that nobody filled
    assert codes == {status.name: code for code, status in enumerate(Status, 1)}
