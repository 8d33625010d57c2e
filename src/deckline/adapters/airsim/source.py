"""A simulator that speaks AirSim's protocol, as a live source of frames.

AirSim notes the camera's pose when it draws, and gives it with each image. The vehicle's pose has to be asked for, and
is of a later instant. So a frame's pose comes from the image alone: world_from_body = world_from_camera of the image *
camera_from_body of the mount, which hardly changes.
"""

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.adapters.airsim.client import (
    DEPTH_PLANAR,
    SCHEME,
    Connection,
    ConnectionLostError,
    StoppedError,
    get_camera,
    get_images,
    get_vehicle_pose,
    parse_address,
)
from deckline.adapters.airsim.protocol import read_pose
from deckline.files import print_line
from deckline.geometry import Camera, camera_mount
from deckline.live.source import FIRST_WAIT_S, LONGEST_WAIT_S, Captured, LiveSource, frame_name
from deckline.recording import BadFrame, RecordingError
from deckline.recording.images import check_depth_size, convert_to_axial_depth
from deckline.types import Frame

NS_PER_S = 10**9  # whole, so that division by it preserves the time stamp
SAME_POSE_M = 0.01  # poses of picture and depth: farther apart, the depth is not the picture's
SAME_POSE_RAD = 2e-4  # about as much at the 50 m at which the lines fill the picture; single precision leaves 1e-6
STILL_M = 0.01  # a vehicle that moves less during a measurement of the mount is at rest
STILL_RAD = 1e-3  # likewise turned: 0.06 deg, half of which is the error
MEASUREMENTS = 20  # of a mount, at most
SLOW = 1.25  # frames that take so many times the wanted period are slow
WINDOW = 10  # frames over which that is judged


@dataclass(frozen=True, eq=False)
class MountMeasurement:
    """Where a camera sits on its vehicle, measured once."""

    body_from_camera: RigidTransform  # optical frame
    fov_rad: float  # horizontal
    motion_m: float  # of the vehicle during the measurement
    rotation_rad: float


def measure_mount(connection: Connection, camera: str, vehicle: str) -> MountMeasurement:
    """Ask for the camera's pose between two poses of the vehicle, and take the vehicle to be half way.

    The difference of the vehicle's poses bounds the error. Errors as `get_images`.
    """
    before = get_vehicle_pose(connection, vehicle)
    world_from_mount, fov_rad = get_camera(connection, camera, vehicle)
    after = get_vehicle_pose(connection, vehicle)
    motion = before.inv() * after
    mount = interpolate_middle(before, after).inv() * world_from_mount * camera_mount()
    return MountMeasurement(mount, fov_rad, *_measure_motion(motion))


def measure_still_mount(connection: Connection, camera: str, vehicle: str) -> MountMeasurement:
    """The measurement of several during which the vehicle moved least; the first of a vehicle at rest."""
    best = measure_mount(connection, camera, vehicle)
    for _ in range(MEASUREMENTS - 1):
        if best.motion_m <= STILL_M and best.rotation_rad <= STILL_RAD:
            break
        best = min(best, measure_mount(connection, camera, vehicle), key=lambda one: one.motion_m)
    return best


def _measure_motion(motion: RigidTransform) -> tuple[float, float]:
    """Length, m, and angle, rad."""
    return float(np.linalg.norm(motion.translation)), float(motion.rotation.magnitude())


def update_mount(mount: RigidTransform, measured: MountMeasurement) -> RigidTransform:
    """body_from_camera, updated with the accurate parts of a new measurement.

    The mount follows a camera that turns on its vehicle; the motion of a fast vehicle does not change its position.
    """
    if measured.rotation_rad > STILL_RAD:
        return mount
    position = measured.body_from_camera.translation if measured.motion_m <= STILL_M else mount.translation
    return RigidTransform.from_components(position, measured.body_from_camera.rotation)


def interpolate_middle(first: RigidTransform, second: RigidTransform) -> RigidTransform:
    """The pose half way between two near poses."""
    rotation = Rotation.concatenate([first.rotation, second.rotation]).mean()
    return RigidTransform.from_components(np.add(first.translation, second.translation) / 2, rotation)


