"""A server that answers msgpack-rpc calls with what a test puts there, on an ephemeral loopback port."""

import socket
import socketserver
import threading
from contextlib import suppress

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


class StandIn(socketserver.ThreadingTCPServer):
    """Answers each method by its function of the params; a ValueError becomes the call's error. A context manager.

    `calls` holds every call as (method, params). A function that returns bytes sends them and hangs up.
    """

    allow_reuse_address = True

    def __init__(self, port=0, **methods):
        super().__init__(("127.0.0.1", port), Conversation)
        self.methods = {
            "simGetCameraInfo": lambda *params: {"pose": pose(), "fov": 90.0},
            "simGetVehiclePose": lambda *params: pose(),
            "simGetImages": lambda *params: [response(0), response(1)],
        } | methods
        self.calls = []
        self.sockets = []
        self.port = self.server_address[1]
        threading.Thread(target=self.serve_forever, args=(0.01,), daemon=True).start()

    def __exit__(self, *_error):
        self.shutdown()
        for talk in self.sockets:
            with suppress(OSError):  # the client may have gone, and its thread may have closed it, at this moment
                talk.shutdown(socket.SHUT_RDWR)
        self.server_close()


class Conversation(socketserver.BaseRequestHandler):
    def handle(self):
        self.server.sockets.append(self.request)
        unpacker = msgpack.Unpacker()
        with suppress(OSError):
            while data := self.request.recv(65536):
                unpacker.feed(data)
                for _, number, method, params in unpacker:
                    self.server.calls.append((method, params))
                    error, result = None, None
                    try:
                        result = self.server.methods[method](*params)
                    except ValueError as refused:
                        error = str(refused)
                    if isinstance(result, bytes):
                        self.request.sendall(result)
                        return
                    self.request.sendall(msgpack.packb([1, number, error, result]))
