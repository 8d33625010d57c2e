"""What takes datagrams, telemetry, and calls and answers of AirSim, each with inputs from which `fuzz.py` starts."""

import asyncio
import socket
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from threading import Event
from types import SimpleNamespace
from typing import Any

import av
from fuzz_files import GLOBE, Reader

from deckline.adapters.airsim.protocol import Decoder, Response, encode, encode_request
from deckline.adapters.airsim.source import read_frame
from deckline.adapters.mavlink.link import Link, parse_datagram
from deckline.geometry import camera_mount
from deckline.live.clock import WallClock
from deckline.live.datagrams import rtp_payload
from deckline.live.decoding import decode_stream
from deckline.live.poses import parse_pose_line
from deckline.recording import RecordingError
from deckline_sim.airsim_server.image_requests import Recorder, get_images
from deckline_sim.airsim_server.rpc_methods import METHODS, SIGNATURES
from deckline_sim.airsim_server.rpc_server import Connections
from deckline_sim.airsim_server.sensors import SimulatedSensors
from deckline_sim.airsim_server.service import Service
from deckline_sim.airsim_server.settings import CaptureSetting, parse_settings
from deckline_sim.airsim_server.sim_clock import SimClock
from deckline_sim.airsim_server.structs import pose_struct
from deckline_sim.airsim_server.world import World
from deckline_sim.config import SimConfig

POSE = b'{"time_s": 1.0, "x_m": 0, "y_m": 0, "z_m": -3, "qw": 1, "qx": 0, "qy": 0, "qz": 0}'


def take_datagram(_folder: Path, data: bytes) -> None:
    """Datagrams of a network: of a stream, lines of poses."""
    datagrams = [(data[start : start + 1316], False) for start in range(0, len(data), 1316)]
    receiver: Any = SimpleNamespace(receive=lambda timeout_s: datagrams.pop(0) if datagrams else None)
    rtp_payload(data)
    if datagrams:
        with suppress(av.error.FFmpegError, RecordingError):
            list(decode_stream(receiver, Event()))
    for line in data.decode(errors="replace").splitlines():
        try:
            parse_pose_line(line)
        except ValueError:
            continue


class Autopilot:
    """A link that takes datagrams without a network; made when the first one arrives."""

    link: Link | None = None

    def __call__(self, _folder: Path, data: bytes) -> None:
        if self.link is None:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
                free.bind(("127.0.0.1", 0))
                port = free.getsockname()[1]
            self.link = Link(f"udp:127.0.0.1:{port}", "px4", GLOBE, WallClock(), lambda line: None, True)
        self.link._system = 1
        for message in parse_datagram(data):
            self.link._handle(message, ("127.0.0.1", 9))


def telemetry_seeds() -> list[bytes]:
    from pymavlink.dialects.v20 import common as mavlink

    mav = mavlink.MAVLink(None, 1, 1)
    messages = [
        mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3),
        mavlink.MAVLink_timesync_message(1, 2),
        mavlink.MAVLink_timesync_message(0, 2),
        mavlink.MAVLink_attitude_quaternion_message(1, 1, 0, 0, 0, 0, 0, 0),
        mavlink.MAVLink_local_position_ned_message(1, 1, 2, 3, 0, 0, 0),
        mavlink.MAVLink_gps_global_origin_message(1, 2, 3),
    ]
    packed = [message.pack(mav) for message in messages]
    return [*packed, b"".join(packed)]


class Client:
    """What a simulator answers to `deckline run airsim://...`."""

    def __call__(self, _folder: Path, data: bytes) -> None:
        answers = [answer for answer in Decoder(1 << 20).feed(data) if isinstance(answer, Response)]
        for answer in answers:
            if (
                isinstance(answer.result, list)
                and len(answer.result) == 2
                and all(isinstance(part, dict) for part in answer.result)
            ):
                read_frame("x", *answer.result, camera_mount(), 1.5)


