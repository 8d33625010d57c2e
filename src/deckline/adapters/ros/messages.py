"""Frames and guidance as standard ROS 2 messages: plain values by field, which `encode.Encoder` makes bytes of.

Frames: `map` (East-North-Up of the poses' world), `base_link` (the aircraft, forward-left-up), `camera_optical_frame`
(z forward), and `deck`: origin in the middle of the ramp, x along the landing, y left, z up. A pose of the picture has
no place in `map`: `deck` is then a child of `base_link`, and lines are in `deck`, in metres or not at all.
Source: REP 103 (axes), REP 105 (frames); common_interfaces of ROS 2, whose fields are the same from Humble to Lyrical.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.config import RunConfig
from deckline.flight import FrameResult
from deckline.geometry import Camera
from deckline.recording.ros_messages import BODY, FLU_FROM_FRD, NED_FROM_ENU
from deckline.report import draw
from deckline.report.records import LINES, Record
from deckline.types import SIDES, Frame, PoseSource, Status

Values = dict[str, Any]
Message = tuple[str, str, Values]  # topic, type, values by field; fields that are left out are zero or empty
MAP, CAMERA, DECK = "map", "camera_optical_frame", "deck"
IMAGE_TOPIC, INFO_TOPIC = "/deckline/image/compressed", "/deckline/camera_info"
DEPTH_TOPIC = "/deckline/depth"
POSE_TOPIC, LINES_TOPIC, SEEN_TOPIC = "/deckline/pose", "/deckline/lines", "/deckline/annotations"
DIAGNOSTICS_TOPIC, TF_TOPIC = "/diagnostics", "/tf"
TOPICS = {
    IMAGE_TOPIC: "sensor_msgs/msg/CompressedImage",
    DEPTH_TOPIC: "sensor_msgs/msg/Image",
    INFO_TOPIC: "sensor_msgs/msg/CameraInfo",
    POSE_TOPIC: "geometry_msgs/msg/PoseWithCovarianceStamped",
    LINES_TOPIC: "visualization_msgs/msg/MarkerArray",
    SEEN_TOPIC: "visualization_msgs/msg/ImageMarker",
    TF_TOPIC: "tf2_msgs/msg/TFMessage",
    DIAGNOSTICS_TOPIC: "diagnostic_msgs/msg/DiagnosticArray",
}
GUIDES = (Status.OK, Status.UNVERIFIED)  # only these, without a flag, make poses, a deck and lines in the world
LEVELS = {Status.OK: 0, Status.UNVERIFIED: 1, Status.ONE_LINE: 1, Status.COASTING: 1, Status.STALE: 3}
ERROR = 2
LINE_LIST, DELETE_ALL, IMAGE_LINE_LIST = 5, 3, 2  # of Marker and ImageMarker
DRAWN_M, WIDTH_M = 200.0, 0.4  # of lines in the world, from the ramp on
COLOURS = {"left": draw.LEFT, "right": draw.RIGHT, "centre": draw.CENTRE}
UPRIGHT = RigidTransform.from_rotation(FLU_FROM_FRD)  # its own inverse
MAP_FROM_WORLD = RigidTransform.from_rotation(NED_FROM_ENU)  # its own inverse


def header(time_s: float, frame: str) -> Values:
    nanoseconds = round(1e9 * time_s)
    return {"stamp": {"sec": nanoseconds // 10**9, "nanosec": nanoseconds % 10**9}, "frame_id": frame}


def frame_messages(frame: Frame, picture: bytes, picture_format: str) -> list[Message]:
    """A frame: its picture as the bytes of a file, and its camera and transforms where they are known."""
    head = header(frame.time_s, CAMERA)
    messages = [message(IMAGE_TOPIC, {"header": head, "format": picture_format, "data": picture})]
    is_picture = frame.pose_source is PoseSource.PICTURE
    if frame.camera.known and frame.camera.focal_sigma is None:  # a reader takes it for calibrated
        messages.append(message(INFO_TOPIC, {"header": head, **camera_values(frame.camera)}))
    if frame.camera.known:
        mount = _transform(frame.time_s, BODY, CAMERA, UPRIGHT * frame.body_from_camera)
        moves = [mount]
        if frame.world_from_body is not None and not is_picture:
            moves.append(_transform(frame.time_s, MAP, BODY, MAP_FROM_WORLD * frame.world_from_body * UPRIGHT))
        messages.append(message(TF_TOPIC, {"transforms": moves}))
    return messages


def depth_message(frame: Frame) -> list[Message]:
    """A frame's depth, m along the optical axis, if it has one."""
    if frame.depth_m is None:
        return []
    height, width = frame.depth_m.shape
    data = frame.depth_m.astype("<f4").tobytes()
    values = {"height": height, "width": width, "encoding": "32FC1", "step": 4 * width, "data": data}
    return [message(DEPTH_TOPIC, {"header": header(frame.time_s, CAMERA), **values})]


