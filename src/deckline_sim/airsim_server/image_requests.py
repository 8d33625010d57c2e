"""Pictures of the simulated world: simGetImages, and recordings."""

import asyncio
import shutil
from collections.abc import Awaitable, Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deckline.geometry import Camera
from deckline.recording import RecordingWriter
from deckline.recording.images import encode_image
from deckline.types import Frame
from deckline_sim.airsim_server.objects import segmentation
from deckline_sim.airsim_server.settings import (
    DEPTH_VIS,
    NORMALS,
    PERSPECTIVE,
    PLANAR,
    SCENE,
    SEGMENTATION,
    AirSimSettings,
)
from deckline_sim.airsim_server.structs import Struct, pose_struct
from deckline_sim.airsim_server.world import World

FAR_M = 65504.0  # where nothing is seen: the largest half-precision number, AirSim's
VIS_M = 100.0  # depth that DepthVis shows white
MAX_IMAGES, MAX_PIXELS = 64, 17_000_000  # of one call: one of 4096x4096; as floats 85 MB on the wire
RECORDING_BYTES = 20 << 30  # of one recording, which continues after its client has left
FREE_BYTES = 1 << 30  # that a recording leaves on the disk
TYPES = {
    SCENE: "Scene",
    PLANAR: "DepthPlanar",
    PERSPECTIVE: "DepthPerspective",
    DEPTH_VIS: "DepthVis",
    SEGMENTATION: "Segmentation",
    NORMALS: "SurfaceNormals",
}
FLOATS = (PLANAR, PERSPECTIVE, DEPTH_VIS)
SAME_POSE = 1e-9  # a larger change of any number of a pose is a move
_View = tuple[str, int, int, float]  # camera, width, height, focal length


@dataclass(frozen=True)
class ImageRequest:
    camera: str  # the camera's own name
    requested_name: str  # its name in the request
    image_type: int
    as_float: bool = False
    compress: bool = True
    annotation: str = ""


def read_requests(values: Any, settings: AirSimSettings) -> list[ImageRequest]:
    """The list that clients send; a ValueError names an unknown camera, type or form of picture."""
    if not isinstance(values, list) or len(values) > MAX_IMAGES:
        raise ValueError(f"image requests must be a list of at most {MAX_IMAGES}")
    return [_read_request(value, settings) for value in values]


def _read_request(value: Any, settings: AirSimSettings) -> ImageRequest:
    if not isinstance(value, Mapping):
        raise ValueError(f"an image request must be a map, got {type(value).__name__}")
    name, image_type = str(value.get("camera_name", "0")), read_image_type(value.get("image_type", SCENE))
    as_float = bool(value.get("pixels_as_float", False))
    if as_float and image_type not in FLOATS:
        raise ValueError(f"{TYPES[image_type]} has no float pixels: ask for it with pixels_as_float False")
    annotation, compress = str(value.get("annotation_name", ""))[:80], bool(value.get("compress", True))
    return ImageRequest(settings.find_camera(name), name, image_type, as_float, compress, annotation)


def read_image_type(value: Any) -> int:
    """One of the types that are drawn; all else is a ValueError."""
    if isinstance(value, bool) or not isinstance(value, int) or value not in TYPES:
        there = ", ".join(f"{name} ({number})" for number, name in TYPES.items())
        raise ValueError(f"image type {str(value)[:20]} is not supported; there are {there}")
    return value


def get_images(world: World, requests: Sequence[ImageRequest]) -> list[Struct]:
    """ImageResponses of one instant, each view drawn once; only on the world's own thread.

    A ValueError for too many pixels; else errors as `World.picture`.
    """
    state, time_s = world.snapshot()
    cameras = [world.camera(request.camera, request.image_type, state) for request in requests]
    if sum(camera.width * camera.height for camera in cameras) > MAX_PIXELS:
        raise ValueError(f"images of one call may have {MAX_PIXELS} pixels together: ask for them in several calls")
    frames: dict[_View, Frame] = {}
    depths: dict[_View, tuple[Camera, NDArray[np.float32] | None]] = {}
    views = [
        (one.camera, camera.width, camera.height, camera.fx) for one, camera in zip(requests, cameras, strict=True)
    ]
    scenes = {view for view, request in zip(views, requests, strict=True) if request.image_type == SCENE}
    responses = []
    for request, camera, view in zip(requests, cameras, views, strict=True):
        arguments = (request.camera, request.image_type, state, time_s)
        if request.image_type == SEGMENTATION:
            data = _image_data(segmentation(world, *arguments), request.compress)
        elif request.image_type == NORMALS:
            data = _image_data(world.normals(*arguments), request.compress)
        else:
            if view in scenes and view not in frames:
                frames[view] = world.picture(*arguments)
                depths[view] = (frames[view].camera, frames[view].depth_m)
            if request.image_type == SCENE:
                data = _image_data(frames[view].image_rgb, request.compress)
            else:
                if view not in depths:
                    depths[view] = world.depth(*arguments)
                data = _depth_data(*depths[view], request)
        pose = pose_struct(state.world_from_body * world.mount(request.camera, state))
        responses.append(_image_header(request, camera, pose, world.clock.nanoseconds(time_s)) | data)
    return responses


def _image_header(request: ImageRequest, camera: Camera, pose: Struct, time_ns: int) -> Struct:
    return {
        "camera_name": request.requested_name,
        "camera_position": pose["position"],
        "camera_orientation": pose["orientation"],
        "time_stamp": time_ns,
        "message": "",
        "pixels_as_float": request.as_float,
        "compress": request.compress and not request.as_float,
        "width": camera.width,
        "height": camera.height,
        "image_type": request.image_type,
        "annotation_name": request.annotation,
    }


