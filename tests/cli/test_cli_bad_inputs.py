"""Bad inputs of every kind through the command: one line says what is wrong, never a traceback, never a wait."""

import json
import os
import struct
import zlib
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from bad_files import (
    AIRSIM,
    CAMERA,
    DEEP,
    FAST,
    GREY,
    HUGE,
    PICTURE,
    ROW,
    bounded,
    check_line,
    lay,
    lines_of,
    link_to,
    sparse,
)

from deckline.cli.main import main
from recording.log_bytes import dataflash, ulog

NOISE = np.random.default_rng(0).integers(0, 256, (64, 96, 3), np.uint8)
JPEG = cv2.imencode(".jpg", NOISE)[1].tobytes()
HALF = len(JPEG) // 2
POSES = "time_s,x_m,y_m,z_m,qw,qx,qy,qz\n"
SCENE = '{"format": "deckline-scene", "version": 1, '
NAMED = "file," + POSES
YAML = "image_width: 64\nimage_height: 36\ncamera_matrix: "
BOMB = "a: &a [1,1,1,1,1,1,1,1,1]\n" + "".join(
    f"{b}: &{b} [{','.join(9 * ['*' + a])}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)
RUNWAY = {"categories": [{"id": 1, "keypoints": ["left_1", "left_2"]}], "annotations": []}


def png_of_size(width: int, height: int) -> bytes:
    """A small PNG whose header states any size, with few rows behind it."""

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    pixels = chunk(b"IDAT", zlib.compress(bytes(3 * 10_000)))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + pixels + chunk(b"IEND", b"")


FIFO, ZERO = os.mkfifo, link_to("/dev/zero")
A = {"a.png": PICTURE}
FILM = {"film.mp4": b"\0\0\0\x18ftypmp42" + bytes(200)}


def edited(write, before: bytes, after: bytes):
    """A whole file with a few other bytes in it."""

    def make(path: Path) -> None:
        write(path)
        data = path.read_bytes()
        assert before in data
        path.write_bytes(data.replace(before, after))

    return make


def film(path: Path) -> None:
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=10)
        stream.width, stream.height, stream.pix_fmt = 64, 36, "yuv420p"
        container.mux(stream.encode(av.VideoFrame.from_ndarray(GREY, format="rgb24")))
        container.mux(stream.encode())


def flown(write, *attitude):
    """An autopilot's log of a second."""
    times = (1.0, 1.5, 2.0)
    return lambda path: write(path, [(t, *attitude) for t in times], [(t, 46.0, 7.0, 100.0) for t in times])


def recorded(**files):
    return {"airsim_rec.txt": AIRSIM + ROW, "images/img_D_0_0_1.png": PICTURE, **files}


