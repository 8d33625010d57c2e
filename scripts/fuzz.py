"""Coverage-guided fuzzing of what reads files, messages and the calls of AirSim's clients, one reader at a time.

    .venv-dev/bin/pip install atheris==3.0.0
    .venv-dev/bin/python scripts/fuzz.py [READER ...] [--minutes 60] [--corpus fuzz-corpus] [--again FILE]

A reader may refuse with a ValueError or OSError. A finding is any other exception, a warning, 10 s or 2 GB for one
input: the fuzzer stops and leaves the input in the corpus as crash-*, timeout-* or oom-*; --again tries such a file.
Source: atheris, libFuzzer for Python, https://github.com/google/atheris
"""

import argparse
import asyncio
import logging
import os
import shutil
import socket
import sys
import tempfile
import time
import warnings
import zipfile
from collections.abc import Callable
from contextlib import nullcontext, redirect_stderr, suppress
from io import StringIO
from pathlib import Path
from threading import Event
from types import SimpleNamespace
from typing import Any, NamedTuple

import av
import cv2
import numpy as np

try:
    import atheris
except ImportError:  # --help and --again do without
    atheris = None

ROOT = Path(__file__).parent.parent
sys.path += [str(ROOT / folder) for folder in ("src", "tests/recording", "tests/runtime")]
INSTRUMENTED = ["deckline", "deckline_sim", "deckline_lab", "tomllib", "yaml", "PIL"]
INSTRUMENTED += ["pyulog", "pymavlink.DFReader", "pymavlink.mavutil"]
with nullcontext() if atheris is None else atheris.instrument_imports(include=INSTRUMENTED):
    from log_bytes import dataflash, telemetry, ulog

    from deckline.adapters.airsim.protocol import Decoder, Response, encode, encode_request
    from deckline.adapters.airsim.source import read_frame
    from deckline.adapters.mavlink.link import Link, parse_datagram
    from deckline.config import Navigation, RunConfig
    from deckline.config_file import read_config, to_toml_text
    from deckline.geometry import camera_mount
    from deckline.live.clock import WallClock
    from deckline.live.datagrams import rtp_payload
    from deckline.live.decoding import decode_stream
    from deckline.live.poses import parse_pose_line
    from deckline.recording import RecordingError, open_recording
    from deckline.report.records import lookup, read_records
    from deckline.report.run_folder import resume_folder
    from deckline_lab.evaluation.store import Store
    from deckline_lab.labels.exchange import import_labels
    from deckline_lab.labels.lines import read_labels
    from deckline_sim.airsim_server.image_requests import Recorder, get_images
    from deckline_sim.airsim_server.rpc_methods import METHODS, SIGNATURES
    from deckline_sim.airsim_server.rpc_server import Connections
    from deckline_sim.airsim_server.sensors import SimulatedSensors
    from deckline_sim.airsim_server.service import Service
    from deckline_sim.airsim_server.settings import CaptureSetting, parse_settings, read_settings
    from deckline_sim.airsim_server.sim_clock import SimClock
    from deckline_sim.airsim_server.structs import pose_struct
    from deckline_sim.airsim_server.world import World
    from deckline_sim.config import SimConfig