def _depth_data(camera: Camera, depth_m: NDArray[np.float32] | None, request: ImageRequest) -> Struct:
    """Depth (H, W), NaN where nothing is seen, in the requested form."""
    if depth_m is None:
        raise ValueError(f"camera {request.camera!r} has no depth")
    stored = encode_depth(depth_m, camera, request.image_type)
    if not request.as_float:
        return _image_data(draw_depth(stored), request.compress)
    values = stored if request.image_type != DEPTH_VIS else np.minimum(stored / np.float32(VIS_M), 1.0)
    return {"image_data_uint8": b"\0", "image_data_float": values.ravel()}


def _image_data(image_rgb: NDArray[np.uint8], compress: bool) -> Struct:
    """A picture (H, W, 3) as a PNG file, or as raw bytes in the order blue, green, red."""
    data = encode_image(image_rgb, "png") if compress else image_rgb[:, :, ::-1].tobytes()
    return {"image_data_uint8": data, "image_data_float": np.zeros(1, dtype=np.float32)}


def encode_depth(depth_m: NDArray[np.float32], camera: Camera, image_type: int) -> NDArray[np.float32]:
    """Depth (H, W), m, along the axis, or along each pixel's ray for DepthPerspective; far where nothing is seen."""
    depth = depth_m * camera.ray_lengths() if image_type == PERSPECTIVE else depth_m
    return np.minimum(np.nan_to_num(depth, nan=FAR_M), np.float32(FAR_M))


def draw_depth(depth_m: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Depth (H, W) as grey (H, W, 3): black at 0, white from 100 m on."""
    grey = np.rint(255.0 * np.minimum(depth_m / np.float32(VIS_M), 1.0)).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=2)


def record_frame(world: World) -> Frame:
    """The recorded camera's present frame, its time in s since 1970; only on the world's own thread."""
    state, time_s = world.snapshot()
    frame = world.picture(world.settings.recorded, SCENE, state, time_s)
    return replace(frame, time_s=world.clock.nanoseconds(time_s) / 1e9)


class Recorder:
    """Records frames at an interval into a folder of their own. All methods belong to the event loop.

    Args:
        out: each recording becomes a folder in it, named by date and time.
        take: takes the present frame.
        scene: free keys of scene.json.
        log: gets a line when a recording begins and ends.
    """

    def __init__(
        self,
        out: Path,
        settings: AirSimSettings,
        take: Callable[[], Awaitable[Frame]],
        scene: dict[str, object],
        log: Callable[[str], None],
    ) -> None:
        self._out, self._settings, self._take, self._scene, self._log = out, settings, take, scene, log
        self._task: asyncio.Task[None] | None = None
        self._stop = asyncio.Event()

    @property
    def is_on(self) -> bool:
        return self._task is not None and not self._task.done()

    async def start(self) -> None:
        """Begin a recording, unless one is on; a ValueError for a folder that cannot be written."""
        if self.is_on:
            return
        writer = await asyncio.to_thread(self._open)
        self._stop = asyncio.Event()
        self._task = asyncio.create_task(self._record(writer))

    async def stop(self) -> None:
        """End the recording; when this returns, its files are whole."""
        self._stop.set()
        if self._task is not None:
            await self._task
            self._task = None

    def _open(self) -> RecordingWriter:
        stamp = datetime.now().strftime("%Y-%m-%d-%H-%M-%S")
        folder, number = self._out / stamp, 1
        while folder.exists():
            number += 1
            folder = self._out / f"{stamp}-{number}"
        camera = self._settings.recorded
        return RecordingWriter(folder, scene=self._scene, vehicle=self._settings.vehicle, camera_name=camera)

    async def _record(self, writer: RecordingWriter) -> None:
        loop, last = asyncio.get_running_loop(), None
        self._log(f"recording into {writer.out}")
        try:
            with writer:
                while not self._stop.is_set():
                    due = loop.time() + self._settings.interval_s
                    frame = await self._take()
                    if not self._settings.on_move or last is None or has_moved(last, frame):
                        check_disk(writer)
                        await asyncio.to_thread(writer.add, frame)
                        last = frame
                    with suppress(TimeoutError):  # the next frame is due
                        await asyncio.wait_for(self._stop.wait(), max(due - loop.time(), 0.0))
        except (ValueError, OSError) as error:
            self._log(f"recording into {writer.out} ended: {' '.join(str(error).split())}")
        else:
            self._log(f"recorded {writer.count} frames into {writer.out}")


def check_disk(writer: RecordingWriter) -> None:
    """Raise OSError where a recording is as large as it may be, or the disk nearly full."""
    if writer.written_bytes > RECORDING_BYTES:
        raise OSError(f"it has {RECORDING_BYTES >> 30} GiB: start another one")
    if shutil.disk_usage(writer.out).free < FREE_BYTES:
        raise OSError(f"less than {FREE_BYTES >> 20} MiB are free on the disk")


def has_moved(before: Frame, after: Frame) -> bool:
    if before.world_from_body is None or after.world_from_body is None:
        return True
    motion = before.world_from_body.inv() * after.world_from_body
    return bool(abs(motion.translation).max() > SAME_POSE or motion.rotation.magnitude() > SAME_POSE)