# What lies in the folder, and the command: "run FOLDER" where it is a text, the file of the folder that is run.
RUNS = {
    # pictures: nothing usable is left
    "nothing": ({}, "none"),
    "empty folder": ({"sub/x": ""}, "sub"),
    "empty png": ({"a.png": b""}, ""),
    "text for a png": ({"a.png": "no picture"}, ""),
    "png cut": ({"a.png": PICTURE[:-20]}, ""),
    "png of 12000x12000": ({"a.png": png_of_size(12000, 12000)}, ""),
    "png of 2^31 px a side": ({"a.png": png_of_size(2**31 - 1, 2**31 - 1)}, ""),
    "png of 0 px": ({"a.png": png_of_size(0, 5)}, ""),
    "ppm of 1e9 px a side": ({"a.ppm": b"P6 1000000000 1000000000 255\n" + bytes(99)}, ""),
    "ppm of 12000x12000": ({"a.ppm": b"P6 12000 12000 255\n" + bytes(99)}, ""),
    "bmp of 30000x30000": (
        {"a.bmp": b"BM" + struct.pack("<IIIIiiHHIIiiII", 99, 0, 54, 40, 30000, 30000, 1, 24, *6 * (0,))},
        "",
    ),
    "jpeg halved": ({"a.jpg": JPEG[:HALF]}, ""),
    "jpeg halved with an end marker": ({"a.jpg": JPEG[:HALF] + b"\xff\xd9"}, ""),
    "jpeg with zeros in its middle": ({"a.jpg": JPEG[:HALF] + bytes(600) + JPEG[HALF + 600 :]}, ""),
    "jpeg with a part missing": ({"a.jpg": JPEG[:HALF] + JPEG[HALF + 900 :]}, ""),
    "gif": ({"a.png": b"GIF89a\x01\0\x01\0\0\0\0;"}, ""),
    "tiff that points beyond its end": ({"a.tif": b"II*\0\xff\xff\xff\x7f"}, ""),
    "webp of nothing": ({"a.webp": b"RIFF\xff\xff\xff\x7fWEBPVP8X" + bytes(20)}, ""),
    "picture in a fifo": ({"a.png": FIFO}, "a.png"),
    "picture in a device": ({"a.png": ZERO}, "a.png"),
    "picture of a terabyte": ({"a.png": sparse}, ""),
    "picture that is a folder": ({"a.png/x": ""}, "a.png"),
    "dangling link": ({"a.png": link_to("nowhere")}, "a.png"),
    "link to itself": ({"a.png": link_to("a.png")}, "a.png"),
    # videos
    "text for a video": ({"film.mp4": "no film"}, "film.mp4"),
    "empty video": ({"film.mp4": b""}, "film.mp4"),
    "video without pictures": (FILM, "film.mp4"),
    "video in a fifo": ({"film.mp4": FIFO}, "film.mp4"),
    "video in a device": ({"film.mp4": ZERO}, "film.mp4"),
    "list of files for a video": ({"film.mp4": "ffconcat version 1.0\nfile other.mp4\n", **A}, "film.mp4"),
    "playlist for a video": (
        {"film.mp4": "#EXTM3U\n#EXTINF:1,\nhttp://127.0.0.1:9/a.ts\n#EXT-X-ENDLIST\n"},
        "film.mp4",
    ),
    "session description for a video": ({"film.mp4": "v=0\nc=IN IP4 127.0.0.1\nm=video 9 RTP/AVP 96\n"}, "film.mp4"),
    "name with a protocol": ({"concat:a.mp4": "no film"}, "concat:a.mp4"),
    "video in an unknown code": ({"film.mp4": edited(film, b"avc1", b"zzz9")}, "film.mp4"),
    # cameras
    "camera without keys": ({**A, "camera.toml": ""}, ""),
    "camera of text": ({**A, "camera.toml": "width = 'wide'\n" + CAMERA.partition("\n")[2]}, ""),
    "camera of 400 digits": ({**A, "camera.toml": CAMERA.replace("50.0", HUGE)}, ""),
    "camera wider than 64 bits": ({**A, "camera.toml": CAMERA.replace("64", HUGE)}, ""),
    "camera of infinite focal length": ({**A, "camera.toml": CAMERA.replace("50.0", "inf")}, ""),
    "camera of negative size": ({**A, "camera.toml": CAMERA.replace("64", "-64")}, ""),
    "camera of another shape": ({**A, "camera.toml": CAMERA.replace("64", "99")}, ""),
    "deep camera": ({**A, "camera.toml": CAMERA + f"distortion = {DEEP}"}, ""),
    "camera with deep keys": ({**A, "camera.toml": "a" + 500 * ".a" + " = 1\n"}, ""),
    "camera of bytes": ({**A, "camera.toml": b"\xff\xfe\0"}, ""),
    "camera in a fifo": ({**A, "camera.toml": FIFO}, ""),
    "camera in a device": ({**A, "camera.toml": ZERO}, ""),
    "camera of a terabyte": ({**A, "camera.toml": sparse}, ""),
    "calibration elsewhere": ({**A, "camera.toml": "calibration = '/dev/zero'\n"}, ""),
    "calibration of tags": ({**A, "camera.yaml": "!!python/object/apply:os.system ['false']"}, ""),
    "calibration of references": ({**A, "camera.yaml": BOMB + YAML + "*i\n"}, ""),
    "deep calibration": ({**A, "camera.yaml": YAML + DEEP}, ""),
    "calibration of 400 digits": ({**A, "camera.yaml": YAML + f"[{HUGE}, 0, 1, 0, 1, 1, 0, 0, 1]"}, ""),
    "calibration of dates": ({**A, "camera.yaml": YAML + "2020-01-01"}, ""),
    "calibration of a number": ({**A, "camera.yaml": "7"}, ""),
    # poses and times
    "empty poses": ({**A, "poses.csv": ""}, ""),
    "poses of a header": ({**A, "poses.csv": NAMED}, ""),
    "poses with a column twice": ({**A, "poses.csv": "file," + NAMED + "a.png" + 9 * ",0"}, ""),
    "poses with a cell of 200 kB": ({**A, "poses.csv": NAMED + 200_000 * "x"}, ""),
    "poses with zero bytes": ({**A, "poses.csv": NAMED + "\0\n"}, ""),
    "poses with one image twice": ({**A, "poses.csv": NAMED + 2 * "a.png,0,0,0,0,1,0,0,0\n"}, ""),
    "pose of infinite numbers": ({**A, "poses.csv": NAMED + "a.png,inf,0,0,0,1,0,0,0\n"}, ""),
    "pose as far as numbers go": ({**A, "poses.csv": NAMED + "a.png,0,0,0,-1e308,1,0,0,0\n"}, ""),
    "pose without length": ({**A, "poses.csv": NAMED + "a.png,0,0,0,0,0,0,0,0\n"}, ""),
    "pose that leaves the folder": ({**A, "poses.csv": NAMED + "../a.png,0,0,0,0,1,0,0,0\n"}, ""),
    "pose of a name with 5000 digits": ({**A, "poses.csv": NAMED + f"{5000 * '1'}.png,0,0,0,0,1,0,0,0\n"}, ""),
    "poses in a fifo": ({**A, "poses.csv": FIFO}, ""),
    "poses in a device": ({**A, "poses.csv": ZERO}, ""),
    "poses by time without times": ({**A, "poses.csv": POSES + "0,0,0,0,1,0,0,0\n1,0,0,0,1,0,0,0\n"}, ""),
    "times of text": ({**A, "times.csv": "file,time_s\na.png,soon\n"}, ""),
    "times in a fifo": ({**A, "times.csv": FIFO}, ""),
    "times without the image": ({**A, "times.csv": "file,time_s\nb.png,1\n"}, ""),
    "log in a fifo": ({**A, "x.bin": FIFO}, ["--poses", "x.bin"]),
    "log in a device": ({**A, "x.ulg": ZERO}, ["--poses", "x.ulg"]),
    "log of text": ({**A, "x.tlog": "text"}, ["--poses", "x.tlog"]),
    "log cut": (
        {**A, "times.csv": "file,time_s\na.png,1\n", "x.ulg": b"ULog\x01\x12\x35\x01" + bytes(9)},
        ["--poses", "x.ulg"],
    ),
    "log of noise": (
        {**A, "times.csv": "file,time_s\na.png,1\n", "x.bin": b"\xa3\x95\x80" + bytes(range(256))},
        ["--poses", "x.bin"],
    ),
    "log with a format that is none": (
        {**A, "times.csv": "file,time_s\na.png,1\n", "x.bin": edited(flown(dataflash, 0, 0, 0), b"QLLf", b"QtLf")},
        ["--poses", "x.bin"],
    ),
    "log of messages without bytes": (
        {
            **A,
            "times.csv": "file,time_s\na.png,1\n",
            "x.bin": edited(flown(dataflash, 0, 0, 0), b"\x82\x17POS\0QLLf", b"\x82\0POS" + bytes(5)),
        },
        ["--poses", "x.bin"],
    ),
    "log of a later version": (
        {**A, "times.csv": "file,time_s\na.png,1\n", "x.ulg": edited(flown(ulog, 1, 0, 0, 0), bytes(40), b"\xff" * 40)},
        ["--poses", "x.ulg"],
    ),
    # AirSim's recordings
    "airsim without rows": ({"airsim_rec.txt": AIRSIM}, ""),
    "airsim without columns": ({"airsim_rec.txt": "a\tb\n1\t2\n"}, ""),
    "airsim in a fifo": ({"airsim_rec.txt": FIFO}, ""),
    "airsim of bytes": ({"airsim_rec.txt": bytes(range(256))}, ""),
    "airsim without its image": ({"airsim_rec.txt": AIRSIM + ROW}, ""),
    "airsim that leaves the folder": (recorded() | {"airsim_rec.txt": AIRSIM + ROW.replace("img_D", "../img_D")}, ""),
    "airsim of 400 digits": (recorded() | {"airsim_rec.txt": AIRSIM + ROW.replace("-30", HUGE)}, ""),
    "depth of another size": (
        recorded(**{"images/img_D_0_1_1.pfm": b"Pf\n1 1\n-1\n" + bytes(4)})
        | {"airsim_rec.txt": AIRSIM + ROW.replace(".png", ".png;img_D_0_1_1.pfm")},
        "",
    ),
    "depth in a fifo": (
        recorded(**{"images/img_D_0_1_1.pfm": FIFO})
        | {"airsim_rec.txt": AIRSIM + ROW.replace(".png", ".png;img_D_0_1_1.pfm")},
        "",
    ),
    "scene of text": (recorded(**{"scene.json": "text"}), ""),
    "scene of another format": (recorded(**{"scene.json": "{}"}), ""),
    "deep scene": (recorded(**{"scene.json": DEEP}), ""),
    "scene nested 200 deep": (recorded(**{"scene.json": SCENE + f'"camera": {200 * "["}{200 * "]"}}}'}), ""),
    "scene of 400 digits": (recorded(**{"scene.json": SCENE + f'"camera": {{"width": {HUGE}}}}}'}), ""),
    "scene of 5000 digits": (recorded(**{"scene.json": SCENE + f'"camera": {5000 * "1"}}}'}), ""),
    "scene of infinite heights": (
        recorded(**{"scene.json": SCENE + '"frames": {"img_D_0_0_1.png": {"deck_z_m": 1e999}}}'}),
        "",
    ),
    "scene without the frame": (recorded(**{"scene.json": SCENE + '"frames": {}}'}), ""),
    "scene of wrong frames": (recorded(**{"scene.json": SCENE + '"frames": [1]}'}), ""),
    "truth that is none": (
        recorded(**{"scene.json": SCENE + '"frames": {"img_D_0_0_1.png": {"truth": {"left": 3}}}}'}),
        "",
    ),
    "clear image elsewhere": (
        recorded(**{"scene.json": SCENE + '"frames": {"img_D_0_0_1.png": {"truth": {"clear_image": "/etc/x"}}}}'}),
        "",
    ),
    "scene in a device": (recorded(**{"scene.json": ZERO}), ""),
    # models and configurations
    "model of text": ({**A, "x.onnx": "text"}, ["--detector", "x.onnx"]),
    "model in a fifo": ({**A, "x.onnx": FIFO}, ["--detector", "x.onnx"]),
    "model in a device": ({**A, "x.onnx": ZERO}, ["--dehazer", "x.onnx"]),
    "model that is empty": ({**A, "x.onnx": b""}, ["--dehazer", "x.onnx"]),
    "configuration of text": ({**A, "x.toml": "text"}, ["--config", "x.toml"]),
    "configuration in a fifo": ({**A, "x.toml": FIFO}, ["--config", "x.toml"]),
    "configuration in a device": ({**A, "x.toml": ZERO}, ["--config", "x.toml"]),
    "configuration of 400 digits": ({**A, "x.toml": f"seed = {HUGE}"}, ["--config", "x.toml"]),
    "deep configuration": ({**A, "x.toml": f"seed = {DEEP}"}, ["--config", "x.toml"]),
    "configuration of bytes": ({**A, "x.toml": b"\xff"}, ["--config", "x.toml"]),
    "unknown key": ({**A, "x.toml": "sed = 1"}, ["--config", "x.toml"]),
    "negative seed": ({**A, "x.toml": "seed = -1"}, ["--config", "x.toml"]),
    "field of view of 180": (recorded(), ["--fov-deg", "180"]),
    "every 0": (A, ["--every", "0"]),
    "no frames": (A, ["--max-frames", "0"]),
    "start beyond the end": (A, ["--start", "99"]),
    "start of nan": (A, ["--start", "nan"]),
    "simulator without a port": (A, ["airsim://nowhere:x"]),
    # where results go
    "results on a file": ({**A, "out": "mine"}, ""),
    "results over a foreign report": ({**A, "out/report.html": "mine"}, ["--overwrite"]),
    "results over a foreign film": ({**A, "out/overlay.mp4": "mine"}, ["--resume"]),
    "results over a link": ({**A, "out/guidance.jsonl": link_to("nowhere")}, ""),
    "results over their source": ({"out/overlay.mp4": "no film"}, "out/overlay.mp4"),
    "nothing to resume": ({**A, "out/guidance.jsonl": "", "out/.unfinished/run.json": "{"}, ["--resume"]),
}