def message(topic: str, values: Values) -> Message:
    return topic, TOPICS[topic], values


def camera_values(camera: Camera) -> Values:
    """Fields of a CameraInfo besides the header."""
    model = "equidistant" if camera.fisheye else "plumb_bob" if len(camera.distortion) == 5 else "rational_polynomial"
    return {
        "height": camera.height,
        "width": camera.width,
        "distortion_model": model,
        "d": camera.distortion,
        "k": camera.matrix.ravel(),
        "r": np.eye(3).ravel(),
        "p": np.column_stack([camera.matrix, np.zeros(3)]).ravel(),
    }


def guidance_messages(result: FrameResult, record: Record, config: RunConfig) -> list[Message]:
    """What was found in a frame: the lines in the picture, and, of trusted guidance alone, pose, deck and lines.

    Guidance is trusted without a flag: nobody may follow the numbers of a flagged frame.
    """
    frame, is_trusted = result.frame, record["status"] in GUIDES and not record["flags"]
    messages = [message(SEEN_TOPIC, _seen(result))]
    is_picture = frame.pose_source is PoseSource.PICTURE
    deck = deck_from_body(result, config.approach.point_m) if is_trusted else None
    if deck is not None and frame.world_from_body is not None:
        move = _transform(frame.time_s, BODY, DECK, UPRIGHT * deck.inv() * UPRIGHT)
        if not is_picture:
            move = _transform(frame.time_s, MAP, DECK, MAP_FROM_WORLD * frame.world_from_body * deck.inv() * UPRIGHT)
        messages.append(message(TF_TOPIC, {"transforms": [move]}))
        covariance = _covariance(result, np.deg2rad(config.sensors.attitude_deg))
        pose = {"pose": _pose(UPRIGHT * deck * UPRIGHT), "covariance": covariance}
        messages.append(message(POSE_TOPIC, {"header": header(frame.time_s, DECK), "pose": pose}))
    has_lines = is_trusted and (deck is not None or not is_picture)
    messages.append(message(LINES_TOPIC, {"markers": _lines(result, deck) if has_lines else [{"action": DELETE_ALL}]}))
    return messages


def deck_from_body(result: FrameResult, point_m: ArrayLike) -> RigidTransform | None:
    """The aircraft's pose, forward-right-down, in the deck's frame, forward-right-down; None of guidance that lacks
    a number for it.

    Args:
        result: of a frame.
        point_m: the point (3,) of the aircraft that deviations refer to.
    """
    guidance, body = result.guidance, result.frame.world_from_body
    across, up, ahead = guidance.lateral_deviation_m, guidance.height_above_deck_m, guidance.distance_to_ramp_m
    heading = guidance.heading_error_rad
    if body is None or across is None or up is None or ahead is None or heading is None:
        return None
    nose = body.rotation.apply([1.0, 0.0, 0.0])
    turn = Rotation.from_euler("z", heading.value - np.arctan2(nose[1], nose[0])) * body.rotation
    place = np.array([-ahead.value, across.value, -up.value])
    return RigidTransform.from_components(place - turn.apply(point_m), turn)


