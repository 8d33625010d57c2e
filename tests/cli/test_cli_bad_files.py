"""Every file that deckline reads, in every way in which a file can be none."""

import gzip
import json
import os

import cv2
import numpy as np
import pytest
from bad_files import (
    AIR,
    BY_NAME,
    BY_TIME,
    CAMERA,
    DEEP,
    DEEP_AIR,
    FAST,
    GREY,
    IMPORT,
    LOGGED,
    PICTURE,
    RUN,
    TIMES,
    YAML,
    A,
    check_refused,
    film,
    lay,
    link_to,
    sparse,
    write_log,
)

from deckline.cli.main import main
from recording.log_bytes import dataflash, telemetry, ulog

DEPTH = b"Pf\n64 36\n-1\n" + np.full((36, 64), 20.0, "<f4").tobytes()
TRUTH = {side: {"p0_m": [5.0, y, 0.0], "p1_m": [90.0, y, 0.0]} for side, y in (("left", -9.0), ("right", 9.0))}
ENTRY = {"deck_z_m": 0.0, "truth": {**TRUTH, "visibility_m": 900.0, "clear_image": "clear/a.png"}}
SCENE = json.dumps({"format": "deckline-scene", "version": 1, "frames": {"img_D_0_0_1.png": ENTRY}})
LINES = {"left_px": [[20, 30], [28, 10]], "right_px": [[44, 30], [36, 10]]}
COCO = {
    "images": [{"id": 1, "file_name": "a.png", "width": 64, "height": 36}],
    "annotations": [
        {"image_id": 1, "category_id": 1, "keypoints": [20, 30, 2, 28, 10, 2, 44, 30, 2, 36, 10, 2]},
    ],
    "categories": [{"id": 1, "keypoints": ["left_1", "left_2", "right_1", "right_2"]}],
}
TUSIMPLE = {"raw_file": "a.png", "h_samples": [10, 30], "lanes": [[28, 20], [36, 44]]}
SHAPES = [{"label": side, "shape_type": "line", "points": LINES[f"{side}_px"]} for side in ("left", "right")]
YOLO = "0 .5 .5 1 1 .3 .8 2 .4 .3 2 .7 .8 2 .6 .3 2"


def utf16(valid: bytes) -> bytes:
    return b"\xff\xfe" + valid.decode("latin-1").encode("utf-16-le")


