"""What reads files, each with whole inputs from which `fuzz.py` starts."""

import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import av
import cv2
import numpy as np
from log_bytes import dataflash, telemetry, ulog

from deckline.config import Navigation, RunConfig
from deckline.config_file import read_config, to_toml_text
from deckline.recording import open_recording
from deckline.report.records import lookup, read_records
from deckline.report.run_folder import resume_folder
from deckline_lab.evaluation.store import Store
from deckline_lab.labels.exchange import import_labels
from deckline_lab.labels.lines import read_labels
from deckline_sim.airsim_server.settings import CaptureSetting, read_settings
from deckline_sim.config import SimConfig

IMAGE = np.random.default_rng(0).integers(0, 255, (6, 8, 3), np.uint8)
PICTURE = cv2.imencode(".png", IMAGE)[1].tobytes()
SAMPLE = zipfile.ZipFile(Path(__file__).parent.parent / "src/deckline/sample/approach.zip")
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


def image_seeds() -> list[bytes]:
    seeds = [cv2.imencode(suffix, IMAGE)[1].tobytes() for suffix in (".png", ".jpg", ".bmp", ".ppm", ".tif", ".webp")]
    return [*seeds, cv2.imencode(".png", IMAGE.astype(np.uint16) * 255)[1].tobytes()]


PICTURES = {"a.png": PICTURE, "b.png": PICTURE}
TIMED = PICTURES | {"times.csv": b"file,time_s\na.png,1.0\nb.png,1.2\n"}
RADIANS = [(t, 1.0, 0.0, 0.0, 0.0) for t in (1.0, 1.2, 1.4)]
FILES: dict[str, Callable[[], Reader]] = {
    "airsim": lambda: Reader(in_file("airsim_rec.txt", read_folder, **SHOWN), [ROWS]),
    "scene": lambda: Reader(in_file("scene.json", read_folder, **SHOWN, **{"airsim_rec.txt": ROWS}), [SCENE]),
    "camera": lambda: Reader(in_file("camera.toml", read_folder, **PICTURES), [CAMERA, b"deck_z_m=1.0\n" + CAMERA]),
    "calibration": lambda: Reader(in_file("camera.yaml", read_folder, **PICTURES), [YAML]),
    "poses": lambda: Reader(
        in_file("poses.csv", read_folder, **TIMED, **{"camera.toml": CAMERA}),
        [
            POSES,
            POSES.replace(b"file,", b"").replace(b"a.png,", b"").replace(b"b.png,", b""),
            b"time_s,lat_deg,lon_deg,alt_m,qw,qx,qy,qz\n1,1,2,3,1,0,0,0\n1.2,1,2,3,1,0,0,0\n",
        ],
    ),
    "times": lambda: Reader(
        in_file("times.csv", read_folder, **PICTURES, **{"poses.csv": POSES.replace(b"file", b"frame")}),
        [TIMED["times.csv"]],
    ),
    "bin": lambda: Reader(in_file("x.bin", read_log, **TIMED), log_seed("x.bin", dataflash, TURNS)),
    "tlog": lambda: Reader(in_file("x.tlog", read_log, **TIMED), log_seed("x.tlog", telemetry, TURNS)),
    "ulg": lambda: Reader(in_file("x.ulg", read_log, **TIMED), log_seed("x.ulg", ulog, RADIANS)),
    "image": lambda: Reader(in_file("a.png", read_source), image_seeds()),
    "depth": lambda: Reader(
        in_file(
            "depth/a.pfm", lambda path: read_source(path.parent.parent / "a.png"), **PICTURES, **{"camera.toml": CAMERA}
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
        in_file("label_data.json", import_from("tusimple"), **PICTURES),
        [b'{"raw_file": "a.png", "h_samples": [1, 2, 3], "lanes": [[1, 2, -2], [4, 5, 6]]}\n'],
    ),
    "coco": lambda: Reader(in_file("annotations.json", import_from("coco"), **PICTURES), [COCO]),
    "culane": lambda: Reader(in_file("a.lines.txt", import_from("culane"), **PICTURES), [b"1 2 3 4\n5 4 6 2\n"]),
    "yolo-pose": lambda: Reader(
        in_file("a.txt", import_from("yolo-pose"), **PICTURES), [b"0 .5 .5 1 1 .1 .2 2 .3 .4 2 .5 .4 2 .6 .2 2"]
    ),
    "labelme": lambda: Reader(in_file("a.json", import_from("labelme"), **PICTURES), [LABELME]),
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
}