WORDS = (
    *("inf", "nan", "1e999", "1e308", "-1", "0", "4294967296", "9223372036854775807", "null", "true", "NaN"),
    "[]",
    "{}",
)
LIMITS = ("-timeout=10", "-rss_limit_mb=2048", "-max_len=16384", "-len_control=0")
IMAGE = np.random.default_rng(0).integers(0, 255, (6, 8, 3), np.uint8)
PICTURE = cv2.imencode(".png", IMAGE)[1].tobytes()
SAMPLE = zipfile.ZipFile(ROOT / "src/deckline/sample/approach.zip")
ROWS = b"\n".join(SAMPLE.read("airsim_rec.txt").splitlines()[:3])
SHOWN = {"images/" + line.split()[-1].decode(): PICTURE for line in ROWS.splitlines()[1:]}
SCENE = b"\n".join(SAMPLE.read("scene.json").splitlines()[:36]).rstrip(b",") + b"}}"
SCENE = SCENE.replace(b"1280", b"8").replace(b"720", b"6")
CAMERA = b"width=8\nheight=6\nfx=5.0\nfy=5.0\ncx=3.5\ncy=2.5\n[body_from_camera]\ntranslation_m=[0.0,0.0,0.0]\n"
YAML = (
    b"image_width: 8\nimage_height: 6\ncamera_matrix: !!opencv-matrix\n  data: [5., 0., 4., 0., 5., 3., 0., 0., 1.]\n"
    b"distortion_model: plumb_bob\ndistortion_coefficients: {data: [0.1, 1e-5, 0, 0, 0]}\n"
)
POSES = b"file,time_s,x_m,y_m,z_m,qw,qx,qy,qz\na.png,0,0,0,-30,1,0,0,0\nb.png,1,1,0,-30,1,0,0,0\n"
POSE = b'{"time_s": 1.0, "x_m": 0, "y_m": 0, "z_m": -3, "qw": 1, "qx": 0, "qy": 0, "qz": 0}'
TURNS = [(t, 1.0, 2.0, 3.0) for t in (1.0, 1.2, 1.4)]
PLACES = [(t, 46.0, 7.0, 100.0) for t in (1.0, 1.2, 1.4)]
GLOBE = Navigation(offset_s=0.0)
COCO = (
    b'{"images": [{"id": 1, "file_name": "a.png", "width": 8, "height": 6}], "annotations": [{"image_id": 1, '
    b'"category_id": 1, "keypoints": [1, 1, 2, 2, 5, 2, 4, 1, 2, 5, 5, 2]}], "categories": [{"id": 1, "keypoints": '
    b'["left_1", "left_2", "right_1", "right_2"]}]}'
)
LABELME = b'{"imagePath": "a.png", "shapes": [{"label": "left", "shape_type": "line", "points": [[1, 2], [3, 4]]}]}'
RECORD = b'{"file": "a.png", "status": "ok", "flags": [{"name": "x"}], "guidance": {"lateral_m": {"value": 1.0}}}\n'
SETTINGS = (
    b'{"CameraDefaults": {"CaptureSettings": [{"ImageType": 0, "Width": 8, "Height": 6, "FOV_Degrees": 90}]}, '
    b'"Vehicles": {"D": {"Cameras": {"0": {"X": 1, "Yaw": 90}}}}, "Recording": {"RecordInterval": 0.1}}'
)


class Reader(NamedTuple):
    """What takes the bytes, in a folder of its own, and whole inputs from which the fuzzer starts."""

    use: Callable[[Path, bytes], object]
    seeds: list[bytes]


def in_file(name: str, read: Callable[[Path], object], **beside: bytes) -> Callable[[Path, bytes], object]:
    """Read the bytes from a file, others beside it."""

    def use(folder: Path, data: bytes) -> None:
        for path, content in {**beside, name: data}.items():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).write_bytes(content)
        read(folder / name)

    return use


def read_source(path: Path, **options: Any) -> None:
    """Opening may refuse the source; a frame can only be bad."""
    source = open_recording(path, **options)
    try:
        source.times()
        list(source.items())
    except (ValueError, OSError) as error:
        raise RuntimeError("a frame ends the whole source") from error


def read_folder(path: Path) -> None:
    read_source(path.parent)


def read_log(path: Path) -> None:
    read_source(path.with_name("a.png"), poses_file=path, navigation=GLOBE)


def log_seed(name: str, write: Callable[..., Path], turns: list[tuple[float, ...]]) -> list[bytes]:
    with tempfile.TemporaryDirectory() as folder:
        return [write(Path(folder) / name, turns, PLACES).read_bytes()]


def resume(path: Path) -> None:
    for record in read_records(resume_folder(path.parent, {"source": "x"}).jsonl):
        lookup(record, ("flags", 0, "name"))


def import_from(form: Any) -> Callable[[Path], object]:
    def read(path: Path) -> None:
        import_labels(path.parent, form, path.parent / "out")

    return read


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


