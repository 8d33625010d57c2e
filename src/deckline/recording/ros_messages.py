"""ROS messages as pictures, depth, cameras and poses; of ROS 1 and 2, as rosbags or rclpy reads them.

ROS worlds are East-North-Up and bodies forward-left-up, or, where a frame's name states it,
North-East-Down (`_ned`) and forward-right-down (`_frd`); pictures are taken in optical frames.
Source: REP 103 (axes, suffixes), REP 105 (frames), REP 118 (depth images), REP 145 (IMU); sensor_msgs/Image,
CompressedImage, CameraInfo and image_encodings.hpp.
"""

from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.config import Navigation
from deckline.files import check_size
from deckline.recording.calibration import to_camera_keys
from deckline.recording.camera_file import MountedCamera, camera_from_mapping
from deckline.recording.images import decode_image
from deckline.recording.pose_track import PoseTrack, make_track
from deckline.recording.source import RecordingError

NED_FROM_ENU = Rotation.from_matrix([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
FLU_FROM_FRD = Rotation.from_matrix(np.diag([1.0, -1.0, -1.0]))
BODY = "base_link"
_BAYER = ("rggb", "bggr", "gbrg", "grbg")
# encoding -> numbers a pixel, their type, how OpenCV makes RGB of them
_ENCODINGS: dict[str, tuple[int, str, int | None]] = {
    "rgb8": (3, "u1", None),
    "bgr8": (3, "u1", cv2.COLOR_BGR2RGB),
    "8UC3": (3, "u1", cv2.COLOR_BGR2RGB),
    "rgba8": (4, "u1", cv2.COLOR_RGBA2RGB),
    "bgra8": (4, "u1", cv2.COLOR_BGRA2RGB),
    "8UC4": (4, "u1", cv2.COLOR_BGRA2RGB),
    "mono8": (1, "u1", cv2.COLOR_GRAY2RGB),
    "8UC1": (1, "u1", cv2.COLOR_GRAY2RGB),
    "rgb16": (3, "u2", None),
    "bgr16": (3, "u2", cv2.COLOR_BGR2RGB),
    "mono16": (1, "u2", cv2.COLOR_GRAY2RGB),
    "yuv422": (2, "u1", cv2.COLOR_YUV2RGB_UYVY),
    "uyvy": (2, "u1", cv2.COLOR_YUV2RGB_UYVY),
    "yuv422_yuy2": (2, "u1", cv2.COLOR_YUV2RGB_YUYV),
    "yuyv": (2, "u1", cv2.COLOR_YUV2RGB_YUYV),
    **{f"bayer_{name}8": (1, "u1", getattr(cv2, f"COLOR_Bayer{name.upper()}2RGB")) for name in _BAYER},
}
_DEPTHS = {"16UC1": ("u2", 1e-3), "32FC1": ("f4", 1.0)}  # type and metres of one count
COMPRESSED_DEPTH = "compressedDepth"


def is_depth(message: Any) -> bool:
    """Whether an Image or a CompressedImage holds depth."""
    return getattr(message, "encoding", "") in _DEPTHS or COMPRESSED_DEPTH in getattr(message, "format", "")


def is_rectified(topic: str) -> bool:
    """Whether a topic's name states undistorted pictures: its last part begins with `image_rect`.

    A last part `compressed`, which image_transport adds, does not count.
    Source: image_proc, whose topics are image_rect and image_rect_color.
    """
    return topic.removesuffix("/compressed").rpartition("/")[2].startswith("image_rect")


def read_time(message: Any) -> float:
    """Time of a message's header, s; 0 where nobody set it."""
    return float(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)


def decode_picture(message: Any) -> NDArray[np.uint8]:
    """RGB (H, W, 3) of an Image or a CompressedImage.

    Raises:
        ValueError: an encoding that is not read, or data cut short or damaged.
    """
    if not hasattr(message, "encoding"):
        return decode_image(bytes(message.data))
    if message.encoding not in _ENCODINGS:
        raise ValueError(f"the encoding {message.encoding!r} is not read; known are {', '.join(_ENCODINGS)}")
    channels, kind, code = _ENCODINGS[message.encoding]
    pixels = _rows(message, channels, kind)
    if kind == "u2":
        pixels = (pixels >> 8).astype(np.uint8)
    return np.ascontiguousarray(pixels if code is None else cv2.cvtColor(pixels, code), dtype=np.uint8)


def decode_depth(message: Any) -> NDArray[np.float32]:
    """Depth (H, W) along the optical axis, m, NaN where nothing was seen, of an Image.

    Raises:
        ValueError: another encoding, or data cut short.
    """
    if getattr(message, "encoding", None) not in _DEPTHS:
        raise ValueError(f"depth must be an Image of {' or '.join(_DEPTHS)}; record it uncompressed")
    kind, unit = _DEPTHS[message.encoding]
    depth = _rows(message, 1, kind)[:, :, 0].astype(np.float32) * np.float32(unit)
    with np.errstate(invalid="ignore"):
        return np.where((depth > 0) & np.isfinite(depth), depth, np.float32(np.nan))


def _rows(message: Any, channels: int, kind: str) -> Any:
    """Pixels (H, W, C) of an Image in this machine's byte order, the padding of its rows cut off."""
    height, width, step = message.height, message.width, message.step
    check_size(width, height)
    order, size = ">" if message.is_bigendian else "<", int(kind[1])
    data = np.frombuffer(message.data, np.uint8)
    if not 0 < width * channels * size <= step or not 0 < height * step <= len(data):
        raise ValueError(f"{width}x{height} px of {message.encoding} in rows of {step} bytes do not fit {len(data)}")
    rows = data[: height * step].reshape(height, step)[:, : width * channels * size]
    pixels = np.ascontiguousarray(rows).view(f"{order}{kind}").reshape(height, width, channels)
    return pixels.astype(kind)


def camera_from_info(info: Any, rectified: bool, where: str) -> MountedCamera | None:
    """The camera of a CameraInfo, looking along the body's forward axis; None where it is not calibrated.

    Args:
        info: the message; k and d in ROS 2, K and D in ROS 1.
        rectified: pictures are undistorted: P counts, and there is no distortion.
        where: begins the errors.

    Raises:
        RecordingError: values that make no camera.
    """
    k, d, p = (np.asarray(getattr(info, name, getattr(info, name.upper(), ()))).tolist() for name in ("k", "d", "p"))
    if not any(k):
        return None
    values = {"image_width": info.width, "image_height": info.height, "camera_matrix": k}
    if rectified and any(p):
        values["camera_matrix"] = [*p[0:3], *p[4:7], *p[8:11]]
    elif d:
        values |= {"distortion_coefficients": d, "distortion_model": info.distortion_model or "plumb_bob"}
    if max(info.binning_x, info.binning_y) > 1 or info.roi.width or info.roi.x_offset or info.roi.y_offset:
        raise RecordingError(f"{where}: binning and regions of interest are not read; give --camera FILE")
    try:
        keys = to_camera_keys(values)
    except ValueError as error:
        raise RecordingError(f"{where}: {error}") from None
    return camera_from_mapping(keys, where)


def world_from_ros(frame: str) -> Rotation:
    """Our world from a ROS world's axes."""
    return Rotation.identity() if frame.endswith("ned") else NED_FROM_ENU


def ros_from_body(frame: str) -> Rotation:
    """A ROS body's axes from ours."""
    return Rotation.identity() if frame.endswith(("frd", "ned")) else FLU_FROM_FRD


def turn_axes(world_from_body: RigidTransform, world: str, body: str) -> RigidTransform:
    """Poses in the axes of ROS frames with these names, in ours."""
    before, after = world_from_ros(world), ros_from_body(body)
    return RigidTransform.from_rotation(before) * world_from_body * RigidTransform.from_rotation(after)


def turn_track(track: PoseTrack, world: str, body: str) -> PoseTrack:
    """A track in the axes of ROS frames with these names, in ours."""
    turned = turn_axes(RigidTransform.from_components(track.positions_m, track.rotations), world, body)
    return replace(track, positions_m=turned.translation, rotations=turned.rotation)


def read_pose(message: Any) -> list[float]:
    """Position, m, and quaternion, scalar first, of a PoseStamped, a PoseWithCovarianceStamped or an Odometry."""
    inner = message.pose.pose if hasattr(message.pose, "pose") else message.pose
    return [inner.position.x, inner.position.y, inner.position.z, *_quaternion(inner.orientation)]


def read_attitude(message: Any) -> list[float]:
    """Zeros for the position and the quaternion, scalar first, of an Imu; NaN where it has none."""
    is_known = message.orientation_covariance[0] != -1.0
    return [0.0, 0.0, 0.0, *(_quaternion(message.orientation) if is_known else [np.nan] * 4)]


def read_fix(message: Any) -> list[float]:
    """Latitude, longitude, degrees, and altitude, m, of a NavSatFix, NaN without a fix, and a level attitude."""
    known = [message.latitude, message.longitude, message.altitude]
    return [*(known if message.status.status >= 0 else [np.nan] * 3), 1.0, 0.0, 0.0, 0.0]


def _quaternion(q: Any) -> list[float]:
    return [q.w, q.x, q.y, q.z]


@dataclass(eq=False)
class TransformTree:
    """What TF messages state: parent of each frame, and rows of time, position and quaternion (scalar first)."""

    parents: dict[str, str] = field(default_factory=dict)
    rows: dict[str, list[list[float]]] = field(default_factory=dict)

    def add(self, message: Any, is_static: bool) -> None:
        """Take a TFMessage; of a static transform the last one counts."""
        for stamped in message.transforms:
            child, move = stamped.child_frame_id.lstrip("/"), stamped.transform.translation
            self.parents[child] = stamped.header.frame_id.lstrip("/")
            row = [read_time(stamped), move.x, move.y, move.z, *_quaternion(stamped.transform.rotation)]
            if is_static:
                self.rows[child] = []
            self.rows.setdefault(child, []).append(row)

    def moves(self, frame: str) -> bool:
        """Whether it moves against its parent."""
        return len(self.rows[frame]) > 1

    def path(self, frame: str) -> list[str]:
        """A frame and those above it, up to the root."""
        path = [frame.lstrip("/")]
        while (parent := self.parents.get(path[-1])) is not None and parent not in path:
            path.append(parent)
        return path

    def resolve(self, path: list[str], name: str, navigation: Navigation) -> "PoseTrack | RigidTransform":
        """The last frame of a path from its first one: over time where something moves, in ROS axes.

        Raises:
            RecordingError: transforms that are no track.
        """
        whole: Any = RigidTransform.identity()
        edges = {child: np.array(self.rows[child]) for child in path[:-1]}
        tracks = {
            child: make_track(f"{name} of {child}", rows[:, 0], rows[:, 1:4], rows[:, 4:], navigation)
            for child, rows in edges.items()
            if self.moves(child)
        }
        times = max((track.times_s for track in tracks.values()), key=len, default=np.zeros(0))
        for child in reversed(path[:-1]):
            if child in tracks:
                step = RigidTransform.from_components(*tracks[child].sample(times))
            else:
                step = RigidTransform.from_components(
                    edges[child][0, 1:4], Rotation.from_quat(edges[child][0, 4:], scalar_first=True)
                )
            whole = whole * step
        if not tracks:
            return whole
        known = [track.times_s[[0, -1]] for track in tracks.values()]
        within = (times >= max(first for first, _ in known)) & (times <= min(last for _, last in known))
        quaternions = whole.rotation.as_quat(scalar_first=True)
        return make_track(name, times[within], whole.translation[within], quaternions[within], navigation)


def read_mount(
    tree: TransformTree, frame: str, body: str, name: str, navigation: Navigation
) -> PoseTrack | RigidTransform | None:
    """body_from_camera in our axes; None without a way from one to the other."""
    path = tree.path(frame)
    if body not in path:
        return None
    mount = tree.resolve(path[: path.index(body) + 1], name, navigation)
    turn = RigidTransform.from_rotation(ros_from_body(body).inv())
    if isinstance(mount, RigidTransform):
        return turn * mount
    turned = turn * RigidTransform.from_components(mount.positions_m, mount.rotations)
    return replace(mount, positions_m=turned.translation, rotations=turned.rotation)