def diagnostics(record: Record, source: str, time_s: float) -> Message:
    """Status, reason, flags and all numbers of a record, for /diagnostics."""
    status = record.get("status", "skipped")
    numbers = {**(record.get("guidance") or {}), **(record.get("protection") or {})}
    flat = {key: value["value"] if isinstance(value, dict) else value for key, value in numbers.items()}
    flat |= {f"{key}_sigma": value["sigma"] for key, value in numbers.items() if isinstance(value, dict)}
    flat["flags"] = ", ".join(flag["name"] for flag in record.get("flags", ()))
    flat |= {key: record[key] for key in ("seen", "pose_source", "mode", "edge", "skipped") if record.get(key)}
    flat["scale_sources"] = ", ".join(record.get("scale_sources", ()))
    values = [{"key": key, "value": str(value)} for key, value in flat.items() if value not in (None, "")]
    reason = record.get("reason") or record.get("skipped", "")
    state = {"level": LEVELS.get(status, ERROR), "name": "deckline: guidance", "hardware_id": source, "values": values}
    state["message"] = f"{status}: {reason}" if reason else str(status)
    return message(DIAGNOSTICS_TOPIC, {"header": header(time_s, ""), "status": [state]})


def _seen(result: FrameResult) -> Values:
    """The lines that a picture shows, in pixels, as an ImageMarker; without points where it shows none."""
    shown = {side: line for side in SIDES if (line := result.estimate.pixel_lines.get(side)) is not None}
    return {
        "header": header(result.frame.time_s, CAMERA),
        "ns": "lines",
        "type": IMAGE_LINE_LIST,
        "scale": 2.0,
        "points": [{"x": float(u), "y": float(v)} for line in shown.values() for u, v in line.ends_px],
        "outline_color": _colour("left"),
        "outline_colors": [_colour(side) for side in shown for _ in range(2)],
    }


def _lines(result: FrameResult, deck: RigidTransform | None) -> list[Values]:
    """The lines of the track, else of the frame, from the ramp on: in the world; of the picture's pose in the deck."""
    frame, parent, parent_from_world = result.frame, MAP, MAP_FROM_WORLD
    if frame.pose_source is PoseSource.PICTURE and deck is not None and frame.world_from_body is not None:
        parent, parent_from_world = DECK, UPRIGHT * deck * frame.world_from_body.inv()
    is_tracked = result.track is not None and bool(result.track.lines)
    source: Any = result.track if is_tracked else result.estimate
    markers: list[Values] = [{"action": DELETE_ALL}]
    for number, name in enumerate(LINES):
        if (line := source.lines.get(name)) is None:
            continue
        start = 0.0 if source.ramp_m is None else float((source.ramp_m - line.point_m) @ line.direction)
        ends = parent_from_world.apply(line.point_m + np.outer([start, start + DRAWN_M], line.direction))
        head, points = header(frame.time_s, parent), [_vector(end) for end in ends]
        shape = {"type": LINE_LIST, "scale": {"x": WIDTH_M}, "pose": {"orientation": {"w": 1.0}}}
        marker = {"header": head, "ns": "lines", "id": number, "points": points, "color": _colour(name)}
        markers.append(marker | shape)
    return markers


def _covariance(result: FrameResult, attitude_rad: float) -> Sequence[float]:
    """(36,) of x, y, z, roll, pitch, yaw in the deck's frame; roll and pitch are as good as the stated attitude."""
    guidance = result.guidance
    values = (guidance.distance_to_ramp_m, guidance.lateral_deviation_m, guidance.height_above_deck_m)
    sigmas = [*(value.sigma if value else 0.0 for value in values), attitude_rad, attitude_rad]
    sigmas.append(guidance.heading_error_rad.sigma if guidance.heading_error_rad else 0.0)
    return np.diag(np.square(sigmas)).ravel().tolist()


def _transform(time_s: float, parent: str, child: str, transform: RigidTransform) -> Values:
    pose = _pose(transform)
    moved = {"translation": pose["position"], "rotation": pose["orientation"]}
    return {"header": header(time_s, parent), "child_frame_id": child, "transform": moved}


def _pose(transform: RigidTransform) -> Values:
    orientation = dict(zip("xyzw", transform.rotation.as_quat().tolist(), strict=True))
    return {"position": _vector(transform.translation), "orientation": orientation}


def _vector(values: Any) -> Values:
    return dict(zip("xyz", map(float, values), strict=True))


def _colour(name: str) -> Values:
    return dict(zip("rgba", (*(level / 255 for level in COLOURS[name]), 1.0), strict=True))