PARTLY = {**A, "out/guidance.jsonl": "", "out/.unfinished/run.json": "{}"}
# A file: its contents where it is whole, None where it takes a renderer or a network; the files around it; the command.
FILES = {
    "a.png": (PICTURE, {}, f"run . {RUN}"),
    "a.jpg": (cv2.imencode(".jpg", GREY)[1].tobytes(), {}, f"run a.jpg {RUN}"),
    "a.tif": (cv2.imencode(".tif", GREY)[1].tobytes(), {}, f"run . {RUN}"),
    "film.mp4": (film, {}, f"run film.mp4 {RUN}"),
    "camera.toml": (CAMERA, A, f"run . {RUN}"),
    "camera.yaml": (YAML, A, f"run . {RUN}"),
    "given.toml": (CAMERA, A, f"run . --camera given.toml {RUN}"),
    "runway.toml": ("[deck]\nwidth_m = 20.0\n", A, f"run . {RUN}"),
    "poses.csv": (BY_NAME, A, f"run . {RUN}"),
    "given.csv": (BY_TIME, {**A, **TIMES}, f"run . --poses given.csv {RUN}"),
    "times.csv": (TIMES["times.csv"], A, f"run . {RUN}"),
    "x.bin": (write_log(dataflash, 1.0, 2.0, 3.0), {**A, **TIMES}, LOGGED % "bin"),
    "x.tlog": (write_log(telemetry, 1.0, 2.0, 3.0), {**A, **TIMES}, LOGGED % "tlog"),
    "x.ulg": (write_log(ulog, 1.0, 0.0, 0.0, 0.0), {**A, **TIMES}, LOGGED % "ulg"),
    "depth/a.pfm": (DEPTH, {**A, "camera.toml": CAMERA}, f"run . {RUN}"),
    "airsim_rec.txt": (AIR["airsim_rec.txt"], AIR, f"run . {RUN}"),
    "images/img_D_0_0_1.png": (PICTURE, AIR, f"run . {RUN}"),
    "images/img_D_0_1_1.pfm": (DEPTH, DEEP_AIR, f"run . {RUN}"),
    "scene.json": (SCENE, {**AIR, "clear/a.png": PICTURE}, f"run . {RUN}"),
    "clear/a.png": (PICTURE, {**AIR, "scene.json": SCENE}, f"run . {RUN}"),
    "a.mcap": (None, {}, f"run a.mcap {RUN}"),
    "a.db3": (None, {}, f"run a.db3 {RUN}"),
    "a.bag": (None, {}, f"run a.bag {RUN}"),
    "x.onnx": (None, A, "run . --out out --detector x.onnx --dehazer none"),
    "x.toml": ("seed = 1\n", A, f"run . --config x.toml {RUN}"),
    "out/.unfinished/run.json": (None, PARTLY, f"run . --resume {RUN}"),
    "labels.json": (json.dumps({"frames": [{"file": "a.png", **LINES}]}), A, f"eval labels . {' '.join(FAST)}"),
    "annotations.json": (json.dumps(COCO), A, f"{IMPORT} coco"),
    "label_data.json": (json.dumps(TUSIMPLE) + "\n", A, f"{IMPORT} tusimple"),
    "a.lines.txt": ("20 30 28 10\n44 30 36 10\n", A, f"{IMPORT} culane"),
    "list/train_gt.txt": ("/a.png 1 1\n", {**A, "a.lines.txt": "20 30 28 10\n44 30 36 10\n"}, f"{IMPORT} culane"),
    "a.txt": (YOLO, A, f"{IMPORT} yolo-pose"),
    "data.yaml": ("kpt_names:\n  0: [left, left, right, right]\n", {**A, "a.txt": YOLO}, f"{IMPORT} yolo-pose"),
    "a.json": (json.dumps({"imagePath": "a.png", "shapes": SHAPES}), A, f"{IMPORT} labelme"),
    "figures/a.json": (None, {}, "eval report figures"),
    "votes.csv": (None, {"key.json": "{}"}, "eval dehazing --votes ."),
    "settings.json": (None, {}, "sim --serve --settings settings.json"),
    "ship.toml": (None, {}, "sim --config ship.toml --out out"),
}
# What lies in its place, made of the whole file's contents; tests/test_files.py has sockets, devices and circles.
FAULTS = {
    "a folder": lambda valid: lambda path: path.mkdir(),
    "a fifo": lambda valid: os.mkfifo,
    "a link to nothing": lambda valid: link_to("nothing"),
    "a terabyte": lambda valid: sparse,
    "nothing in it": lambda valid: b"",
    "zeros": lambda valid: bytes(4096),
    "every byte": lambda valid: bytes(range(256)),
    "text of another alphabet": utf16,
    "a pointer of Git LFS": lambda valid: b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n",
    "a compressed copy": gzip.compress,
    "deep brackets": lambda valid: DEEP.encode(),
    "one long line": lambda valid: b"x" * 3_000_000,
}
# Without keys a configuration leaves all as it is; without rows a picture has no runway; without its state a run begins
# anew; and data.yaml may hold anything beside the names of keypoints.
CONTENTS = tuple(FAULTS)[tuple(FAULTS).index("nothing in it") :]
HARMLESS = {(name, "nothing in it") for name in ("x.toml", "ship.toml", "runway.toml", "a.lines.txt", "a.txt")}
HARMLESS |= {("out/.unfinished/run.json", "a link to nothing")}
HARMLESS |= {("data.yaml", fault) for fault in CONTENTS}
UNNAMED = {"a.png", "a.tif", "out/.unfinished/run.json"}  # their folder is, or what they name
KINDS = [(file, fault) for file in FILES for fault in FAULTS if (file, fault) not in HARMLESS]


def write_valid(folder, name: str) -> bytes:
    """Lay a file's surroundings and itself; returns what is in it."""
    valid, around, _ = FILES[name]
    lay(folder, {**around, name: valid or ""})
    data = (folder / name).read_bytes()
    (folder / name).unlink()
    return data


@pytest.mark.parametrize("name", [name for name, (valid, _, _) in FILES.items() if valid is not None])
def test_the_whole_file_is_taken(name, tmp_path, monkeypatch, capsys):
    data = write_valid(tmp_path, name)
    lay(tmp_path, {name: data})
    monkeypatch.chdir(tmp_path)
    assert main(FILES[name][2].split()) == 0, capsys.readouterr().err


@pytest.mark.parametrize(("name", "fault"), KINDS)
def test_no_file_that_is_none_ends_in_a_traceback(name, fault, tmp_path, monkeypatch, capsys):
    data = write_valid(tmp_path, name)
    shown = check_refused(tmp_path, {name: FAULTS[fault](data)}, FILES[name][2], monkeypatch, capsys)
    assert name in UNNAMED or name.rpartition("/")[2] in shown
