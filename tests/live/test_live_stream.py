"""A stream over the loopback that is cut and comes back; what was flown is flown again from its recording."""

import json
import socket
import threading
import time
from contextlib import closing, contextmanager

import av
import numpy as np
import pytest
from loopback import MOUNTED, PoseSender, Sender, flight, free_port, wait_until

from deckline.cli.sources import SourceOptions
from deckline.config import Navigation
from deckline.flight import Flight
from deckline.geometry import Camera, camera_mount
from deckline.live import pipeline
from deckline.live.clock import WallClock
from deckline.live.decoding import Picture
from deckline.live.folder import FlightRecorder
from deckline.live.opening import hide_credentials, open_camera
from deckline.live.pipeline import LiveSession, Outputs
from deckline.live.poses import UdpPoses
from deckline.live.source import Captured, StreamCamera
from deckline.recording import RecordingError, open_recording
from deckline.recording.camera_file import MountedCamera
from deckline.report.records import frame_record
from deckline.types import Frame

LATE_S = 60.0  # answers of a busy machine are not late here


@contextmanager
def flying(port, mounted=MOUNTED, poses=None, folder=None, stale_s=0.2):
    """Messages and log lines of a session that listens on a port."""
    wall, messages, lines = WallClock(), [], []
    camera = open_camera(f"udp://127.0.0.1:{port}", mounted, wall, log=lines.append)
    outputs, chain = Outputs(messages.append, lines.append), flight()
    kept = None if folder is None else FlightRecorder(folder, camera, chain, record=True, overwrite=False)
    session = LiveSession(
        camera, chain, outputs if kept is None else kept.add_to(outputs), poses=poses, wall=wall, stale_s=stale_s
    )
    thread = threading.Thread(target=session.run)
    thread.start()
    try:
        yield messages, lines
    finally:
        session.stop()
        thread.join()
        if kept is not None:
            kept.finish()


def answers(messages):
    return [message for message in messages if message["file"] is not None]


def test_a_wire_that_is_cut_turns_guidance_stale_and_it_recovers():
    port, pose_port = free_port(), free_port()
    poses = UdpPoses(f"udp://127.0.0.1:{pose_port}", Navigation(), WallClock(), print)
    with closing(poses), PoseSender(pose_port), flying(port, poses=poses) as (messages, lines):
        wait_until(lambda: messages)
        assert messages[0]["reason"] == "no frame yet"
        for _ in range(2):
            count = len(answers(messages))
            with Sender(port):
                wait_until(lambda count=count: len(answers(messages)) > count + 5)
            wait_until(lambda: messages[-1]["status"] == "stale" and messages[-1]["reason"].startswith("no frame for"))
            wait_until(lambda: lines and "trying again" in lines[-1])
    for message in answers(messages):
        live = message["live"]
        assert message["status"] == ("stale" if live["age_s"] > 0.2 else "unverified")
        assert live["sent_s"] - live["captured_s"] == pytest.approx(live["age_s"], abs=1e-5)
        assert live["age_s"] >= 0.0
        assert ("stale" in [flag["name"] for flag in message["flags"]]) == (live["age_s"] > 0.2)
    guided = [message for message in answers(messages) if message["guidance"]["lateral_deviation_m"]]
    assert len(guided) > 5
    assert guided[-1]["guidance"]["lateral_deviation_m"]["value"] == pytest.approx(3.0, abs=0.5)
    assert any(message["live"]["now"] for message in guided)
    last = messages[-1]
    assert last["live"]["frames"] >= len(answers(messages)) + last["live"]["dropped"] + last["live"]["unsent"]
    assert last["flags"][0]["name"] == "stale" and not any(last["guidance"].values())


def test_what_was_flown_is_flown_again_from_its_recording(tmp_path):
    port, pose_port = free_port(), free_port()
    poses = UdpPoses(f"udp://127.0.0.1:{pose_port}", Navigation(), WallClock(), print)
    with (
        closing(poses),
        PoseSender(pose_port),
        Sender(port),
        flying(port, poses=poses, folder=tmp_path / "out", stale_s=LATE_S) as (messages, _),
    ):
        wait_until(lambda: len(answers(messages)) > 8)
    sent = {message["file"]: message for message in answers(messages)}
    chain, again = flight(), {}
    for frame in open_recording(tmp_path / "out" / "recording"):
        again[frame.file] = json.loads(json.dumps(frame_record(chain(frame), chain.config.approach)))
    assert set(again) >= set(sent)
    for file, message in sent.items():
        for part in ("time_s", "status", "reasons", "flags", "guidance", "protection", "track"):
            assert again[file][part] == message[part]
    written = (tmp_path / "out" / "guidance.jsonl").read_text().splitlines()
    assert [json.loads(line)["status"] for line in written] == [message["status"] for message in messages]
    assert "captured_s" in (tmp_path / "out" / "guidance.csv").read_text().splitlines()[0]
    assert {"report.html", "run.toml"} <= {path.name for path in (tmp_path / "out").iterdir()}


