"""A runway seen by an aircraft that hovers, streamed over the loopback; a detector that needs no network."""

import json
import socket
import threading
import time
from dataclasses import replace
from fractions import Fraction

import av
import numpy as np

from approach_scene import CAMERA, LEFT, RIGHT, STILL, frame, points
from deckline.config import Models
from deckline.flight import Flight
from deckline.recording.camera_file import MountedCamera
from deckline.types import Detection, Frame, LinePoints

SHOWN = frame(0, 120.0)
MOUNTED = MountedCamera(CAMERA, SHOWN.body_from_camera, deck_z_m=-20.0)
CONFIG = replace(STILL, models=Models(dehazer="none", detector="ufld"))
RATE_HZ = 30


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def detect(image_rgb: np.ndarray, box=None) -> Detection:
    """The lines of the hovering aircraft's picture, moved a little to the right by brighter pictures."""
    shift = np.array([0.02 * (float(image_rgb.mean()) - 120.0), 0.0])
    sides = [points(SHOWN, line) for line in (LEFT, RIGHT)]
    return Detection(*(LinePoints(side.points_px + shift, side.confidence, side.sigma_px) for side in sides))


def flight() -> Flight:
    return Flight.from_config(CONFIG, detector=detect)


def picture(index: int, size: tuple[int, int] = (CAMERA.width, CAMERA.height)) -> np.ndarray:
    return np.full((size[1], size[0], 3), 100 + index % 40, np.uint8)


class Wire:
    """What a muxer writes goes out in datagrams of whole packets; every `damage`-th of them is lost."""

    def __init__(self, link: socket.socket, address: tuple[str, int], damage: int) -> None:
        self._link, self._address, self._damage = link, address, damage
        self._rest, self._count = bytearray(), 0

    def write(self, data: bytes) -> int:
        self._rest.extend(data)
        while len(self._rest) >= 188:
            size = min(len(self._rest) // 188, 7) * 188
            self._count += 1
            if not self._damage or self._count % self._damage:
                self._link.sendto(self._rest[:size], self._address)
            del self._rest[:size]
        return len(data)


class Sender:
    """Streams pictures as MPEG-TS over UDP in a thread, a context manager; leaving it cuts the wire."""

    def __init__(self, port: int, size: tuple[int, int] = (CAMERA.width, CAMERA.height), damage: int = 0) -> None:
        self._size, self._damage = size, damage
        self._address = ("127.0.0.1", port)
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._send, daemon=True)

    def __enter__(self) -> "Sender":
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._stopped.set()
        self._thread.join()

    def _send(self) -> None:
        with (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link,
            av.open(Wire(link, self._address, self._damage), "w", format="mpegts") as container,
        ):
            options = {"preset": "ultrafast", "tune": "zerolatency"}
            stream = container.add_stream("libx264", rate=RATE_HZ, options=options)
            stream.width, stream.height = self._size
            stream.pix_fmt, stream.gop_size = "yuv420p", 10
            index, start_s = 0, time.monotonic()
            while not self._stopped.wait(max(start_s + index / RATE_HZ - time.monotonic(), 0.0)):
                shown = av.VideoFrame.from_ndarray(picture(index, self._size), format="rgb24")
                shown.pts, shown.time_base, index = index, Fraction(1, RATE_HZ), index + 1
                container.mux(stream.encode(shown))


class PoseSender(Sender):
    """Sends the hovering aircraft's pose as JSON lines, by this machine's Unix time."""

    def _send(self) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
            while not self._stopped.wait(0.02):
                link.sendto(pose_line(time.time()).encode(), self._address)


def pose_line(time_s: float, at: Frame = SHOWN) -> str:
    x, y, z = at.world_from_body.translation
    w, i, j, k = at.world_from_body.rotation.as_quat(scalar_first=True)
    values = {"time_s": time_s, "x_m": x, "y_m": y, "z_m": z, "qw": w, "qx": i, "qy": j, "qz": k}
    return json.dumps(values) + "\n"


def wait_until(condition, timeout_s: float = 20.0) -> None:
    end_s = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > end_s:
            raise TimeoutError("it did not happen")
        time.sleep(0.01)
