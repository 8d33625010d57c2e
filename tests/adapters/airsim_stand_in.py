"""A server that answers msgpack-rpc calls with what a test puts there, on an ephemeral loopback port."""

import socket
import threading
from contextlib import suppress
from typing import Self

import msgpack
import numpy as np

WIDTH, HEIGHT = 4, 3
BGR = np.arange(WIDTH * HEIGHT * 3, dtype=np.uint8).reshape(HEIGHT, WIDTH, 3)
DEPTH = np.arange(1, 13, dtype=np.float32).reshape(HEIGHT, WIDTH)
HALF = 0.5**0.5


def vector(x, y, z):
    return {"x_val": float(x), "y_val": float(y), "z_val": float(z)}


def quaternion(w, x, y, z):
    return {"w_val": float(w), **vector(x, y, z)}


def pose(position=(1.0, 2.0, -3.0), turn=(1.0, 0.0, 0.0, 0.0)):
    return {"position": vector(*position), "orientation": quaternion(*turn)}


def response(image_type, **changes):
    """One ImageResponse as AirSim sends it: the list that is not filled holds one zero."""
    scene = image_type == 0
    at = pose()
    return {
        "image_data_uint8": BGR.tobytes() if scene else b"\0",
        "image_data_float": [0.0] if scene else DEPTH.ravel().tolist(),
        "camera_position": at["position"],
        "camera_orientation": at["orientation"],
        "time_stamp": 1_700_000_000_250_000_000,
        "message": "",
        "pixels_as_float": not scene,
        "compress": False,
        "width": WIDTH,
        "height": HEIGHT,
        "image_type": image_type,
        "annotation_name": "",
    } | changes


class StandIn:
    """Answers each method by its function of the params; a ValueError becomes the call's error. A context manager.

    `calls` holds every call as (method, params).
    """

    def __init__(self, port=0, **methods):
        self.methods = {
            "simGetCameraInfo": lambda *params: {"pose": pose(), "fov": 90.0},
            "simGetVehiclePose": lambda *params: pose(),
            "simGetImages": lambda *params: [response(0), response(1)],
        } | methods
        self.calls = []
        self._listening = socket.create_server(("127.0.0.1", port))
        self._open = []
        self.port = self._listening.getsockname()[1]
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error):
        self._listening.shutdown(socket.SHUT_RDWR)
        self._thread.join()
        self._listening.close()

    def _serve(self):
        while True:
            try:
                talk, _ = self._listening.accept()
            except OSError:
                break
            self._open.append((talk, threading.Thread(target=self._talk, args=(talk,), daemon=True)))
            self._open[-1][1].start()
        for talk, thread in self._open:
            with suppress(OSError):  # the client may have gone, and its thread may have closed it, at this moment
                talk.shutdown(socket.SHUT_RDWR)
            thread.join()

    def _talk(self, talk):
        unpacker = msgpack.Unpacker()
        with talk:
            while True:
                try:
                    data = talk.recv(65536)
                except OSError:
                    return
                if not data:
                    return
                unpacker.feed(data)
                for _, number, method, params in unpacker:
                    self.calls.append((method, params))
                    error, result = None, None
                    try:
                        result = self.methods[method](*params)
                    except ValueError as refused:
                        error = str(refused)
                    try:
                        talk.sendall(result if isinstance(result, bytes) else msgpack.packb([1, number, error, result]))
                    except OSError:
                        return
                    if isinstance(result, bytes):  # a test's own bytes, then the line goes dead
                        return
