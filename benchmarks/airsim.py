"""Requests a second that the AirSim server answers over loopback, beside a ping in the same run.

    python benchmarks/airsim.py [--repeats 10] [--width 1280 --height 720]

Runs are interleaved, so that a busy machine disturbs all alike; medians are printed. A request is timed from its first
byte sent to its last byte received; nothing is decoded, so that the server's time is what is seen.
"""

import os
import platform
import socket
import statistics
import tempfile
import time
from datetime import date
from pathlib import Path
from typing import Any

import msgpack
import tyro

from deckline.adapters.airsim.protocol import encode_request
from deckline_sim.airsim_server.rpc_server import serving_in_thread
from deckline_sim.airsim_server.settings import PLANAR, SCENE, SEGMENTATION, CaptureSetting, parse_settings
from deckline_sim.config import DepthConfig, SimConfig

PEER = "ping"
READ_BYTES = 1 << 20


def main(repeats: int = 10, width: int = 1280, height: int = 720) -> None:
    config = SimConfig(width=width, height=height, keep_clear=False, depth=DepthConfig(range_m=float("inf")))
    settings = parse_settings({}, CaptureSetting(config.width, config.height, config.fov_deg))
    seconds: dict[str, list[float]] = {name: [] for name in CALLS}
    with (
        tempfile.TemporaryDirectory() as out,
        serving_in_thread(config, settings, port=0, out=Path(out)) as port,
        socket.create_connection(("127.0.0.1", port)) as connection,
    ):
        received = {name: exchange(connection, *call) for name, call in CALLS.items()}
        for _ in range(repeats):
            for name, call in CALLS.items():
                start = time.perf_counter()
                exchange(connection, *call)
                seconds[name].append(time.perf_counter() - start)
    peer = statistics.median(seconds[PEER])
    print(f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}, {date.today()}")
    print(f"{f'request, {width}x{height}':34} {'bytes':>9} {'ms':>8} {'per s':>8} {'ratio to ' + PEER:>15}")
    for name, values in seconds.items():
        median = statistics.median(values)
        print(f"{name:34} {received[name]:9} {1e3 * median:8.2f} {1 / median:8.1f} {median / peer:15.1f}")


def picture(image_type: int, as_float: bool = False, compress: bool = False) -> dict[str, Any]:
    """One image request of the front camera."""
    return {"camera_name": "0", "image_type": image_type, "pixels_as_float": as_float, "compress": compress}


def images(*requests: dict[str, Any]) -> tuple[str, tuple[Any, ...]]:
    """A simGetImages call."""
    return "simGetImages", (list(requests), "")


CALLS: dict[str, tuple[str, tuple[Any, ...]]] = {
    PEER: ("ping", ()),
    "simGetVehiclePose": ("simGetVehiclePose", ("",)),
    "Scene, raw": images(picture(SCENE)),
    "Scene, PNG": images(picture(SCENE, compress=True)),
    "DepthPlanar, float": images(picture(PLANAR, as_float=True)),
    "Scene, raw + DepthPlanar, float": images(picture(SCENE), picture(PLANAR, as_float=True)),
    "Segmentation, raw": images(picture(SEGMENTATION)),
}


def exchange(connection: socket.socket, method: str, params: tuple[Any, ...]) -> int:
    """Ask and wait for the whole answer; returns its size in bytes.

    Raises:
        ConnectionError: the server closed the connection.
    """
    connection.sendall(encode_request(1, method, params))
    answer, size = msgpack.Unpacker(max_buffer_size=0), 0
    while data := connection.recv(READ_BYTES):
        size += len(data)
        answer.feed(data)
        try:
            answer.skip()
        except msgpack.OutOfData:
            continue
        return size
    raise ConnectionError("the server closed the connection")


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