def answer_seeds() -> list[bytes]:
    pose = pose_struct(camera_mount())
    common = {"camera_position": pose["position"], "camera_orientation": pose["orientation"], "width": 2, "height": 1}
    scene = common | {"image_data_uint8": bytes(6), "time_stamp": 5}
    return [encode([1, 7, None, [scene, common | {"image_data_float": [1.0, 2.0]}]])]


class Server:
    """The simulator's server without sockets and pictures; made when the first call comes."""

    loop: asyncio.AbstractEventLoop | None = None

    def __call__(self, folder: Path, data: bytes) -> None:
        if self.loop is None:
            self.loop = asyncio.new_event_loop()
            self.settings = parse_settings({}, CaptureSetting(8, 6, 90.0))
            clock = SimClock(lambda: 1e6 * time.monotonic())  # a call may run for 1e6 simulated seconds
            self.world = World(SimConfig(width=8, height=6), self.settings, clock)
        lines: list[str] = []
        self.loop.run_until_complete(self.converse(folder, data, lines))
        if failed := [line for line in lines if "failed: " in line]:
            raise RuntimeError(failed[0])

    async def converse(self, folder: Path, data: bytes, lines: list[str]) -> None:
        async def render(function: Callable[..., Any], *arguments: Any) -> Any:
            return [{"image_data_uint8": b""}] if function is get_images else function(*arguments)

        async def take() -> Any:
            raise ValueError("nothing is drawn")

        recorder = Recorder(folder, self.settings, take, {}, lines.append)
        self.world.reset()
        service = Service(self.world, render, recorder, SimulatedSensors(self.world, 0), lines.append)
        connections = Connections(service)
        reader = asyncio.StreamReader()
        reader.feed_data(data)
        reader.feed_eof()
        await connections._converse(reader, Peer(), "peer")  # type: ignore[arg-type]
        flights = asyncio.all_tasks() - {asyncio.current_task()}
        for task in flights:
            task.cancel()
        await asyncio.gather(*flights, return_exceptions=True)
        await recorder.stop()


class Peer:
    """A client that reads all of its answers."""

    transport = SimpleNamespace(get_write_buffer_size=lambda: 0, abort=lambda: None)

    def is_closing(self) -> bool:
        return False

    def write(self, data: bytes) -> None:
        list(Decoder(1 << 28).feed(data))

    async def drain(self) -> None:
        return None

    def close(self) -> None:
        return None


def call_seeds() -> list[bytes]:
    pose = pose_struct(camera_mount())
    values: dict[str, tuple[Any, ...]] = {
        "simSetVehiclePose": (pose, True, ""),
        "simSetCameraPose": ("0", pose, ""),
        "simSetCameraFov": ("0", 80.0),
        "simGetImages": ([{"camera_name": "0", "image_type": 1, "pixels_as_float": True}], ""),
        "simGetImage": ("0", 0),
        "simGetCameraInfo": ("0",),
        "simGetCurrentFieldOfView": ("0",),
        "simGetObjectPose": ("Carrier",),
        "simSetWeatherParameter": (7, 0.5),
        "simSetTimeOfDay": (True, "2020-02-02 10:00:00", False, 1.0, 60.0, True),
        "simContinueForTime": (0.5,),
    }
    on = [encode_request(1, name, (True,)) for name in ("enableApiControl", "armDisarm")]
    calls = {name: values.get(name, (1.0,) * (count_required(name) - 1)) for name in METHODS}
    return [b"".join((*on, encode_request(1, name, params))) for name, params in calls.items()] + on


def count_required(method: str) -> int:
    parameters = SIGNATURES[method].parameters.values()
    return sum(one.default is one.empty and one.kind is one.POSITIONAL_OR_KEYWORD for one in parameters)


MESSAGES: dict[str, Callable[[], Reader]] = {
    "datagrams": lambda: Reader(take_datagram, [POSE]),
    "mavlink": lambda: Reader(Autopilot(), telemetry_seeds()),
    "answers": lambda: Reader(Client(), answer_seeds()),
    "server": lambda: Reader(Server(), call_seeds()),
}
