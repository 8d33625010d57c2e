"""From AirSim's answers to a Frame: picture, depth and pose of one instant.

AirSim notes the camera's pose when it draws, and gives it with each image; the vehicle's pose has to be asked for, and
is then of a later instant. So the frame's pose comes from the image alone: world_from_body = world_from_camera of the
image * camera_from_body of the mount, which hardly changes.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from deckline.adapters.airsim.client import DEPTH_PLANAR, pose_of
from deckline.geometry import Camera, camera_mount
from deckline.recording.depth import FAR_DEPTH_M, along_axis, check_depth_size
from deckline.types import Frame

NS_PER_S = 10**9  # whole, so that division by it keeps all of the time stamp
SAME_M = 0.01  # poses of picture and depth: farther apart, the depth is not the picture's
SAME_RAD = 2e-4  # about as much at the 50 m at which the lines fill the picture; single precision leaves 1e-6


@dataclass(frozen=True, eq=False)
class View:
    """What belongs to every frame of a camera."""

    camera: str  # AirSim's name of it
    body_from_camera: RigidTransform
    fov_rad: float  # horizontal
    deck_z_m: float | None = None  # world z (down) of the deck plane
    far_m: float = FAR_DEPTH_M  # depths from here on mean "nothing seen"
    sea_z_m: float | None = None  # world z (down) of the water


def frame_name(camera: str, scene: Mapping[str, Any]) -> str:
    """What a live frame is called: the camera and the picture's time in ns."""
    return f"{camera}#{scene.get('time_stamp')}"


def live_frame(scene: Mapping[str, Any], depth: Mapping[str, Any], view: View) -> Frame:
    """A frame from the answers to simGetImages for the picture and the planar depth.

    Args:
        scene: the picture, raw bytes in the order B, G, R.
        depth: metres along the axis, one float a pixel, top row first.
        view: camera, mount and deck.

    Raises:
        ValueError: an answer that is empty or broken, or answers that do not belong together.
    """
    image = raw_image(scene)
    stored = float_image(depth)
    camera = Camera.from_fov(image.shape[1], image.shape[0], view.fov_rad)
    check_depth_size(stored.shape, camera, "DepthPlanar")
    world_from_mount = _image_pose(scene, "Scene")
    _check_same(world_from_mount, _image_pose(depth, "DepthPlanar"))
    return Frame(
        file=frame_name(view.camera, scene),
        time_s=_time_s(scene),
        image_rgb=image,
        camera=camera,
        body_from_camera=view.body_from_camera,
        depth_m=along_axis(stored, camera, DEPTH_PLANAR, view.far_m),
        world_from_body=world_from_mount * camera_mount() * view.body_from_camera.inv(),
        deck_z_m=view.deck_z_m,
        sea_z_m=view.sea_z_m,
    )


def raw_image(answer: Mapping[str, Any]) -> NDArray[np.uint8]:
    """Raw picture B, G, R -> RGB uint8 (H, W, 3).

    Raises:
        ValueError: empty, or another number of bytes.
    """
    height, width = _shape(answer, "Scene")
    data = answer.get("image_data_uint8")
    if not isinstance(data, bytes) or len(data) != height * width * 3:
        came = f"{len(data)} bytes" if isinstance(data, bytes) else type(data).__name__
        raise ValueError(f"Scene of {width}x{height} px must have {height * width * 3} bytes (B, G, R), got {came}")
    bgr = np.frombuffer(data, np.uint8).reshape(height, width, 3)
    return np.ascontiguousarray(bgr[:, :, ::-1])


def float_image(answer: Mapping[str, Any]) -> NDArray[np.float32]:
    """Float depth -> float32 (H, W), as sent.

    Raises:
        ValueError: empty, a picture in its place, or another count of numbers.
    """
    height, width = _shape(answer, "DepthPlanar")
    data = answer.get("image_data_float")
    count = len(data) if isinstance(data, list) else 0
    if count <= 1 < height * width:
        raise ValueError(f"DepthPlanar of {width}x{height} px came without numbers: its grey levels are no metres")
    try:
        values = np.array(data, dtype=np.float32)
    except (TypeError, ValueError):
        raise ValueError("DepthPlanar holds what is no number") from None
    if values.shape != (height * width,):
        raise ValueError(f"DepthPlanar of {width}x{height} px must have {height * width} numbers, got {count}")
    return values.reshape(height, width)


def _shape(answer: Mapping[str, Any], what: str) -> tuple[int, int]:
    size = answer.get("height"), answer.get("width")
    if not all(isinstance(value, int) and value > 0 for value in size):
        message = answer.get("message") or "the simulator says nothing about it"
        raise ValueError(f"{what} came empty ({message}); is the camera set up for this image type?")
    return int(size[0] or 0), int(size[1] or 0)


def _image_pose(answer: Mapping[str, Any], what: str) -> RigidTransform:
    return pose_of(answer.get("camera_position"), answer.get("camera_orientation"), what)


def _check_same(scene: RigidTransform, depth: RigidTransform) -> None:
    apart = scene.inv() * depth
    metres, radians = float(np.linalg.norm(apart.translation)), float(apart.rotation.magnitude())
    if metres > SAME_M or radians > SAME_RAD:
        raise ValueError(
            f"picture and depth were taken {metres:.3g} m and {np.rad2deg(radians):.3g} deg apart: "
            f"they are not of one instant; fly slower or pause the simulator"
        )


def _time_s(answer: Mapping[str, Any]) -> float:
    stamp = answer.get("time_stamp")
    if isinstance(stamp, bool) or not isinstance(stamp, int) or stamp < 0:
        raise ValueError(f"Scene has no time stamp in ns, got {stamp!r}")
    return stamp / NS_PER_S
