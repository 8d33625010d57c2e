"""deckline as a lifecycle node of ROS 2: pictures, camera_info, poses and /tf_static in, guidance out.

    ros2 launch deckline_ros deckline.launch.py image:=/camera/image_raw pose:=/pose deck_z_m:=-18.0

Tried against a stand-in of rclpy, not with ROS.
"""

import math
import sys
import threading
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import rclpy
from deckline_msgs.msg import Guidance
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, ParameterType
from rclpy.executors import ExternalShutdownException
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from scipy.spatial.transform import RigidTransform
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import ImageMarker, MarkerArray

from deckline.adapters.ros import messages
from deckline.adapters.ros.encode import Encoder
from deckline.config import RunConfig
from deckline.files import describe_error
from deckline.flight import Flight, FrameResult
from deckline.geometry import pose
from deckline.live.pipeline import STALE_S, LiveSession, Outputs, live_config
from deckline.live.poses import PoseBuffer
from deckline.options import read_run_config
from deckline.recording.camera_file import MountedCamera
from deckline.recording.ros_messages import (
    BODY,
    TransformTree,
    camera_from_info,
    is_rectified,
    read_mount,
    read_pose,
    read_time,
    turn_axes,
)
from deckline.report.records import Record
from deckline.types import Status
from deckline_ros.picture_topic import NAME, PictureTopic
from deckline_ros.values import fill, guidance_values, rename_frames

GUIDANCE_TOPIC, DEPTH = "/deckline/guidance", 10
THROTTLE_S = 5.0  # between two lines about messages that are left out
PUBLISHED = {
    GUIDANCE_TOPIC: Guidance,
    messages.POSE_TOPIC: PoseWithCovarianceStamped,
    messages.LINES_TOPIC: MarkerArray,
    messages.SEEN_TOPIC: ImageMarker,
    messages.DIAGNOSTICS_TOPIC: DiagnosticArray,
}
TRANSPORTS = {"raw": (Image, "image"), "compressed": (CompressedImage, "image/compressed")}
LATCHED = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
TEXT, NUMBER, SWITCH = ParameterType.PARAMETER_STRING, ParameterType.PARAMETER_DOUBLE, ParameterType.PARAMETER_BOOL
PARAMETERS = {  # default, type, description
    "config": ("", TEXT, "TOML file of the configuration; empty: the defaults"),
    "deck_z_m": (math.nan, NUMBER, "world z of the deck, m, down positive; NaN: not known"),
    "sea_z_m": (math.nan, NUMBER, "world z of the water, m, down positive; NaN: not known"),
    "stale_s": (STALE_S, NUMBER, "seconds without a picture after which guidance is stale"),
    "pose": ("", TEXT, "topic of the body's poses, PoseStamped; empty: none"),
    "odom": ("", TEXT, "topic of the body's poses, Odometry, in place of pose; empty: none"),
    "base_frame": (BODY, TEXT, "frame of the body whose poses come in"),
    "image_transport": ("raw", TEXT, "raw or compressed pictures"),
    "publish_tf": (False, SWITCH, "send the deck's transform on /tf; a transform of the body is never sent"),
}
RANGES = {"stale_s": [FloatingPointRange(from_value=0.05, to_value=60.0)]}


