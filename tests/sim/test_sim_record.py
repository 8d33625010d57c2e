"""Frames over processes, recordings, contact sheets, settings."""

import json
import math
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from deckline.cli.main import main
from deckline.config_file import read_config, settings_to_json
from deckline.geometry import Camera, camera_mount, pose
from deckline.recording import open_recording
from deckline.recording.images import read_image
from deckline.types import Frame, Segment, Truth
from deckline_sim import SimConfig
from deckline_sim.cli import RECORDING, SHEET
from deckline_sim.config import DepthConfig, WeatherConfig
from deckline_sim.record import frame_settings, make_tile, repeatable_command

SIM = ["sim", "--frames", "3", "--preset", "cvn", "--visibility", "400..900", "--width", "160", "--height", "90"]


def test_sim_given_again_writes_nothing_new_and_other_settings_are_refused(tmp_path, capsys):
    out = tmp_path / "a"
    assert main([*SIM, "--out", str(out), "--seed", "3"]) == 0
    for frame in open_recording(out):
        assert frame.world_from_body is not None and frame.depth_m is not None
        assert 400 <= frame.truth.visibility_m <= 900
        assert frame.truth.clear_rgb.shape == (90, 160, 3)
    rows = (out / "airsim_rec.txt").read_bytes()
    assert main([*SIM, "--out", str(out), "--seed", "3"]) == 0
    assert (out / "airsim_rec.txt").read_bytes() == rows
    assert main([*SIM, "--out", str(out), "--seed", "4"]) == 2
    assert "seed" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["a.gif", "file/a.png"])