def film_seed(form: str, codec: str) -> bytes:
    with tempfile.NamedTemporaryFile(suffix=f".{form}") as file:
        with av.open(file.name, "w") as container:
            stream = container.add_stream(codec, rate=10)
            stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
            for _ in range(3):
                picture = av.VideoFrame.from_ndarray(np.full((48, 64, 3), 90, np.uint8), format="rgb24")
                container.mux(stream.encode(picture))
            container.mux(stream.encode())
        return Path(file.name).read_bytes()


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


FILES = {"a.png": PICTURE, "b.png": PICTURE}
TIMED = FILES | {"times.csv": b"file,time_s\na.png,1.0\nb.png,1.2\n"}
RADIANS = [(t, 1.0, 0.0, 0.0, 0.0) for t in (1.0, 1.2, 1.4)]
ALL: dict[str, Callable[[], Reader]] = {
    "airsim": lambda: Reader(in_file("airsim_rec.txt", read_folder, **SHOWN), [ROWS]),
    "scene": lambda: Reader(in_file("scene.json", read_folder, **SHOWN, **{"airsim_rec.txt": ROWS}), [SCENE]),
    "camera": lambda: Reader(in_file("camera.toml", read_folder, **FILES), [CAMERA, b"deck_z_m=1.0\n" + CAMERA]),
    "calibration": lambda: Reader(in_file("camera.yaml", read_folder, **FILES), [YAML]),
    "poses": lambda: Reader(
        in_file("poses.csv", read_folder, **TIMED, **{"camera.toml": CAMERA}),
        [
            POSES,
            POSES.replace(b"file,", b"").replace(b"a.png,", b"").replace(b"b.png,", b""),
            b"time_s,lat_deg,lon_deg,alt_m,qw,qx,qy,qz\n1,1,2,3,1,0,0,0\n1.2,1,2,3,1,0,0,0\n",
        ],
    ),
    "times": lambda: Reader(
        in_file("times.csv", read_folder, **FILES, **{"poses.csv": POSES.replace(b"file", b"frame")}),
        [TIMED["times.csv"]],
    ),
    "bin": lambda: Reader(in_file("x.bin", read_log, **TIMED), log_seed("x.bin", dataflash, TURNS)),
    "tlog": lambda: Reader(in_file("x.tlog", read_log, **TIMED), log_seed("x.tlog", telemetry, TURNS)),
    "ulg": lambda: Reader(in_file("x.ulg", read_log, **TIMED), log_seed("x.ulg", ulog, RADIANS)),
    "image": lambda: Reader(in_file("a.png", read_source), image_seeds()),
    "depth": lambda: Reader(
        in_file(
            "depth/a.pfm", lambda path: read_source(path.parent.parent / "a.png"), **FILES, **{"camera.toml": CAMERA}
        ),
        [b"Pf\n8 6\n-1\n" + bytes(192), b"Pf 8 6 1.0\n" + 48 * b"\x41\x20\0\0"],
    ),
    "video": lambda: Reader(
        in_file("a.mp4", read_source),
        [film_seed("mp4", "libx264"), film_seed("avi", "mpeg4"), film_seed("ts", "mpeg2video")],
    ),
    "labels": lambda: Reader(
        in_file("labels.json", read_labels), [b'{"frames": [{"file": "a.png", "left_px": [[1, 2], [3, 4]]}]}']
    ),
    "tusimple": lambda: Reader(
        in_file("label_data.json", import_from("tusimple"), **FILES),
        [b'{"raw_file": "a.png", "h_samples": [1, 2, 3], "lanes": [[1, 2, -2], [4, 5, 6]]}\n'],
    ),
    "coco": lambda: Reader(in_file("annotations.json", import_from("coco"), **FILES), [COCO]),
    "culane": lambda: Reader(in_file("a.lines.txt", import_from("culane"), **FILES), [b"1 2 3 4\n5 4 6 2\n"]),
    "yolo-pose": lambda: Reader(
        in_file("a.txt", import_from("yolo-pose"), **FILES), [b"0 .5 .5 1 1 .1 .2 2 .3 .4 2 .5 .4 2 .6 .2 2"]
    ),
    "labelme": lambda: Reader(in_file("a.json", import_from("labelme"), **FILES), [LABELME]),
    "config": lambda: Reader(
        in_file("x.toml", lambda path: to_toml_text(read_config(RunConfig, path))), [to_toml_text(RunConfig()).encode()]
    ),
    "sim": lambda: Reader(
        in_file("x.toml", lambda path: read_config(SimConfig, path)), [to_toml_text(SimConfig()).encode()]
    ),
    "settings": lambda: Reader(
        in_file("s.json", lambda path: read_settings(path, CaptureSetting(8, 6, 90.0))), [SETTINGS]
    ),
    "resume": lambda: Reader(
        in_file("guidance.jsonl", resume, **{".unfinished/run.json": b'{"source": "x"}'}), [2 * RECORD]
    ),
    "state": lambda: Reader(
        in_file(".unfinished/run.json", lambda path: resume(path.parent), **{"guidance.jsonl": RECORD}),
        [b'{"source": "x"}'],
    ),
    "rows": lambda: Reader(
        in_file("x.jsonl", lambda path: Store(path.parent, path.name, {"a": {"b": 1}}, "a")),
        [b'{"settings": {"a": {"b": 1}}}\n{"key": [1, "b"], "row": 3}\n'],
    ),
    "datagrams": lambda: Reader(take_datagram, [POSE]),
    "mavlink": lambda: Reader(Autopilot(), telemetry_seeds()),
    "answers": lambda: Reader(Client(), answer_seeds()),
    "server": lambda: Reader(Server(), call_seeds()),
}


