"""simGetImages: what is asked for, and what is answered."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from deckline.adapters.airsim.settings import DEPTH_VIS, PERSPECTIVE, PLANAR, SCENE, SEGMENTATION, Settings
from deckline.adapters.airsim.structs import Struct, pose_struct
from deckline.adapters.airsim.world import World
from deckline.geometry import Camera
from deckline.recording.images import encode_image
from deckline.types import Frame

FAR_M = 65504.0  # where nothing is seen: the largest half-precision number, AirSim's
VIS_M = 100.0  # depth that DepthVis shows white
MOST_IMAGES, MOST_PIXELS = 64, 64_000_000  # of one call; as floats, so many pixels are 320 MB on the wire
TYPES = {SCENE: "Scene", PLANAR: "DepthPlanar", PERSPECTIVE: "DepthPerspective", DEPTH_VIS: "DepthVis"} | {
    SEGMENTATION: "Segmentation"
}
FLOATS = (PLANAR, PERSPECTIVE, DEPTH_VIS)
_View = tuple[str, int, int, float]  # camera, width, height, focal length


@dataclass(frozen=True)
class ImageRequest:
    """One picture that is asked for; `camera` is the camera's own name."""

    camera: str
    asked: str  # the name as it was asked for
    image_type: int
    as_float: bool = False
    compress: bool = True
    annotation: str = ""


def read_requests(values: Any, settings: Settings) -> list[ImageRequest]:
    """The list that clients send.

    Raises:
        ValueError: no such list, an unknown camera, or a type or form of picture that there is not.
    """
    if not isinstance(values, list) or len(values) > MOST_IMAGES:
        raise ValueError(f"image requests must be a list of at most {MOST_IMAGES}")
    return [read_request(value, settings) for value in values]


def read_request(value: Any, settings: Settings) -> ImageRequest:
    """One of them.

    Raises:
        ValueError: see `read_requests`.
    """
    if not isinstance(value, Mapping):
        raise ValueError(f"an image request must be a map, got {type(value).__name__}")
    asked, image_type = str(value.get("camera_name", "0")), value.get("image_type", SCENE)
    if isinstance(image_type, bool) or not isinstance(image_type, int) or image_type not in TYPES:
        there = ", ".join(f"{name} ({number})" for number, name in TYPES.items())
        raise ValueError(f"no image type {str(image_type)[:20]}; there are {there}")
    as_float = bool(value.get("pixels_as_float", False))
    if as_float and image_type not in FLOATS:
        raise ValueError(f"{TYPES[image_type]} has no float pixels: ask for it with pixels_as_float False")
    annotation = str(value.get("annotation_name", ""))[:80]
    compress = bool(value.get("compress", True))
    return ImageRequest(settings.camera(asked), asked, image_type, as_float, compress, annotation)


def take_images(world: World, requests: Sequence[ImageRequest]) -> list[Struct]:
    """ImageResponses, all of one instant; only on the world's own thread.

    Raises:
        ValueError: a camera that is not above the sea, or too many pixels.
    """
    state, time_s = world.state, world.clock.seconds()
    cameras = [world.camera(request.camera, request.image_type, state) for request in requests]
    if sum(camera.width * camera.height for camera in cameras) > MOST_PIXELS:
        raise ValueError(f"images of one call may have {MOST_PIXELS} pixels together: ask for them in several calls")
    frames: dict[_View, Frame] = {}
    depths: dict[_View, NDArray[np.float32]] = {}
    whole = (SCENE, *FLOATS) if world.bends else (SCENE,)
    asked = zip(requests, cameras, strict=True)
    pictured = {_view(request, camera) for request, camera in asked if request.image_type in whole}
    responses = []
    for request, camera in zip(requests, cameras, strict=True):
        view = _view(request, camera)
        if request.image_type == SEGMENTATION:
            data = picture_data(world.segmentation(request.camera, state, time_s), request.compress)
        elif view in pictured:
            if view not in frames:
                frames[view] = world.picture(request.camera, request.image_type, state, time_s)
            data = _frame_data(frames[view], request)
        else:
            if view not in depths:
                depths[view] = world.depth(request.camera, request.image_type, state, time_s)
            data = depth_data(depths[view], camera, request)
        where = state.world_from_body * world.mount(request.camera, state)
        responses.append(_described(request, camera, where, world.clock.nanoseconds(time_s)) | data)
    return responses


def _described(request: ImageRequest, camera: Camera, world_from_mount: RigidTransform, time_ns: int) -> Struct:
    """Everything of a response but its pixels."""
    placed = pose_struct(world_from_mount)
    return {
        "camera_name": request.asked,
        "camera_position": placed["position"],
        "camera_orientation": placed["orientation"],
        "time_stamp": time_ns,
        "message": "",
        "pixels_as_float": request.as_float,
        "compress": request.compress and not request.as_float,
        "width": camera.width,
        "height": camera.height,
        "image_type": request.image_type,
        "annotation_name": request.annotation,
    }


def _view(request: ImageRequest, camera: Camera) -> _View:
    """Requests with the same one are answered from one picture."""
    return request.camera, camera.width, camera.height, camera.fx


def _frame_data(frame: Frame, request: ImageRequest) -> Struct:
    if request.image_type == SCENE:
        return picture_data(frame.image_rgb, request.compress)
    if frame.depth_m is None:
        raise ValueError(f"{frame.file}: no depth")
    return depth_data(frame.depth_m, frame.camera, request)


def depth_data(depth_m: NDArray[np.float32], camera: Camera, request: ImageRequest) -> Struct:
    """Depth (H, W), NaN where nothing is seen, in the form that was asked for."""
    stored = stored_depth(depth_m, camera, request.image_type)
    if not request.as_float:
        return picture_data(shown_depth(stored), request.compress)
    values = stored if request.image_type != DEPTH_VIS else np.minimum(stored / np.float32(VIS_M), 1.0)
    return {"image_data_uint8": b"\0", "image_data_float": values.ravel()}


def picture_data(image_rgb: NDArray[np.uint8], compress: bool) -> Struct:
    """A picture (H, W, 3) as a PNG file, or as raw bytes in the order blue, green, red."""
    data = encode_image(image_rgb, "png") if compress else image_rgb[:, :, ::-1].tobytes()
    return {"image_data_uint8": data, "image_data_float": np.zeros(1, dtype=np.float32)}


def stored_depth(depth_m: NDArray[np.float32], camera: Camera, image_type: int) -> NDArray[np.float32]:
    """Depth (H, W), m, along the axis, or along each pixel's ray for DepthPerspective; far where nothing is seen."""
    depth = depth_m * camera.ray_lengths() if image_type == PERSPECTIVE else depth_m
    return np.minimum(np.nan_to_num(depth, nan=FAR_M), np.float32(FAR_M))


def shown_depth(depth_m: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Depth (H, W) as grey (H, W, 3): black at 0, white from 100 m on."""
    grey = np.rint(255.0 * np.minimum(depth_m / np.float32(VIS_M), 1.0)).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=2)


def recorded_frame(world: World) -> Frame:
    """The picture, depth and pose of the recorded camera now, its time in s since 1970; only on the world's own thread.

    Raises:
        ValueError: a camera that is not above the sea.
    """
    time_s = world.clock.seconds()
    frame = world.picture(world.settings.recorded, SCENE, world.state, time_s)
    return replace(frame, time_s=world.clock.nanoseconds(time_s) / 1e9)