def read_frame(
    name: str,
    scene: Mapping[str, Any],
    depth: Mapping[str, Any],
    body_from_camera: RigidTransform,
    fov_rad: float,
    deck_z_m: float | None,
    sea_z_m: float | None,
) -> Frame:
    """A frame from the answers to simGetImages for the picture and the planar depth.

    Args:
        scene: the picture, raw bytes in the order B, G, R.
        depth: metres along the axis, one float a pixel, top row first.
        body_from_camera: the camera's mount, optical frame.
        deck_z_m, sea_z_m: world z (down) of the deck plane and of the water.

    Raises:
        ValueError: an answer that is empty or broken, or answers that do not belong together.
    """
    image, stored = _read_image(scene), _read_depth(depth)
    camera = Camera.from_fov(image.shape[1], image.shape[0], fov_rad)
    check_depth_size(stored.shape, camera, "DepthPlanar")
    world_from_mount = read_image_pose(scene, "Scene")
    _check_same_pose(world_from_mount, read_image_pose(depth, "DepthPlanar"))
    stamp_ns = scene.get("time_stamp")
    if isinstance(stamp_ns, bool) or not isinstance(stamp_ns, int) or stamp_ns < 0:
        raise ValueError(f"Scene has no time stamp in ns, got {stamp_ns!r}")
    return Frame(
        file=name,
        time_s=stamp_ns / NS_PER_S,
        image_rgb=image,
        camera=camera,
        body_from_camera=body_from_camera,
        depth_m=convert_to_axial_depth(stored, camera, DEPTH_PLANAR),
        world_from_body=world_from_mount * camera_mount() * body_from_camera.inv(),
        deck_z_m=deck_z_m,
        sea_z_m=sea_z_m,
    )


def _read_image(answer: Mapping[str, Any]) -> NDArray[np.uint8]:
    """Raw picture B, G, R -> RGB uint8 (H, W, 3)."""
    height, width = _read_size(answer, "Scene")
    data = answer.get("image_data_uint8")
    if not isinstance(data, bytes) or len(data) != height * width * 3:
        found = f"{len(data)} bytes" if isinstance(data, bytes) else type(data).__name__
        raise ValueError(f"Scene of {width}x{height} px must have {height * width * 3} bytes (B, G, R), got {found}")
    bgr = np.frombuffer(data, np.uint8).reshape(height, width, 3)
    return np.ascontiguousarray(bgr[:, :, ::-1])


def _read_depth(answer: Mapping[str, Any]) -> NDArray[np.float32]:
    """Float depth -> float32 (H, W), as sent."""
    height, width = _read_size(answer, "DepthPlanar")
    data = answer.get("image_data_float")
    count = len(data) if isinstance(data, list) else 0
    if count <= 1 < height * width:
        raise ValueError(f"DepthPlanar of {width}x{height} px came without numbers: its grey levels are no metres")
    try:
        with np.errstate(over="ignore"):
            values = np.array(data, dtype=np.float32)
    except (TypeError, ValueError):
        raise ValueError("DepthPlanar holds a value that is no number") from None
    if values.shape != (height * width,):
        raise ValueError(f"DepthPlanar of {width}x{height} px must have {height * width} numbers, got {count}")
    return values.reshape(height, width)


def read_image_pose(answer: Mapping[str, Any], name: str) -> RigidTransform:
    """world_from_mount of the camera when it drew an image, or a ValueError."""
    parts = {"position": answer.get("camera_position"), "orientation": answer.get("camera_orientation")}
    return read_pose(parts, name)


def _read_size(answer: Mapping[str, Any], name: str) -> tuple[int, int]:
    size = answer.get("height"), answer.get("width")
    if not all(isinstance(value, int) and value > 0 for value in size):
        message = answer.get("message") or "no reason given"
        raise ValueError(f"{name} came empty ({message}); is the camera set up for this image type?")
    return int(size[0] or 0), int(size[1] or 0)


def _check_same_pose(scene: RigidTransform, depth: RigidTransform) -> None:
    metres, radians = _measure_motion(scene.inv() * depth)
    if metres > SAME_POSE_M or radians > SAME_POSE_RAD:
        raise ValueError(
            f"picture and depth were taken {metres:.3g} m and {np.rad2deg(radians):.3g} deg apart: "
            f"they are not of one instant; fly slower or pause the simulator"
        )


