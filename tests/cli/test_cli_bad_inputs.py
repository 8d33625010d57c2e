"""Faults of contents through the command: one line that names them, no traceback, no wait, bounded memory."""

import json
import os
import struct
import zlib

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
    IMPORT,
    LOGGED,
    PICTURE,
    RUN,
    TIMES,
    A,
    check_refused,
    film,
    lay,
    link_to,
    write_log,
)

from deckline.cli.main import main
from recording.log_bytes import dataflash, ulog

NOISE = np.random.default_rng(0).integers(0, 256, (64, 96, 3), np.uint8)
JPEG = cv2.imencode(".jpg", NOISE)[1].tobytes()
HALF = len(JPEG) // 2
HUGE = "1" + 400 * "0"
BOMB = "a: &a [1,1,1,1,1,1,1,1,1]\n" + "".join(
    f"{b}: &{b} [{','.join(9 * ['*' + a])}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)
SIZED = "image_width: 64\nimage_height: 36\ncamera_matrix: "
NAMED, TIMED = BY_NAME.partition("\n")[0] + "\n", BY_TIME.partition("\n")[0] + "\n"
SCENE = '{"format": "deckline-scene", "version": 1, '
FRAME = SCENE + '"frames": {"img_D_0_0_1.png": '


def png_of_size(width: int, height: int) -> bytes:
    """A small PNG whose header states any size, with few rows behind it."""

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    pixels = chunk(b"IDAT", zlib.compress(bytes(3 * 10_000)))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + pixels + chunk(b"IEND", b"")


def edited(write, before: bytes, after: bytes):
    """A whole file with a few other bytes in it."""

    def make(path) -> None:
        write(path)
        data = path.read_bytes()
        assert before in data
        path.write_bytes(data.replace(before, after))

    return make


def coco(**image) -> str:
    keypoints = {"categories": [{"id": 1, "keypoints": ["left_1", "left_2"]}], "annotations": []}
    return json.dumps({**keypoints, "images": [{"id": 1, "file_name": "a.png"} | image]})


FLOWN, QUIET = write_log(dataflash, 0, 0, 0), write_log(ulog, 1, 0, 0, 0)
SIZES = struct.pack("<IIIIiiHHIIiiII", 99, 0, 54, 40, 30000, 30000, 1, 24, *6 * (0,))
AROUND = {  # what lies around a file; around others a picture
    "a.png": {"labels.json": coco()},
    "x.ulg": {**A, **TIMES},
    "x.bin": {**A, **TIMES},
    "airsim_rec.txt": {"images/img_D_0_0_1.png": PICTURE},
    "images/img_D_0_1_1.pfm": DEEP_AIR,
    "scene.json": AIR,
    "c.toml": AIR,
    "votes.csv": {"key.json": "{}"},
}
CONTENTS = {  # by file and command: each fault of the file's contents
    ("a.png", f"run . {RUN}"): {
        "cut": PICTURE[:-20],
        "12000x12000": png_of_size(12000, 12000),
        "2^31 px a side": png_of_size(2**31 - 1, 2**31 - 1),
        "0 px": png_of_size(0, 5),
        "gif": b"GIF89a\x01\0\x01\0\0\0\0;",
    },
    ("a.jpg", f"run a.jpg {RUN}"): {
        "halved": JPEG[:HALF],
        "halved with an end marker": JPEG[:HALF] + b"\xff\xd9",
        "zeros in its middle": JPEG[:HALF] + bytes(600) + JPEG[HALF + 600 :],
        "a part missing": JPEG[:HALF] + JPEG[HALF + 900 :],
    },
    ("a.ppm", f"run a.ppm {RUN}"): {
        "1e9 px a side": b"P6 1000000000 1000000000 255\n" + bytes(99),
        "12000x12000": b"P6 12000 12000 255\n" + bytes(99),
    },
    ("a.bmp", f"run a.bmp {RUN}"): {"30000x30000": b"BM" + SIZES},
    ("a.tif", f"run a.tif {RUN}"): {"points beyond its end": b"II*\0\xff\xff\xff\x7f"},
    ("a.webp", f"run a.webp {RUN}"): {"nothing": b"RIFF\xff\xff\xff\x7fWEBPVP8X" + bytes(20)},
    ("film.mp4", f"run film.mp4 {RUN}"): {
        "no pictures": b"\0\0\0\x18ftypmp42" + bytes(200),
        "list of files": "ffconcat version 1.0\nfile other.mp4\n",
        "playlist": "#EXTM3U\n#EXTINF:1,\nhttp://127.0.0.1:9/a.ts\n#EXT-X-ENDLIST\n",
        "session description": "v=0\nc=IN IP4 127.0.0.1\nm=video 9 RTP/AVP 96\n",
        "unknown code": edited(film, b"avc1", b"zzz9"),
    },
    ("concat:a.mp4", f"run concat:a.mp4 {RUN}"): {"name with a protocol": "no film"},
    ("camera.toml", f"run . {RUN}"): {
        "wider than 64 bits": CAMERA.replace("64", HUGE),
        "deep value": CAMERA + f"distortion = {DEEP}",
        "key of 200,000 dots": "a" + 200_000 * ".a" + " = 1\n",
        "calibration elsewhere": "calibration = '/dev/zero'\n",
    },
    ("camera.yaml", f"run . {RUN}"): {
        "tags": "!!python/object/apply:os.system ['false']",
        "references": BOMB + SIZED + "*i\n",
        "400 digits": SIZED + f"[{HUGE}, 0, 1, 0, 1, 1, 0, 0, 1]",
        "dates": SIZED + "2020-01-01",
    },
    ("poses.csv", f"run . {RUN}"): {
        "60,000 columns": ",".join(f"c{index}" for index in range(60_000)) + "\n",
        "5 million rows": NAMED + 5_000_000 * "a\n",
        "zero bytes": NAMED + "\0\n",
        "as far as numbers go": NAMED + "a.png,0,0,0,-1e308,1,0,0,0\n",
        "name of 5000 digits": NAMED + f"{5000 * '1'}.png,0,0,0,0,1,0,0,0\n",
        "infinite angles": "file,time_s,x_m,y_m,z_m,roll_deg,pitch_deg,yaw_deg\na.png,0,0,0,0,inf,0,0\n",
    },
    ("x.ulg", LOGGED % "ulg"): {
        "cut": b"ULog\x01\x12\x35\x01" + bytes(9),
        "later version": edited(QUIET, bytes(40), b"\xff" * 40),
    },
    ("x.bin", LOGGED % "bin"): {
        "a format that is none": edited(FLOWN, b"QLLf", b"QtLf"),
        "messages without bytes": edited(FLOWN, b"\x82\x17POS\0QLLf", b"\x82\0POS" + bytes(5)),
    },
    ("scene.json", f"run . {RUN}"): {
        "200 deep": SCENE + f'"camera": {200 * "["}{200 * "]"}}}',
        "400 digits": SCENE + f'"camera": {{"width": {HUGE}}}}}',
        "5000 digits": SCENE + f'"camera": {5000 * "1"}}}',
        "infinite heights": FRAME + '{"deck_z_m": 1e999}}}',
    },
    ("scene.json", "convert . --plain --out out"): {"deep": DEEP},
    ("x.onnx", "run . --out out --detector ufld --dehazer x.onnx"): {"text": "text", "empty": b""},
    ("x.toml", f"run . --config x.toml {RUN}"): {
        "400 digits": f"seed = {HUGE}",
        "key of 200,000 dots": "a" + 200_000 * ".a" + " = 1\n",
    },
    ("c.toml", "convert . --out out --camera c.toml"): {"endless": link_to("/dev/zero")},
    ("labels.json", f"{IMPORT} coco"): {
        "another size": coco(width=9, height=9),
        "sizes beyond 64 bits": coco(width=10**400, height=9),
        "image called labels.json": coco(file_name="labels.json"),
        "leaves the folder": coco(file_name="../a.png"),
        "numbers": '{"images": 7, "annotations": [], "categories": []}',
    },
    ("a.png", f"{IMPORT} coco"): {"fifo": os.mkfifo},
    ("label_data.json", f"{IMPORT} tusimple"): {
        "400 digits": f'{{"raw_file": "a.png", "h_samples": [{HUGE}, 2], "lanes": [[1, 2]]}}'
    },
    ("a.lines.txt", f"{IMPORT} culane"): {"infinite numbers": "inf 1 2 3\n1 2 3 4"},
    ("a.txt", f"{IMPORT} yolo-pose"): {"as far as numbers go": "0 .5 .5 1 1 1e308 1 2 1 1 2 1 1 2 1 1 2"},
    ("a.json", f"{IMPORT} labelme"): {
        "a list": "[]",
        "leaves the folder": '{"imagePath": "/etc/passwd", "shapes": []}',
    },
    ("labels.json", "eval labels ."): {"no image": '{"frames": [{"file": "b.png"}]}'},
    ("a.json", "eval report ."): {"other figures": "{}"},
    ("votes.csv", "eval dehazing --votes ."): {"no sheets": "sheet,order\n1,A\n"},
    ("film.mp4", "live film.mp4"): {"fifo": os.mkfifo},
    ("s.json", "sim --serve --settings s.json"): {
        "400 digits": f'{{"CameraDefaults": {{"CaptureSettings": [{{"Width": {HUGE}}}]}}}}'
    },
    ("s.toml", "sim --config s.toml --out out"): {"400 digits": f"seed = {HUGE}"},
}
DAMAGED = {**AIR, "images/img_D_0_0_1.png": "text"}
COMMANDS = {  # what lies in the folder, and the command
    "empty folder": ({"sub/x": ""}, f"run sub {RUN}"),
    "simulator without a port": (A, f"run airsim://nowhere:x {RUN}"),
    "results in a folder of 5,000 letters": (A, f"run . --out {5000 * 'a'} {' '.join(FAST)}"),
    "an unknown dehazer": (A, "run . --out out --detector ufld --dehazer magic"),
    "evaluate nothing": ({}, "eval recording ."),
    "evaluate pictures without truth": (A, f"eval recording . {' '.join(FAST)}"),
    "evaluate a recording without truth": (AIR, f"eval recording . {' '.join(FAST)}"),
    "evaluate a damaged picture": (DAMAGED, f"eval recording . {' '.join(FAST)}"),
    "live from nothing": ({}, "live nothing"),
    "live to nowhere": (A, "live . --to tcp://127.0.0.1:1"),
    "live over a foreign file": ({**A, "out/report.html": "x"}, "live . --out out --overwrite --detector ufld"),
    "an unknown command with an escape": ({}, "\x1b[31m"),
}
COMMANDS |= {
    f"{command.partition('--out')[0]}{name}: {fault}": ({**AROUND.get(name, A), name: content}, command)
    for (name, command), faults in CONTENTS.items()
    for fault, content in faults.items()
}


@pytest.mark.parametrize("name", COMMANDS)
def test_no_bad_input_ends_in_a_traceback(name, tmp_path, monkeypatch, capsys):
    shown = check_refused(tmp_path, *COMMANDS[name], monkeypatch, capsys)
    assert "magic" in shown or name != "an unknown dehazer"


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


@pytest.mark.parametrize("option", ["--overwrite", "--resume"])
def test_a_results_folder_that_holds_its_source_is_refused(option, tmp_path, capsys):
    lay(tmp_path, {"out/overlay.mp4": film, "out/guidance.jsonl": ""})
    source = tmp_path / "out" / "overlay.mp4"
    before = source.read_bytes()
    assert main(["run", str(source), "--out", str(tmp_path / "out"), option, *FAST]) == 2
    assert str(source) in capsys.readouterr().err
    assert source.read_bytes() == before


def test_a_demo_replaces_no_folder_that_is_not_its_own(tmp_path, capsys):
    lay(tmp_path, {"approach/airsim_rec.txt": "mine"})
    assert main(["demo", "--out", str(tmp_path)]) == 2
    assert str(tmp_path / "approach") in capsys.readouterr().err
    assert (tmp_path / "approach" / "airsim_rec.txt").read_text() == "mine"
