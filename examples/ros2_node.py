"""deckline as a ROS 2 node: pictures, camera_info and poses in, guidance out.

    ros2 launch examples/ros2_node.launch.py image:=/camera/image_raw pose:=/mavros/local_position/pose deck_z_m:=-18.0

Needs rclpy and `pip install "deckline[ros]"`. Not run with ROS here, only against a stand-in of rclpy.
"""

import math
import threading
import time

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import ImageMarker, MarkerArray

from deckline.adapters.ros import messages
from deckline.adapters.ros.encode import Encoder
from deckline.config import RunConfig
from deckline.config_file import read_config
from deckline.flight import Flight
from deckline.geometry import attitude, camera_mount, pose
from deckline.live.mailbox import Mailbox
from deckline.live.pipeline import STALE_S, WAIT_S, LiveSession, Outputs
from deckline.live.poses import PoseBuffer
from deckline.live.source import Captured, LiveSource
from deckline.recording import BadFrame
from deckline.recording.camera_file import make_plain_frame
from deckline.recording.ros_messages import BODY, camera_from_info, decode_picture, read_pose, read_time, turn_axes

PUBLISHED = {
    messages.POSE_TOPIC: PoseWithCovarianceStamped,
    messages.LINES_TOPIC: MarkerArray,
    messages.SEEN_TOPIC: ImageMarker,
    messages.TF_TOPIC: TFMessage,
    messages.DIAGNOSTICS_TOPIC: DiagnosticArray,
}
MOUNT = {"mount_m": [0.0] * 3, "mount_deg": [0.0] * 3}  # forward, right, down; roll, pitch, yaw
PARAMETERS = {"config": "", "deck_z_m": math.nan, "sea_z_m": math.nan, "stale_s": STALE_S, **MOUNT}


class PictureTopic(LiveSource):
    """The newest picture of a subscription."""

    def __init__(self, mount, heights_m):
        super().__init__("ros2")
        self.mailbox, self.camera, self._mount, self._heights_m = Mailbox(), None, mount, heights_m

    def captures(self):
        while not self.stopped.is_set():
            if (taken := self.mailbox.take(WAIT_S)) is not None:
                yield self._capture(*taken)

    def _capture(self, message, at_s):
        try:
            image, time_s = decode_picture(message), read_time(message)
            if self.camera is None:
                return Captured(make_plain_frame("ros2", time_s, image), at_s)
            mounted = self.camera.at(*self._heights_m).fit(image.shape[1], image.shape[0])
            frame = mounted.frame("ros2", time_s, image, body_from_camera=self._mount)
            return Captured(frame, at_s)
        except ValueError as error:
            return BadFrame("ros2", str(error))


class DecklineNode(Node):
    """Subscribes, flies and publishes; `session` does the work in its own threads."""

    def __init__(self):
        super().__init__("deckline")
        given = {name: self.declare_parameter(name, default).value for name, default in PARAMETERS.items()}
        self.config = read_config(RunConfig, given["config"]) if given["config"] else RunConfig()
        mount = camera_mount(given["mount_m"], attitude(*np.deg2rad(given["mount_deg"])))
        heights_m = [None if math.isnan(given[name]) else given[name] for name in ("deck_z_m", "sea_z_m")]
        self.pictures, self.poses = PictureTopic(mount, heights_m), PoseBuffer(self.config.navigation.max_gap_s)
        self.encoder = Encoder()
        self.outgoing = {topic: self.create_publisher(kind, topic, 10) for topic, kind in PUBLISHED.items()}
        for kind, topic, take in (
            (Image, "image", self.take_picture),
            (CompressedImage, "image/compressed", self.take_picture),
            (CameraInfo, "camera_info", self.take_info),
            (PoseStamped, "pose", self.take_pose),
            (Odometry, "odom", self.take_pose),
        ):
            self.create_subscription(kind, topic, take, qos_profile_sensor_data)
        outputs = Outputs(lambda record: None, self.get_logger().info, views=(self.publish,))
        flight, stale_s = Flight.from_config(self.config), given["stale_s"]
        self.session = LiveSession(self.pictures, flight, outputs, poses=self.poses.at, stale_s=stale_s)

    def now_s(self):
        return 1e-9 * self.get_clock().now().nanoseconds

    def take_picture(self, message):
        age_s = min(max(self.now_s() - read_time(message), 0.0), 1.0)
        self.pictures.mailbox.put((message, time.monotonic() - age_s))

    def take_info(self, message):
        if self.pictures.camera is None:
            self.pictures.camera = camera_from_info(message, False, "camera_info")

    def take_pose(self, message):
        values, body = read_pose(message), getattr(message, "child_frame_id", "") or BODY
        try:
            world_from_body = turn_axes(pose(values[:3], values[3:]), message.header.frame_id, body)
            self.poses.add(read_time(message), world_from_body)
        except ValueError as error:
            self.get_logger().info(f"a pose is left out: {error}")

    def publish(self, result, record):
        found = [] if result is None else messages.guidance_messages(result, record, self.config)
        time_s = self.now_s() if result is None else result.frame.time_s
        for topic, kind, values in [*found, messages.diagnostics(record, "ros2", time_s)]:
            self.outgoing[topic].publish(self.encoder(kind, values))


def main():
    rclpy.init()
    node = DecklineNode()
    flying = threading.Thread(target=node.session.run)
    flying.start()
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.session.stop()
        flying.join()
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