class DecklineNode(LifecycleNode):
    """Configured, it has its networks and topics; active, it flies in threads of its own.

    Attributes:
        has_failed: a flight ended by an error.
    """

    _flight: Flight
    _thread: threading.Thread
    _outgoing: dict[str, Any]

    def __init__(self) -> None:
        super().__init__("deckline")
        for name, (default, kind, text) in PARAMETERS.items():
            described = ParameterDescriptor(name=name, type=kind, description=text)
            described.floating_point_range = RANGES.get(name, [])
            self.declare_parameter(name, default, described)
        self.has_failed = False
        self._encoder = Encoder()
        self._codes = {status: getattr(Guidance, status.name) for status in Status}
        self._open = ExitStack()  # what is configured; closing it stops a flight first
        self._session: LiveSession | None = None

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Load the networks and open the topics; a parameter that cannot be used is one line and FAILURE."""
        try:
            self._configure({name: self.get_parameter(name).value for name in PARAMETERS})
        except (ValueError, OSError, ImportError) as error:
            self.get_logger().error(describe_error(error))
            self._open.close()
            return TransitionCallbackReturn.FAILURE
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin a flight: without a track, with the camera, mount and poses that came so far."""
        self._flight.reset()
        self._pictures = PictureTopic()
        outputs = Outputs(lambda record: None, self.get_logger().warning, views=(self._publish,))
        self._session = LiveSession(self._pictures, self._flight, outputs, poses=self._find_pose, stale_s=self._stale_s)
        self._thread = threading.Thread(target=self._fly, args=(self._session,))
        done = super().on_activate(state)
        self._thread.start()
        return done

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._stop()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        self.release()
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        self.release()
        return super().on_shutdown(state)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        self.release()
        return super().on_error(state)

    def release(self) -> None:
        """End the flight, and give back topics and networks."""
        self._stop()
        self._open.close()

    def _configure(self, given: dict[str, Any]) -> None:
        if given["image_transport"] not in TRANSPORTS:
            raise ValueError(f"image_transport must be {' or '.join(TRANSPORTS)}, got {given['image_transport']!r}")
        if given["pose"] and given["odom"]:
            raise ValueError(f"state pose or odom, got both: {given['pose']!r} and {given['odom']!r}")
        self._config = live_config(read_run_config(Path(given["config"])) if given["config"] else RunConfig())
        self._heights_m = [None if math.isnan(given[name]) else given[name] for name in ("deck_z_m", "sea_z_m")]
        self._base, self._stale_s = given["base_frame"], given["stale_s"]
        self._camera: MountedCamera | None = None
        self._tree, self._poses = TransformTree(), PoseBuffer(self._config.navigation.max_gap_s)
        self._names: dict[str, str] = {messages.BODY: self._base}  # frames of our messages -> those of this robot
        self._pictures = PictureTopic()
        self._flight = self._open.enter_context(Flight.from_config(self._config))
        kinds = PUBLISHED | ({messages.TF_TOPIC: TFMessage} if given["publish_tf"] else {})
        self._outgoing = {}
        for topic, kind in kinds.items():
            self._outgoing[topic] = publisher = self.create_lifecycle_publisher(kind, topic, DEPTH)
            self._open.callback(self.destroy_lifecycle_publisher, publisher)
        picture, topic = TRANSPORTS[given["image_transport"]]
        self._is_rectified = is_rectified(self.resolve_topic_name(topic))
        poses = (PoseStamped, given["pose"]), (Odometry, given["odom"])
        for kind, name, take, qos in (
            (picture, topic, self._take_picture, qos_profile_sensor_data),
            (CameraInfo, "camera_info", self._take_info, qos_profile_sensor_data),
            (TFMessage, "/tf_static", self._take_static, LATCHED),
            *((kind, name, self._take_pose, qos_profile_sensor_data) for kind, name in poses if name),
        ):
            self._open.callback(self.destroy_subscription, self.create_subscription(kind, name, take, qos))
        if not given["pose"] and not given["odom"]:
            self.get_logger().warning("no pose and no odom stated: the pictures alone say where the aircraft is")

    def _fly(self, session: LiveSession) -> None:
        try:
            session.run()
        except Exception as error:
            self.has_failed = True
            self.get_logger().error(f"the flight ended: {describe_error(error)}")
            rclpy.try_shutdown()

    def _stop(self) -> None:
        if self._session is not None:
            self._session.stop()
            self._thread.join()
            self._session = None

    def _now_s(self) -> float:
        return float(1e-9 * self.get_clock().now().nanoseconds)

    def _take_picture(self, message: Any) -> None:
        age_s = min(self._now_s() - read_time(message), self._stale_s + 1.0)  # one without a time is stale
        frame = message.header.frame_id
        self._names[messages.CAMERA] = frame or messages.CAMERA
        mount = read_mount(self._tree, frame, self._base, "/tf_static", self._config.navigation)
        self._pictures.put(message, age_s, self._camera, mount)

    def _take_info(self, message: Any) -> None:
        if self._camera is not None:
            return
        try:
            camera = camera_from_info(message, self._is_rectified, "camera_info")
            self._camera = None if camera is None else camera.at(*self._heights_m)
        except ValueError as error:
            self._complain(error)

    def _find_pose(self, time_s: float) -> RigidTransform | None:
        return self._poses.at(time_s + (self._config.navigation.offset_s or 0.0))

    def _take_static(self, message: Any) -> None:
        self._tree.add(message, is_static=True)

    def _take_pose(self, message: Any) -> None:
        world, values = message.header.frame_id, read_pose(message)
        body = getattr(message, "child_frame_id", "") or self._base
        try:
            if body.lstrip("/") != self._base.lstrip("/"):
                raise ValueError(f"odometry of {body!r}, expected that of base_frame, {self._base!r}")
            world_from_body = turn_axes(pose(values[:3], values[3:]), world, self._base)
            now_s = self._now_s() + (self._config.navigation.offset_s or 0.0)
            self._poses.add(read_time(message), world_from_body, now_s)
        except ValueError as error:
            return self._complain(error)
        if world and not world.endswith("ned"):  # our messages' world is East-North-Up
            self._names[messages.MAP] = world

    def _complain(self, error: ValueError) -> None:
        self.get_logger().warning(f"left out: {error}", throttle_duration_sec=THROTTLE_S)

    def _publish(self, result: FrameResult | None, record: Record) -> None:
        time_s = self._now_s() if result is None else result.frame.time_s
        values = guidance_values(record, messages.header(time_s, self._base), self._codes)
        self._outgoing[GUIDANCE_TOPIC].publish(fill(Guidance(), values))
        found = [] if result is None else messages.guidance_messages(result, record, self._config)
        for topic, kind, plain in (*found, messages.diagnostics(record, NAME, time_s)):
            if topic in self._outgoing:
                self._outgoing[topic].publish(self._encoder(kind, rename_frames(plain, self._names)))


def main() -> int:
    """Spin until Ctrl-C or a shutdown; 1 after a flight that ended by an error."""
    rclpy.init()
    node = DecklineNode()
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.release()
        node.destroy_node()
        rclpy.try_shutdown()
    return int(node.has_failed)


if __name__ == "__main__":
    sys.exit(main())