def coco(**image):
    return {"labels.json": json.dumps({**RUNWAY, "images": [{"id": 1, "file_name": "a.png"} | image]}), **A}


IMPORT = "labels import . --out out --format"
COMMANDS = {  # what lies in the folder, and the command
    "convert nothing": ({}, "convert . --out out"),
    "convert a link": (
        recorded(secret="x") | {"images/img_D_0_0_1.png": link_to("../../secret.png")},
        "convert . --out out",
    ),
    "convert a fifo": ({"airsim_rec.txt": FIFO}, "convert . --out out"),
    "convert with a camera in a device": (recorded(**{"c.toml": ZERO}), "convert . --out out --camera c.toml"),
    "convert a deep scene": (recorded(**{"scene.json": DEEP}), "convert . --plain --out out"),
    "coco of text": ({"labels.json": "text"}, f"{IMPORT} coco"),
    "deep coco": ({"labels.json": DEEP}, f"{IMPORT} coco"),
    "coco of another size": (coco(width=9, height=9), f"{IMPORT} coco"),
    "coco of sizes beyond 64 bits": (coco(width=10**400, height=9), f"{IMPORT} coco"),
    "coco of an image called labels.json": (coco(file_name="labels.json"), f"{IMPORT} coco"),
    "coco that leaves the folder": (coco(file_name="../a.png"), f"{IMPORT} coco"),
    "coco of a fifo": (coco() | {"a.png": FIFO}, f"{IMPORT} coco"),
    "coco of numbers": ({"labels.json": '{"images": 7, "annotations": [], "categories": []}'}, f"{IMPORT} coco"),
    "tusimple of text": ({"label_data.json": "text"}, f"{IMPORT} tusimple"),
    "tusimple of 400 digits": (
        {"label_data.json": f'{{"raw_file": "a.png", "h_samples": [{HUGE}, 2], "lanes": [[1, 2]]}}', **A},
        f"{IMPORT} tusimple",
    ),
    "tusimple in a fifo": ({"label_data.json": FIFO}, f"{IMPORT} tusimple"),
    "culane of text": ({"a.lines.txt": "text", **A}, f"{IMPORT} culane"),
    "culane in a device": ({"a.lines.txt": ZERO, **A}, f"{IMPORT} culane"),
    "culane of infinite numbers": ({"a.lines.txt": "inf 1 2 3\n1 2 3 4", **A}, f"{IMPORT} culane"),
    "yolo of text": ({"a.txt": "text", **A}, f"{IMPORT} yolo-pose"),
    "yolo of numbers as far as they go": (
        {"a.txt": "0 .5 .5 1 1 1e308 1 2 1 1 2 1 1 2 1 1 2", **A},
        f"{IMPORT} yolo-pose",
    ),
    "yolo in a fifo": ({"a.txt": FIFO, **A}, f"{IMPORT} yolo-pose"),
    "labelme of text": ({"a.json": "text", **A}, f"{IMPORT} labelme"),
    "labelme of a list": ({"a.json": "[]", **A}, f"{IMPORT} labelme"),
    "labelme that leaves the folder": (
        {"a.json": '{"imagePath": "/etc/passwd", "shapes": []}', **A},
        f"{IMPORT} labelme",
    ),
    "evaluate nothing": ({}, "eval recording ."),
    "evaluate pictures without truth": (A, "eval recording . --detector classical --dehazer none"),
    "evaluate a recording without truth": (recorded(), "eval recording . --detector classical --dehazer none"),
    "evaluate a damaged picture": (
        recorded() | {"images/img_D_0_0_1.png": "text"},
        "eval recording . --detector classical --dehazer none",
    ),
    "evaluate labels of text": ({**A, "labels.json": "text"}, "eval labels ."),
    "evaluate labels of no image": ({**A, "labels.json": '{"frames": [{"file": "b.png"}]}'}, "eval labels ."),
    "report of text": ({"a.json": "text"}, "eval report ."),
    "report of other figures": ({"a.json": "{}"}, "eval report ."),
    "report of a fifo": ({"a.json": FIFO}, "eval report ."),
    "deep report": ({"a.json": DEEP}, "eval report ."),
    "votes without sheets": ({"key.json": "[]", "votes.csv": "sheet,order\n1,A\n"}, "eval dehazing --votes ."),
    "live from nothing": ({}, "live nothing"),
    "live to nowhere": (A, "live . --to tcp://127.0.0.1:1"),
    "live from a fifo": ({"film.mp4": FIFO}, "live film.mp4"),
    "live over a foreign file": ({**A, "out/report.html": "x"}, "live . --out out --overwrite --detector ufld"),
    "settings of a server in a fifo": ({"s.json": FIFO}, "sim --serve --settings s.json"),
    "deep settings of a server": ({"s.json": DEEP}, "sim --serve --settings s.json"),
    "settings of 400 digits": (
        {"s.json": f'{{"CameraDefaults": {{"CaptureSettings": [{{"Width": {HUGE}}}]}}}}'},
        "sim --serve --settings s.json",
    ),
    "simulation in a fifo": ({"s.toml": FIFO}, "sim --config s.toml --out out"),
    "simulation of 400 digits": ({"s.toml": f"seed = {HUGE}"}, "sim --config s.toml --out out"),
    "an unknown command with an escape": ({}, "\x1b[31m"),
}


