"""Files that are none, commands on them, and what must come out: one line, in time, in little memory."""

import os
import re
import signal
import socket
from contextlib import contextmanager
from pathlib import Path

import av
import cv2
import numpy as np

from deckline.cli.main import main

GREY = np.full((36, 64, 3), 90, np.uint8)
PICTURE = cv2.imencode(".png", GREY)[1].tobytes()
CAMERA = "width=64\nheight=36\nfx=50.0\nfy=50.0\ncx=31.5\ncy=17.5\n"
AIRSIM = "VehicleName\tTimeStamp\tPOS_X\tPOS_Y\tPOS_Z\tQ_W\tQ_X\tQ_Y\tQ_Z\tImageFile\n"
ROW = "D\t100\t0\t0\t-30\t1\t0\t0\t0\timg_D_0_0_1.png\n"
FAST = ("--detector", "ufld", "--dehazer", "none")
RUN = " ".join(("--out out", *FAST))
IMPORT = "labels import . --out out --format"
LOGGED = f"run . --poses x.%s --pose-offset-s 0 {RUN}"
A, TIMES = {"a.png": PICTURE}, {"times.csv": "file,time_s\na.png,1.2\n"}
AIR = {"airsim_rec.txt": AIRSIM + ROW, "images/img_D_0_0_1.png": PICTURE}
DEEP_AIR = {**AIR, "airsim_rec.txt": AIRSIM + ROW.replace(".png", ".png;img_D_0_1_1.pfm")}
BY_NAME = "file,time_s,x_m,y_m,z_m,qw,qx,qy,qz\na.png,1.2,0,0,-30,1,0,0,0\n"
BY_TIME = "time_s,x_m,y_m,z_m,qw,qx,qy,qz\n1,0,0,-30,1,0,0,0\n1.4,0,0,-30,1,0,0,0\n"
YAML = "image_width: 64\nimage_height: 36\ncamera_matrix: [50.0, 0.0, 32.0, 0.0, 50.0, 18.0, 0.0, 0.0, 1.0]\n"
DEEP = 1200 * "[" + 1200 * "]"
BARS = ("frames ", "importing ", "exporting ", "evaluating ")  # that show how far a command is
LOG_HEAD = re.compile(r"^\S+Z INFO ")  # before a line of `live`
LONGEST_S, MOST_BYTES = 120.0, 2 << 30  # s of the clock, on a busy machine too


class HangError(BaseException):
    """A command does not end; no Exception, which the command would report."""


def lay(folder: Path, files: dict) -> None:
    """Write files: bytes, text, or a function of the path that makes it."""
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if callable(content):
            content(path)
        else:
            path.write_bytes(content if isinstance(content, bytes) else content.encode())


def link_to(target: str):
    return lambda path: path.symlink_to(target)


def film(path: Path) -> None:
    """A video of one picture."""
    with av.open(str(path), "w", format="mp4") as container:
        stream = container.add_stream("libx264", rate=10)
        stream.width, stream.height, stream.pix_fmt = 64, 36, "yuv420p"
        container.mux(stream.encode(av.VideoFrame.from_ndarray(GREY, format="rgb24")))
        container.mux(stream.encode())


def write_log(write, *attitude):
    """An autopilot's log of the time of `TIMES`."""
    times = (1.0, 1.2, 1.4)
    return lambda path: write(path, [(t, *attitude) for t in times], [(t, 46.0, 7.0, 100.0) for t in times])


def sparse(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(1 << 40)


def listen(path: Path) -> None:
    """A socket; its name is bound from within its folder, because names of sockets must be short."""
    here = Path.cwd()
    os.chdir(path.parent)
    with socket.socket(socket.AF_UNIX) as bound:
        bound.bind(path.name)
    os.chdir(here)


def check_refused(folder: Path, files: dict, command: str, monkeypatch, capsys) -> str:
    """Run a command in a folder of these files: it ends in time with one line, or names the frames that it skips.

    Returns what it says.
    """
    lay(folder, files)
    monkeypatch.chdir(folder)
    with bounded():
        code = main(command.split())
    lines = [LOG_HEAD.sub("", line) for line in capsys.readouterr().err.splitlines()]
    lines = [line for line in lines if not line.startswith(("note: ", *BARS))]
    assert code in (1, 2)
    assert lines and not any(sign in line for line in lines for sign in ("Traceback", "\x1b"))
    if code == 2:
        assert len(lines) == 1 and lines[0].startswith("deckline: error: ") and len(lines[0]) < 2100
    else:
        assert any(line.startswith("skipped ") for line in lines)
    return "\n".join(lines)


@contextmanager
def bounded():
    """Fail where the block takes longer or more memory than any bad input may."""

    def stop(*_):
        raise HangError

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, LONGEST_S)
    Path("/proc/self/clear_refs").write_text("5")  # proc(5): the peak begins anew
    start = _memory("VmRSS")
    try:
        yield
        assert _memory("VmHWM") - start < MOST_BYTES
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def _memory(name: str) -> int:
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith(f"{name}:"))