def test_garbage_and_lost_packets_end_nothing_and_give_no_guidance_of_damaged_pictures():
    port = free_port()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as noise, flying(port) as (messages, _):
        for size in (1, 100, 1316):
            noise.sendto(bytes(size), ("127.0.0.1", port))
        with Sender(port, damage=7):
            wait_until(lambda: messages and messages[-1]["live"]["damaged"] > 3)
        with Sender(port):
            count = len(answers(messages))
            wait_until(lambda: len(answers(messages)) > count + 3)


@pytest.mark.parametrize("size, scaled", [((640, 360), True), ((320, 240), False)])
def test_pictures_of_another_size_are_scaled_or_refused(size, scaled):
    port = free_port()
    with Sender(port, size), flying(port) as (messages, lines):
        if scaled:
            wait_until(lambda: answers(messages))
            assert any("scaled to 640x360 px" in line for line in lines)
        else:
            wait_until(lambda: messages and "another shape" in messages[-1]["reason"])
            assert not answers(messages)


@pytest.mark.parametrize(("stated", "notes"), [({"fov_deg": 50.0}, 0), ({}, 1)])
def test_a_stated_field_of_view_makes_the_camera_of_the_first_picture(stated, notes, capsys):
    options, port = SourceOptions(deck_z_m=-20.0, **stated), free_port()
    with Sender(port), closing(options.open_stream(f"udp://127.0.0.1:{port}", WallClock(), 0.0, 30.0)) as stream:
        shown = next(item.frame for item in stream.captures() if isinstance(item, Captured))
        stream.stop()
    assert shown.camera.known == bool(stated)
    assert len(stream.notes) == notes
    if stated:
        assert (shown.camera.fov_deg, shown.camera.focal_sigma) == (pytest.approx(50.0), None)
        assert shown.deck_z_m == -20.0
        assert "camera stated by --fov-deg: 50.0 degrees across 320x180 px" in capsys.readouterr().err
    else:
        assert "camera assumed: 65 degrees across" in stream.notes[0]


def test_a_flight_that_fails_ends_the_session_with_its_error(tmp_path):
    def broken(*_):
        raise RuntimeError("a bug")

    with Sender(port := free_port()):
        camera = open_camera(f"udp://127.0.0.1:{port}", MOUNTED, WallClock(), log=lambda line: None)
        chain = flight()
        chain.detector = broken
        with pytest.raises(RuntimeError, match="a bug"):
            LiveSession(camera, chain, Outputs(lambda record: None, lambda line: None)).run(30.0)


def test_a_search_between_frames_that_fails_ends_no_flight(monkeypatch):
    def refuse(_):
        raise ValueError("a box without an end")

    monkeypatch.setattr(Flight, "search_on", refuse)
    with flying(port := free_port()) as (messages, lines), Sender(port):
        wait_until(lambda: len(answers(messages)) > 3)
        wait_until(lambda: any("a box without an end" in line for line in lines))


@pytest.mark.parametrize(("load", "lines_expected"), [(99.0, 1), (0.1, 0)])
def test_late_answers_of_a_busy_machine_are_named_once(monkeypatch, load, lines_expected):
    monkeypatch.setattr(pipeline, "LATE_S", 0.0)
    monkeypatch.setattr(pipeline, "LATE_ANSWERS", 3)
    monkeypatch.setattr(pipeline.os, "getloadavg", lambda: (load, 0.0, 0.0))
    port = free_port()
    with flying(port) as (messages, lines), Sender(port):
        wait_until(lambda: len(answers(messages)) > 8)
        assert sum("a load of" in line for line in lines) == lines_expected


def test_two_programs_cannot_take_one_stream():
    address = f"udp://127.0.0.1:{free_port()}"
    with (
        closing(open_camera(address, None, WallClock())),
        pytest.raises(RecordingError, match=address),
    ):
        open_camera(address, None, WallClock())


def test_credentials_are_no_part_of_a_name():
    assert hide_credentials("rtsp://me:pa@ss@10.0.0.2:554/cam?x=1") == "rtsp://10.0.0.2:554/cam?x=1"
    assert hide_credentials("rtsp://h/cam?user=me&Password=pa&x=1") == "rtsp://h/cam?user=...&Password=...&x=1"
    assert open_camera("rtsp://me:secret@10.0.0.2/cam", None, WallClock()).name == "rtsp://10.0.0.2/cam"


def test_a_stream_of_wide_pixels_gives_square_ones_and_their_camera():
    stored = av.VideoFrame.from_ndarray(np.zeros((48, 60, 3), np.uint8), format="rgb24")
    stored.key_frame = True
    pictures = lambda: iter([Picture(stored, "", 0.0, time.monotonic(), True, pixel_aspect=4 / 3)] * 2)  # noqa: E731
    mounted = MountedCamera(Camera(60, 48, 30.0, 40.0, 29.5, 23.5), camera_mount())
    source = StreamCamera("stream", pictures, mounted, WallClock(), 0.0, lambda _line: None)
    frame = next(item for item in source.items() if isinstance(item, Frame))
    source.stop()
    assert frame.image_rgb.shape == (48, 80, 3)
    assert (frame.camera.fx, frame.camera.fy, frame.camera.cx) == (40.0, 40.0, 39.5)