class AirSimSource(LiveSource):
    """Frames of a simulator's camera until `stop`. After a lost connection it waits for the simulator.

    Args:
        address: airsim://HOST:PORT[/VEHICLE].
        camera: AirSim's name of it.
        rate_hz: frames a second, at most.
        deck_z_m, sea_z_m: world z (down) of the deck plane and of the water.
        log: gets a line when the simulator is lost, found again, or too slow.

    Raises:
        RecordingError: a wrong rate, nobody answers, or there is no such camera.
        ValueError: a wrong address.
    """

    def __init__(
        self,
        address: str,
        camera: str = "0",
        rate_hz: float = 5.0,
        deck_z_m: float | None = None,
        sea_z_m: float | None = None,
        log: Callable[[str], None] = print_line,
    ) -> None:
        if not 0.0 < rate_hz <= 1000.0:
            raise RecordingError(f"rate must lie between 0 and 1000 frames a second, got {rate_hz}")
        self._host, self._port, self._vehicle = parse_address(address)
        vehicle = f"/{self._vehicle}" if self._vehicle else ""
        super().__init__(f"{SCHEME}://{self._host}:{self._port}{vehicle} camera {camera}")
        self._camera, self._rate_hz, self._heights = camera, rate_hz, (deck_z_m, sea_z_m)
        self._log = log
        self._connection: Connection | None = None
        try:
            first = self._connect()
        except ConnectionLostError as error:
            raise RecordingError(f"{error}; start the simulator, or deckline sim --serve, and try again") from None
        except ValueError as error:
            raise RecordingError(f"{self.name}: {error}") from None
        self._hang_up()  # the frames may be asked for much later
        self._mount = first.body_from_camera
        if first.motion_m > STILL_M:
            self.notes = (
                f"the vehicle was moving: where the camera sits on it is known within {first.motion_m:.2g} m",
            )

    def captures(self) -> Iterator[Captured | BadFrame]:
        """Its frames, numbered as those of any live source; one counts as taken when it is there."""
        for number, item in enumerate(self.items(), 1):
            if isinstance(item, BadFrame):
                yield item
            else:
                yield Captured(replace(item, file=frame_name(number)), time.monotonic())

    def items(self) -> Iterator[Frame | BadFrame]:
        pace = Pace(self._rate_hz)
        try:
            while not self.wait_for_stop(pace.next_wait(time.monotonic())):
                start_s = time.monotonic()
                try:
                    item = self._take_frame()
                except ConnectionLostError as error:
                    self._connect_again(error)
                    pace = Pace(self._rate_hz)
                    continue
                if slow := pace.count_frame(start_s, time.monotonic()):
                    self._log(slow)
                yield item
        except StoppedError:
            return
        finally:
            self._hang_up()

    def _take_frame(self) -> Frame | BadFrame:
        """One frame. Raises ConnectionLostError or StoppedError."""
        if self._connection is None:
            self._connection = Connection(self._host, self._port, self.stopped)
        name = self._camera
        try:
            scene, depth = get_images(self._connection, self._camera, self._vehicle)
            name = f"{self._camera}#{scene.get('time_stamp')}"
            measured = measure_mount(self._connection, self._camera, self._vehicle)
            self._mount = update_mount(self._mount, measured)
            return read_frame(name, scene, depth, self._mount, measured.fov_rad, *self._heights)
        except ValueError as error:
            return BadFrame(name, str(error))

    def _connect(self) -> MountMeasurement:
        """Connect and measure the camera's mount. Raises ConnectionLostError, StoppedError or ValueError."""
        self._connection = Connection(self._host, self._port, self.stopped)
        try:
            return measure_still_mount(self._connection, self._camera, self._vehicle)
        except (ConnectionLostError, ValueError):
            self._hang_up()
            raise

    def _connect_again(self, error: ConnectionLostError) -> None:
        """Wait until the simulator is back and has the camera. Raises StoppedError."""
        self._hang_up()
        self._log(f"lost the simulator ({error}); waiting for it")
        wait_s = FIRST_WAIT_S
        while self._connection is None:
            if self.wait_for_stop(wait_s):
                raise StoppedError
            wait_s = min(2 * wait_s, LONGEST_WAIT_S)
            with suppress(ConnectionLostError, ValueError):  # not there yet, or there and still loading
                self._mount = self._connect().body_from_camera
        self._log("the simulator is back")
        self.restarts += 1

    def _hang_up(self) -> None:
        if self._connection is not None:
            self._connection.close()
            self._connection = None


class Pace:
    """When the next frame is due, and whether they come as often as wanted. Times are of a monotonic clock.

    Args:
        rate_hz: frames a second that are wanted.
    """

    def __init__(self, rate_hz: float) -> None:
        self.period_s = 1.0 / rate_hz
        self._due_s: float | None = None
        self._start_s = 0.0  # when the first frame of this window was there
        self._busy_s = 0.0  # of this window, spent on the simulator
        self._frames = 0  # of this window
        self._is_slow = False

    def next_wait(self, now_s: float) -> float:
        """Seconds to wait for the next frame; a missed frame is not made up for."""
        if self._due_s is None:
            self._due_s = now_s
        wait_s = max(self._due_s - now_s, 0.0)
        self._due_s = max(self._due_s, now_s) + self.period_s
        return wait_s

    def count_frame(self, start_s: float, end_s: float) -> str:
        """Count a frame; returns a line for people when frames have become too slow, else an empty text."""
        if self._frames == 0:
            self._start_s, self._busy_s = end_s, 0.0
        else:
            self._busy_s += end_s - start_s
        self._frames += 1
        if self._frames <= WINDOW:
            return ""
        each_s, busy_s = (end_s - self._start_s) / WINDOW, self._busy_s / WINDOW
        self._frames = 0
        was_slow, self._is_slow = self._is_slow, each_s > SLOW * self.period_s
        if was_slow or not self._is_slow:
            return ""
        return (
            f"frames come at {1 / each_s:.2g} a second, more slowly than the {1 / self.period_s:g} asked for: "
            f"the simulator takes {busy_s:.2g} s for one, the rest {each_s - busy_s:.2g} s"
        )
