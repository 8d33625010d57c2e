import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from deckline.recording import open_recording
from deckline.sim import RendererError, SimConfig, frames, parallel
from deckline.sim.parallel import map_frames
from deckline.types import Frame

SMALL = SimConfig(preset="train", trajectory="random", frames=7, width=96, height=54, frames_per_ship=3)
FLIGHT = SimConfig(preset="cvn", frames=6, width=96, height=54)
COMMAND = ["sim", "--preset", "train", "--trajectory", "random", "--visibility", "300..900", "--seed", "5"]
SIZE = ["--width", "160", "--height", "90"]


def picture(frame: Frame) -> np.ndarray:
    return frame.image_rgb


@pytest.mark.parametrize("jobs", [1, 3])
def test_frames_come_in_their_order_whoever_renders_them(jobs):
    items = [(SMALL, index) for index in (0, 1, 2, 5, 6)] + [(FLIGHT, index) for index in range(6)]
    expected = [frame.image_rgb for frame in frames(SMALL)]
    expected = [expected[index] for index in (0, 1, 2, 5, 6)] + [frame.image_rgb for frame in frames(FLIGHT)]
    for got, wanted in zip(map_frames(picture, items, jobs), expected, strict=True):
        np.testing.assert_array_equal(got, wanted)


def test_chunks_keep_a_ship_together_and_stay_small():
    chunks = parallel._split_chunks([(SMALL, index) for index in range(7)] + [(FLIGHT, index) for index in range(6)])
    assert [[index for _, index in chunk] for chunk in chunks] == [[0, 1, 2], [3, 4, 5], [6], [0, 1, 2, 3], [4, 5]]


def test_a_ship_that_is_only_partly_asked_for_is_not_shared_with_the_next():
    chunks = parallel._split_chunks([(SMALL, index) for index in (2, 3, 6)])
    assert [[index for _, index in chunk] for chunk in chunks] == [[2], [3], [6]]


def test_a_machine_without_opengl_ends_in_an_error_that_the_command_line_prints(monkeypatch):
    def none(config: SimConfig) -> None:
        raise RendererError("cannot create an OpenGL context")

    monkeypatch.setattr(parallel, "open_simulator", none)
    with pytest.raises(OSError, match="cannot create an OpenGL context"):
        list(map_frames(picture, [(SMALL, 0)]))


def started(out: Path, frame_count: int) -> subprocess.Popen:
    """A rendering command over two processes that has written its first rows, in a process group of its own."""
    words = [*COMMAND, *SIZE, "--frames", str(frame_count), "--jobs", "2", "--out", str(out)]
    command = subprocess.Popen(
        [sys.executable, "-m", "deckline", *words],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    deadline = time.monotonic() + 60.0
    while not list(out.glob("images/*_5000000000.pfm")):
        assert command.poll() is None, command.stderr.read()
        assert time.monotonic() < deadline
        time.sleep(0.02)
    return command


def children(pid: int) -> list[int]:
    return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def check_gone(pids: list[int]) -> None:
    deadline = time.monotonic() + 20.0
    while any(Path(f"/proc/{pid}").exists() for pid in pids):
        assert time.monotonic() < deadline, f"still there: {pids}"
        time.sleep(0.02)


def folder_bytes(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def sim(out: Path, frame_count: int, jobs: int) -> None:
    words = [*COMMAND, *SIZE, "--frames", str(frame_count), "--jobs", str(jobs), "--out", str(out)]
    subprocess.run([sys.executable, "-m", "deckline", *words], check=True, capture_output=True)


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_a_stopped_command_leaves_no_process_and_goes_on_to_the_same_bytes(tmp_path, how):
    command = started(tmp_path / "stopped", 40)
    workers = children(command.pid)
    assert len(workers) >= 2
    if how == signal.SIGINT:
        os.killpg(command.pid, how)  # as a terminal does: the whole group hears Ctrl-C
    else:
        command.kill()
    _, said = command.communicate(timeout=60)
    check_gone(workers)
    if how == signal.SIGINT:
        assert command.returncode == 130
        assert "Traceback" not in said
        assert said.strip().splitlines()[-1].startswith("deckline: stopped")
        assert 0 < len(open_recording(tmp_path / "stopped")) < 40
    sim(tmp_path / "stopped", 40, 2)
    sim(tmp_path / "once", 40, 1)
    assert folder_bytes(tmp_path / "stopped") == folder_bytes(tmp_path / "once")