def test_a_contact_sheet_that_cannot_be_written_is_refused_before_rendering(name, tmp_path, capsys):
    (tmp_path / "file").write_bytes(b"")
    assert main(["sim", "--contact-sheet", str(tmp_path / name)]) == 2
    printed = capsys.readouterr().err
    assert name.rpartition("/")[0] in printed and "rendering" not in printed


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["--visibility", "fog"], "visibility .*'fog'"),
        (["--fov-deg", "900"], "fov_deg .*150.*900"),
        (["--set", "sheet.columns=0"], r"sheet\.columns .*0"),
        (["--set", "frames"], "--set .*'frames'"),
        (["--set", "weather.wind=3"], "weather.wind.*wind_m_s"),
        (["--contact-sheet", "a.png"], "--out .*--contact-sheet"),
    ],
)
def test_a_value_out_of_range_is_one_line(words, named, tmp_path, capsys):
    assert main(["sim", "--out", str(tmp_path / "a"), *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("deckline: error: ")
    assert re.search(named, line)


def test_settings_come_from_the_mode_the_file_set_and_flags_in_this_order(tmp_path, capsys):
    file = tmp_path / "deck.toml"
    file.write_text('seed = 3\nframes = 5\n[weather]\nwind_m_s = 7\nsky = "clear"\n')
    words = ["--config", str(file), "--set", "seed=4", "weather.wind_m_s=8", "air.model=physical", "--seed", "6"]
    assert main(["sim", "--contact-sheet", "a.png", "--print-config", *words, "--weather.sea-state", "2"]) == 0
    (tmp_path / "all.toml").write_text(capsys.readouterr().out)
    settings = read_config(type(RECORDING), tmp_path / "all.toml", RECORDING)
    assert (settings.preset, settings.frames, settings.seed) == ("train", 5, 6)
    assert settings.visibility_m == SHEET.visibility_m
    assert settings.weather == WeatherConfig(sky="clear", sea_state=2, wind_m_s=8.0)
    assert settings.air.model == "physical"
    assert type(settings.simulated) is SimConfig


def test_what_decides_a_frame_is_plain_at_any_depth():
    config = SimConfig(trajectory="random", range_m=(30.0, 60.0), depth=DepthConfig(range_m=math.inf))
    values = frame_settings(config)
    assert values["depth"]["range_m"] == "inf"
    assert values["weather"]["seed"] is None
    assert values["visibility_m"] == ["inf", "inf"]
    assert values["range_m"] == [30.0, 60.0]
    json.dumps(values, allow_nan=False)
    assert "length" not in values  # more random views go on with the same recording
    assert frame_settings(SimConfig(frames=7))["length"] == 7
    assert settings_to_json((1, [math.nan])) == [1, ["nan"]]


WORKERS = [["--out", "x", "--jobs", "3"], ["--jobs=3", "--out=x"], ["--out", "x", "--ray"], ["--ray", "head:6379"]]


@pytest.mark.parametrize("words", WORKERS)
def test_the_kept_command_leaves_out_what_does_not_change_the_frames(words, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["/somewhere/deckline", "sim", *words, "--seed", "3"])
    assert repeatable_command() == "deckline sim --seed 3"


def test_contact_sheet_is_one_picture_of_shrunken_frames_and_no_recording(tmp_path):
    out = tmp_path / "new" / "sheet.png"
    words = ["--contact-sheet", str(out), "--frames", "3", "--width", "160", "--height", "90"]
    assert main(["sim", *words, "--set", "sheet.tile_px=80", "sheet.columns=2"]) == 0
    assert [path.name for path in out.parent.iterdir()] == ["sheet.png"]
    sheet = read_image(out)
    assert sheet.shape == (90, 160, 3)
    assert not sheet[45:, 80:].any()
    before = sheet.copy()
    assert main(["sim", *words, "--set", "sheet.tile_px=80", "sheet.columns=2", "--jobs", "2"]) == 0
    np.testing.assert_array_equal(read_image(out), before)


RED, GREEN = [255, 0, 0], [0, 255, 0]


def frame(width=64, height=48, **changes) -> Frame:
    """Grey; the left line runs from (16, 24) to (16, 40), the right one lies in the image's middle column."""
    left = Segment(np.array([10.0, -1.55, 0.05]), np.array([10.0, -1.55, 1.65]))
    right = Segment(np.array([10.0, 0.05, -1.0]), np.array([10.0, 0.05, 1.0]))
    values = {
        "file": "a",
        "time_s": 0.0,
        "image_rgb": np.full((height, width, 3), 90, np.uint8),
        "camera": Camera(width, height, 100.0, 100.0, (width - 1) / 2, (height - 1) / 2),
        "world_from_body": pose([0, 0, 0], [1, 0, 0, 0]),
        "body_from_camera": camera_mount(),
        "truth": Truth(left, right),
    }
    return Frame(**{**values, **changes})


def where(image: np.ndarray, colour: list[int]) -> np.ndarray:
    return np.argwhere(np.all(image == colour, axis=2))


@pytest.mark.parametrize("shrink", [1, 2])
def test_lines_are_dotted_where_the_camera_sees_them(shrink):
    image = make_tile(frame(), 64 // shrink, with_truth=True)
    assert image.shape == (48 // shrink, 64 // shrink, 3)
    v, u = where(image, RED).T
    assert set(u.tolist()) == {16 // shrink}
    assert (v.min(), v.max()) == (24 // shrink, 40 // shrink)
    assert set(where(image, GREEN)[:, 1].tolist()) == {32 // shrink}


def test_lines_follow_the_true_pose_where_the_recorded_one_is_measured():
    measured = frame(world_from_body=pose([0, 0.5, 0], [1, 0, 0, 0]))
    true = Truth(measured.truth.left, measured.truth.right, world_from_body=pose([0, 0, 0], [1, 0, 0, 0]))
    image = make_tile(frame(world_from_body=measured.world_from_body, truth=true), 64, True)
    assert set(where(image, RED)[:, 1].tolist()) == {16}


def test_a_tile_is_shrunk_by_area_never_enlarged_and_leaves_its_frame_alone():
    item = frame(image_rgb=np.random.default_rng(0).integers(0, 256, (48, 64, 3), dtype=np.uint8))
    before = item.image_rgb.copy()
    blocks = before.reshape(12, 4, 16, 4, 3).mean(axis=(1, 3))
    assert np.abs(make_tile(item, 16, False) - blocks).max() <= 1.0
    assert make_tile(item, 200, True).shape == (48, 64, 3)
    np.testing.assert_array_equal(item.image_rgb, before)


def test_frames_without_truth_or_pose_stay_as_they_are():
    for item in (frame(truth=None), frame(world_from_body=None), frame(truth=Truth())):
        np.testing.assert_array_equal(make_tile(item, 64, True), item.image_rgb)


COMMAND = ["sim", "--preset", "train", "--trajectory", "random", "--visibility", "300..900", "--seed", "5"]
COMMAND += ["--width", "160", "--height", "90", "--frames", "28"]


def sim_words(out: Path, jobs: int) -> list[str]:
    return [sys.executable, "-m", "deckline", *COMMAND, "--jobs", str(jobs), "--out", str(out)]


def started(out: Path) -> subprocess.Popen:
    """A rendering command over two processes that has written its first rows, in a process group of its own."""
    pipes = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE}
    command = subprocess.Popen(sim_words(out, 2), **pipes, text=True, start_new_session=True)
    deadline = time.monotonic() + 60.0
    while not list(out.glob("images/*_5000000000.pfm")):
        assert command.poll() is None, command.stderr.read()
        assert time.monotonic() < deadline
        time.sleep(0.02)
    return command


def children(pid: int) -> list[int]:
    return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def is_deaf_to_interrupts(pid: int) -> bool:
    """Whether a process blocks or ignores Ctrl-C."""
    status = dict(line.split(":", 1) for line in Path(f"/proc/{pid}/status").read_text().splitlines())
    bit = 1 << (signal.SIGINT - 1)
    return bool((int(status["SigBlk"], 16) | int(status["SigIgn"], 16)) & bit)


def check_gone(pids: list[int]) -> None:
    deadline = time.monotonic() + 20.0
    while any(Path(f"/proc/{pid}").exists() for pid in pids):
        assert time.monotonic() < deadline, f"still there: {pids}"
        time.sleep(0.02)


def folder_bytes(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture(scope="module")
def whole_bytes(tmp_path_factory) -> dict[str, bytes]:
    """The files of a recording that one process made without a stop."""
    out = tmp_path_factory.mktemp("whole") / "once"
    subprocess.run(sim_words(out, 1), check=True, capture_output=True)
    return folder_bytes(out)


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_a_stopped_command_leaves_no_process_and_goes_on_to_the_same_bytes(tmp_path, how, whole_bytes):
    command = started(tmp_path / "stopped")
    workers = children(command.pid)
    assert len(workers) >= 2
    assert all(map(is_deaf_to_interrupts, workers))
    if how == signal.SIGINT:
        os.killpg(command.pid, how)  # as a terminal does: the whole group hears Ctrl-C
    else:
        command.kill()
    _, printed = command.communicate(timeout=60)
    check_gone(workers)
    if how == signal.SIGINT:
        assert command.returncode == 130
        assert "Traceback" not in printed
        assert printed.strip().splitlines()[-1].startswith("deckline: ")
        assert 0 < len(open_recording(tmp_path / "stopped")) < 28
    subprocess.run(sim_words(tmp_path / "stopped", 2), check=True, capture_output=True)
    assert folder_bytes(tmp_path / "stopped") == whole_bytes