@pytest.mark.parametrize("name", RUNS)
def test_no_run_of_bad_input_ends_in_a_traceback(name, tmp_path, monkeypatch, capsys):
    files, what = RUNS[name]
    lay(tmp_path, files)
    monkeypatch.chdir(tmp_path)
    arguments = what if isinstance(what, list) else [what or "."]
    source = [] if isinstance(what, str) or arguments[0].startswith("airsim") else ["."]
    with bounded():
        code = main(["run", *source, *arguments, "--out", "out", *FAST[: 4 if "x.onnx" not in arguments else 0]])
    check_line(code, lines_of(capsys))


@pytest.mark.parametrize("name", COMMANDS)
def test_no_other_command_ends_in_a_traceback(name, tmp_path, monkeypatch, capsys):
    files, command = COMMANDS[name]
    lay(tmp_path, files)
    monkeypatch.chdir(tmp_path)
    with bounded():
        code = main(command.split())
    check_line(code, lines_of(capsys))


NAMES = {b"\xff.png": r"\xff.png", b"\x1b[31m.png": r"\x1b[31m.png", b"[b].png": "[b].png", b"=1+1.png": "=1+1.png"}


def test_odd_names_are_run_and_shown_harmlessly(tmp_path, capsys):
    folder = tmp_path / os.fsdecode(b"[/b] \xff\x1b[31m")
    for name in NAMES:
        lay(folder, {os.fsdecode(name): PICTURE, os.fsdecode(b"+" + name): "no picture"})
    out = folder / "out"
    assert main(["run", str(folder), "--out", str(out), *FAST]) == 0
    output = capsys.readouterr()
    assert "\x1b" not in output.out + output.err and "\\xff" in output.out
    records = [json.loads(line) for line in (out / "guidance.jsonl").read_text().splitlines()]
    assert {record["file"] for record in records} == {sign + name for name in NAMES.values() for sign in ("", "+")}
    cells = [line.partition(",")[0] for line in (out / "guidance.csv").read_text().splitlines()[1:]]
    assert len(cells) == 8 and sum(cell.startswith("'") for cell in cells) == 5
    assert not any(cell.startswith(("=", "+", "\x1b")) for cell in cells)
    assert "\x1b" not in (out / "report.html").read_text()


def test_a_results_folder_that_is_its_own_source_is_refused_whatever_is_asked(tmp_path, capsys):
    lay(tmp_path, {"out/overlay.mp4": "no film", "out/guidance.jsonl": ""})
    film(tmp_path / "out" / "overlay.mp4")
    before = (tmp_path / "out" / "overlay.mp4").read_bytes()
    for option in ("--overwrite", "--resume"):
        source = str(tmp_path / "out" / "overlay.mp4")
        assert main(["run", source, "--out", str(tmp_path / "out"), option, *FAST]) == 2
        assert "would replace it" in capsys.readouterr().err
    assert (tmp_path / "out" / "overlay.mp4").read_bytes() == before


def test_a_demo_replaces_no_folder_that_is_not_its_own(tmp_path, capsys):
    lay(tmp_path, {"approach/airsim_rec.txt": "mine"})
    assert main(["demo", "--out", str(tmp_path)]) == 2
    assert "not the shipped approach" in capsys.readouterr().err
    assert (tmp_path / "approach" / "airsim_rec.txt").read_text() == "mine"