def image_seeds() -> list[bytes]:
    seeds = [cv2.imencode(suffix, IMAGE)[1].tobytes() for suffix in (".png", ".jpg", ".bmp", ".ppm", ".tif", ".webp")]
    return [*seeds, cv2.imencode(".png", IMAGE.astype(np.uint16) * 255)[1].tobytes()]


def fuzz(name: str, corpus: Path, seconds: float, again: Path | None) -> None:
    """Fuzz one reader; ends the process."""
    reader, corpus = ALL[name](), corpus / name
    corpus.mkdir(parents=True, exist_ok=True)
    for number, seed in enumerate(reader.seeds):
        (corpus / f"seed-{number}").write_bytes(seed)
    words = corpus.with_suffix(".words")
    words.write_text("".join(f'"{word}"\n' for word in WORDS))
    logging.disable()
    work = Path(tempfile.mkdtemp(dir="/dev/shm"))

    def attempt(data: bytes) -> None:
        folder = work / "x"
        with warnings.catch_warnings(), redirect_stderr(StringIO()):
            warnings.simplefilter("error")
            try:
                folder.mkdir()
                reader.use(folder, data)
            except (ValueError, OSError):
                return
            finally:
                shutil.rmtree(folder)

    if again is not None:
        return attempt(again.read_bytes())
    arguments = [*LIMITS, f"-max_total_time={seconds:.0f}", f"-artifact_prefix={corpus}/"]
    atheris.Setup([sys.argv[0], *arguments, f"-dict={words}", str(corpus)], attempt)
    atheris.Fuzz()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("readers", nargs="*", choices=[*ALL, []], metavar="READER", help=f"of {', '.join(ALL)}; all")
    parser.add_argument("--minutes", type=float, default=60.0, help="for all of them together")
    parser.add_argument("--corpus", type=Path, default=Path("fuzz-corpus"))
    parser.add_argument("--again", type=Path)
    options = parser.parse_args()
    if atheris is None and options.again is None:
        parser.error("atheris is not installed; run: pip install atheris==3.0.0")
    names = options.readers or list(ALL)
    for name in names:
        print(f"\n== {name}", flush=True)
        if not (child := os.fork()):  # libFuzzer ends its process
            fuzz(name, options.corpus, 60.0 * options.minutes / len(names), options.again)
            return
        _, status = os.waitpid(child, 0)
        print(f"== {name}: {'FINDING' if status else 'no finding'}", flush=True)


if __name__ == "__main__":
    main()
