"""`deckline live` on recordings at their own pace, and how it ends."""

import json
import os
import re
import signal
import socket
import threading

import cv2
import pytest
from loopback import free_port, picture

from deckline.cli.main import main

OPTIONS = ["--dehazer", "none", "--detector", "ufld"]
AUTOPILOT = ["--mavlink", "udp:127.0.0.1:1", "--autopilot", "px4"]


@pytest.fixture
def folder(tmp_path):
    """Six pictures, a twentieth of a second apart."""
    path = tmp_path / "pictures"
    path.mkdir()
    for index in range(6):
        cv2.imwrite(str(path / f"{index}.png"), picture(index))
    rows = "".join(f"{index}.png,{0.05 * index}\n" for index in range(6))
    (path / "times.csv").write_text("file,time_s\n" + rows)
    return path


def read(text):
    return [json.loads(line) for line in text.splitlines()]


def test_a_recording_is_played_once_and_leaves_a_run_folder(folder, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["live", str(folder), "--out", str(out), *OPTIONS]) == 0
    output = capsys.readouterr()
    messages = read(output.out)
    assert messages[-1]["file"] == "5.png" and messages[-1]["live"]["frames"] == 6
    assert "6 frames" in output.err
    assert read((out / "guidance.jsonl").read_text()) == messages
    assert {path.name for path in out.iterdir()} == {"guidance.jsonl", "guidance.csv", "report.html", "run.toml"}
    assert main(["live", str(folder), "--out", str(out), *OPTIONS]) == 2  # holds results already


@pytest.mark.parametrize("level", ["info", "warning"])
def test_lines_for_people_have_time_and_level_and_only_those_asked_for(folder, level, capsys):
    (folder / "5.png").write_bytes(b"no picture")
    assert main(["live", str(folder), "--log-level", level, *OPTIONS]) == 0
    lines = capsys.readouterr().err.splitlines()
    levels = [re.match(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z (INFO|WARNING) ", line)[1] for line in lines]
    assert set(levels) == {"info": {"INFO", "WARNING"}, "warning": {"WARNING"}}[level]
    assert any("could not be used" in line for line in lines)
    assert any("5 frames" in line for line in lines) == (level == "info")


def test_sigterm_leaves_whole_files_and_a_restart_takes_another_folder(folder, tmp_path, capsys, monkeypatch):
    out = tmp_path / "out"
    stops = iter([lambda: os.kill(os.getpid(), signal.SIGTERM)])  # at the first message
    monkeypatch.setattr("deckline.live.folder._print_record", lambda record: next(stops, lambda: None)())
    assert main(["live", str(folder), "--out", str(out), "--record", *OPTIONS]) == 0
    records = read((out / "guidance.jsonl").read_text())
    assert records and len((out / "guidance.csv").read_text().splitlines()) == len(records) + 1
    assert {"report.html", "run.toml", "recording"} <= {path.name for path in out.iterdir()}
    assert main(["live", str(folder), "--out", str(out), *OPTIONS]) == 2
    assert str(out) in capsys.readouterr().err.splitlines()[-1]
    assert main(["live", str(folder), "--out", str(tmp_path / "next"), *OPTIONS]) == 0


def test_lines_go_out_over_udp(folder, capsys):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", port := free_port()))
        listener.settimeout(20.0)
        assert main(["live", str(folder), "--to", f"udp://127.0.0.1:{port}", *OPTIONS]) == 0
        assert "live" in json.loads(listener.recv(65536))
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_wait_for_a_stream(number, capsys):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", port := free_port()))
        messages = []

        def stop():
            messages.append(json.loads(listener.recv(65536)))  # the session runs
            os.kill(os.getpid(), number)

        thread = threading.Thread(target=stop, daemon=True)
        thread.start()
        assert main(["live", f"udp://127.0.0.1:{free_port()}", "--to", f"udp://127.0.0.1:{port}", *OPTIONS]) == 0
        thread.join()
    assert messages[0]["status"] == "stale" and "messages:" in capsys.readouterr().err


@pytest.mark.parametrize(
    "args, named",
    [
        (["udp://127.0.0.1:5600", "--record"], "--record"),
        (["udp://127.0.0.1:5600", "--duration", "0"], "--duration"),
        (["udp://127.0.0.1:5600", "--to", "tcp://h:1"], "tcp://h:1"),
        (["camera:0", "--latency-s", "-1"], "latency_s"),
        (["camera:0", "--poses", "udp://127.0.0.1:5601"], "--camera"),
        (["airsim://127.0.0.1:1", "--poses", "udp://127.0.0.1:5601"], "leave"),
        (["airsim://127.0.0.1:1", "--fov-deg", "60"], "--fov-deg"),
        (["camera:0", "--fov-deg", "0.5"], "fov_deg"),
        (["camera:0", "--fov-deg", "171"], "fov_deg"),
        (["nothing.mp4"], "nothing.mp4"),
        (["camera:0", "--mavlink", "udp:127.0.0.1:1"], "--autopilot"),
        (["camera:0", "--autopilot", "px4"], "--mavlink"),
        (["camera:0", "--poses", "mavlink"], "--mavlink"),
        (["camera:0", "--mavlink", "udp:nowhere", "--autopilot", "px4"], "udp:nowhere"),
        (["camera:0", "--mavlink", "udp:127.0.0.1:1", "--autopilot", "betaflight"], "betaflight"),
        (["camera:0", *AUTOPILOT, "--poses", "mavlink", "--origin", "1", "2", "3"], "--origin"),
    ],
)
def test_wrong_use_is_one_line(args, named, capsys):
    assert main(["live", *args, *OPTIONS]) == 2
    error = capsys.readouterr().err
    assert named in error and len(error.splitlines()) == 1


@pytest.mark.parametrize("source", ["camera:0", "pictures"])
def test_a_camera_file_that_contradicts_the_field_of_view_is_one_line(folder, source, tmp_path, capsys):
    (tmp_path / "c.toml").write_text("width = 320\nheight = 180\nfx = 300.0\nfy = 300.0\ncx = 159.5\ncy = 89.5\n")
    address = str(folder) if source == "pictures" else source
    assert main(["live", address, "--camera", str(tmp_path / "c.toml"), "--fov-deg", "30", *OPTIONS]) == 2
    error = capsys.readouterr().err
    assert "56.1 degrees" in error and "--fov-deg 30" in error and len(error.splitlines()) == 1
