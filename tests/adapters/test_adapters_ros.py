"""Guidance as ROS 2 messages, read back by another implementation of MCAP and of ROS 2's encoding."""

import json
import socket
import threading
from contextlib import closing, suppress
from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from scipy.spatial.transform import RigidTransform, Rotation
from websockets.sync.client import connect

from approach_scene import CAMERA, HEIGHT_M, LATERAL_M, STILL, Approach, chain, frame
from deckline.adapters.foxglove.publisher import FlightPublisher, Publisher
from deckline.adapters.ros.encode import Encoder
from deckline.adapters.ros.messages import deck_from_body
from deckline.cli.main import main
from deckline.cli.run import unpack_sample
from deckline.live.datagrams import parse_host_port
from deckline.live.recorder import FrameFolder
from deckline.recording import open_recording
from deckline.report.records import frame_record
from deckline.report.run import run
from deckline.types import Diagnostic, Reason, Status
from picture_scene import picture_result

COUNT = 4
POSE, LINES, SEEN = "/deckline/pose", "/deckline/lines", "/deckline/annotations"


def read(path):
    """Messages by topic."""
    found = {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        for _, channel, message, decoded in reader.iter_decoded_messages():
            found.setdefault(channel.topic, []).append((message.log_time, decoded))
    return found


def transform(values):
    """A Transform, or a Pose."""
    move = values.translation if hasattr(values, "translation") else values.position
    q = values.rotation if hasattr(values, "rotation") else values.orientation
    return RigidTransform.from_components([move.x, move.y, move.z], Rotation.from_quat([q.x, q.y, q.z, q.w]))


def transforms(found):
    """Parent and transform of each child."""
    every = [one for _, message in found["/tf"] for one in message.transforms]
    return {one.child_frame_id: (one.header.frame_id, transform(one.transform)) for one in every}


@pytest.fixture
def written(tmp_path):
    """What a view writes of results and records."""

    def write(*pairs):
        with closing(Publisher(tmp_path / "a.mcap", None, overwrite=True)) as publisher:
            view = FlightPublisher(publisher, "the camera", STILL)
            for result, record in pairs:
                view(result, record)
        return read(tmp_path / "a.mcap")

    return write


def test_a_run_writes_poses_in_the_decks_frame(tmp_path):
    with closing(Publisher(tmp_path / "a.mcap", None)) as publisher:
        run(Approach(COUNT), chain, tmp_path / "out", views=(FlightPublisher(publisher, "approach", STILL),))
    found = read(tmp_path / "a.mcap")
    assert len(found[POSE]) == COUNT
    for index, (log_ns, message) in enumerate(found[POSE]):
        assert log_ns == 250_000_000 * index and message.header.frame_id == "deck"
        place = message.pose.pose.position  # x along the landing, y left, z up, the ramp at 0
        guidance = chain(frame(index, 150.0 - 2 * index)).guidance
        assert (place.y, place.z) == pytest.approx((-LATERAL_M, HEIGHT_M), abs=1e-3)
        assert place.x == pytest.approx(-guidance.distance_to_ramp_m.value) == pytest.approx(-150 + 2 * index, abs=3)
        yaw, pitch, roll = transform(message.pose.pose).rotation.as_euler("ZYX")
        assert (yaw, pitch, roll) == pytest.approx((-0.02, 0.06, 0.0), abs=1e-5)  # nose right and down
        covariance = np.reshape(message.pose.covariance, (6, 6))
        assert (
            covariance[1, 1] == pytest.approx(guidance.lateral_deviation_m.sigma**2) and (np.diag(covariance) > 0).all()
        )


def test_transforms_agree_with_the_pose_and_with_the_world(tmp_path, written):
    at = frame(0, 150.0)
    result = chain(at)
    found = written((result, frame_record(result, STILL.approach)))
    moves = transforms(found)
    assert {child: parent for child, (parent, _) in moves.items()} == {
        "base_link": "map",
        "camera_optical_frame": "base_link",
        "deck": "map",
    }
    body, deck = moves["base_link"][1], moves["deck"][1]
    north, east, down = at.world_from_body.translation
    np.testing.assert_allclose(body.translation, [east, north, -down], atol=1e-9)
    nose = [np.cos(0.06) * np.sin(0.02), np.cos(0.06) * np.cos(0.02), np.sin(-0.06)]  # east, north, up
    np.testing.assert_allclose(body.rotation.apply([1, 0, 0]), nose, atol=1e-12)
    ((_, pose),) = found[POSE]
    np.testing.assert_allclose((deck.inv() * body).as_matrix(), transform(pose.pose.pose).as_matrix(), atol=1e-9)
    assert deck.translation[[0, 2]] == pytest.approx([0.0, 20.0], abs=1e-3)  # on the line to the north, 20 m up
    assert deck.translation[1] == pytest.approx(0.0, abs=3.0)  # at the ramp
    view = (body * moves["camera_optical_frame"][1]).rotation.apply([0, 0, 1])
    np.testing.assert_allclose(view, body.rotation.apply([1, 0, 0]), atol=1e-9)
    ((_, markers),) = found[LINES]
    left = next(marker for marker in markers.markers if marker.id == 0 and marker.points)
    assert left.header.frame_id == "map"
    assert [left.points[0].x, left.points[0].z] == pytest.approx([-8.0, 20.0], abs=1e-2)  # 8 m west
    ((_, info),) = found["/deckline/camera_info"]
    np.testing.assert_allclose(np.reshape(info.k, (3, 3)), CAMERA.matrix)
    ((_, seen),) = found[SEEN]
    ends = result.estimate.pixel_lines["left"].ends_px
    np.testing.assert_allclose([[point.x, point.y] for point in seen.points[:2]], ends)


def test_a_pose_of_the_picture_has_the_deck_in_the_body_and_no_map(written):
    result, flown = picture_result(in_widths=False), chain(frame())
    found = written((result, frame_record(result, STILL.approach)))
    moves = transforms(found)
    assert {child: parent for child, (parent, _) in moves.items()} == {
        "camera_optical_frame": "base_link",
        "deck": "base_link",
    }
    ((_, pose),) = found[POSE]
    np.testing.assert_allclose((moves["deck"][1].inv()).as_matrix(), transform(pose.pose.pose).as_matrix(), atol=1e-9)
    by_navigation = deck_from_body(flown, STILL.approach.point_m)
    np.testing.assert_allclose(
        deck_from_body(result, STILL.approach.point_m).as_matrix(), by_navigation.as_matrix(), atol=1e-3
    )
    ((_, markers),) = found[LINES]
    left = next(marker for marker in markers.markers if marker.id == 0 and marker.points)
    assert left.header.frame_id == "deck"
    assert [left.points[0].x, left.points[0].y, left.points[0].z] == pytest.approx([0.0, 8.0, 0.0], abs=0.05)
    values = {pair.key: pair.value for pair in found["/diagnostics"][0][1].status[0].values}
    assert values["pose_source"] == "picture"


def test_runway_widths_make_no_pose_and_no_lines(written):
    result = picture_result()
    found = written((result, frame_record(result, STILL.approach)))
    assert POSE not in found and transforms(found).keys() == {"camera_optical_frame"}
    assert [[marker.action for marker in m.markers] for _, m in found[LINES]] == [[3]]
    values = {pair.key: pair.value for pair in found["/diagnostics"][0][1].status[0].values}
    assert float(values["lateral_deviation_widths"]) == pytest.approx(3.0 / 16.0, abs=1e-3)


def test_a_camera_whose_focal_length_is_assumed_is_no_calibration(written):
    at = frame()
    result = chain(replace(at, camera=replace(at.camera, focal_sigma=0.05)))
    assert "/deckline/camera_info" not in written((result, frame_record(result, STILL.approach)))


def test_what_is_no_guidance_does_not_resemble_it(written):
    one_line = chain(frame(), sides=("left",))
    nothing = chain(frame(1), sides=())
    late = chain(frame(2))
    records = [frame_record(result, STILL.approach) for result in (one_line, nothing, late)]
    records[2] |= {"status": "stale", "flags": [{"name": "stale", "reason": "the answer is 0.41 s old"}]}
    silent = {"file": None, "status": "stale", "reason": "no frame for 0.50 s", "live": {"age_s": 0.5}}
    skipped = {"file": "frame_004.png", "skipped": "cut short"}
    found = written(*zip((one_line, nothing, late), records, strict=True), (None, silent), (None, skipped))
    assert POSE not in found
    assert transforms(found).keys() == {"base_link", "camera_optical_frame"}
    assert all([marker.action for marker in m.markers] == [3] for _, m in found[LINES])  # delete all
    states = [(log_ns, m.status[0]) for log_ns, m in found["/diagnostics"]]
    assert [state.level for _, state in states] == [1, 2, 3, 2, 3]
    assert [log_ns for log_ns, _ in states] == [0, 250_000_000, 500_000_000, 500_000_000, 1_000_000_000]
    values = {pair.key: pair.value for pair in states[2][1].values}
    assert values["flags"] == "stale" and states[2][1].hardware_id == "the camera"
    assert [state.message for _, state in states[3:]] == ["skipped: cut short", "stale: no frame for 0.50 s"]


def test_flagged_numbers_make_no_pose_no_deck_and_no_lines(written):
    result = chain(frame())
    flag = Diagnostic(Reason.SPACING, "the lines are 16 m apart, 20 m are stated")
    flagged = replace(result, guidance=result.guidance.with_flag(flag))
    record = frame_record(flagged, STILL.approach)
    assert record["status"] == Status.UNVERIFIED and [one["name"] for one in record["flags"]] == [Reason.SPACING]
    found = written((flagged, record))
    assert POSE not in found and "deck" not in transforms(found)
    assert [[marker.action for marker in m.markers] for _, m in found[LINES]] == [[3]]
    assert found[SEEN][0][1].points  # the lines in the picture remain


def test_without_a_pose_there_is_a_picture_and_no_pose(written):
    result = chain(frame(pose=False))
    found = written((result, frame_record(result, STILL.approach)))
    assert POSE not in found and len(found["/deckline/image/compressed"]) == 1
    assert transforms(found).keys() == {"camera_optical_frame"}


def test_a_recording_becomes_a_bag_and_a_folder_again(tmp_path, capsys):
    with closing(FrameFolder(tmp_path / "first")) as folder:
        for index in range(3):
            depth = np.full((CAMERA.height, CAMERA.width), 40.0 + index, np.float32)
            folder.add(replace(frame(index, 150.0 - 2 * index), truth=None, depth_m=depth))
    for source, out in (("first", "a.mcap"), ("a.mcap", "back")):
        assert main(["convert", str(tmp_path / source), "--out", str(tmp_path / out)]) == 0
        assert main(["convert", str(tmp_path / source), "--out", str(tmp_path / out)]) == 2
    for first, second in zip(open_recording(tmp_path / "first"), open_recording(tmp_path / "back"), strict=True):
        np.testing.assert_array_equal(first.image_rgb, second.image_rgb)
        np.testing.assert_allclose(first.world_from_camera.as_matrix(), second.world_from_camera.as_matrix(), atol=1e-5)
        np.testing.assert_array_equal(first.depth_m, second.depth_m)
        assert first.camera == second.camera


@pytest.fixture
def pictures(tmp_path):
    unpack_sample(tmp_path / "sample")
    return str(tmp_path / "sample")


OPTIONS = ["--dehazer", "none", "--detector", "ufld", "--max-frames", "2"]


def test_run_writes_a_file_once(pictures, tmp_path, capsys):
    options = [*OPTIONS, "--mcap", str(tmp_path / "a.mcap")]
    assert main(["run", pictures, "--out", str(tmp_path / "out"), *options]) == 0
    assert len(read(tmp_path / "a.mcap")["/diagnostics"]) == 2
    assert main(["run", pictures, "--out", str(tmp_path / "two"), *options]) == 2
    assert "a.mcap is there already" in capsys.readouterr().err
    again = open_recording(tmp_path / "a.mcap")  # what deckline wrote is a recording
    assert "poses /tf" in again.notes[0] and again.load(0).world_from_body is not None


def test_live_writes_what_it_guided(pictures, tmp_path, capsys):
    with closing(FrameFolder(tmp_path / "short")) as folder:  # played to its end: a busy machine answers late
        for each in islice(open_recording(pictures), 10):
            folder.add(each)
    options = ["--dehazer", "none", "--detector", "ufld", "--mcap", str(tmp_path / "a.mcap")]
    assert main(["live", str(tmp_path / "short"), *options]) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    guided = [line for line in lines if line["file"] is not None]
    assert guided and len(read(tmp_path / "a.mcap")["/deckline/image/compressed"]) == len(guided)


def free_port():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return taken.getsockname()[1]


def _subscribe(client, wanted):
    """The first message of a channel. The server may tell of one before it takes a subscription: ask again."""
    for _ in range(10):
        client.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
        with suppress(TimeoutError):
            while isinstance(data := client.recv(timeout=3), str):
                pass
            return data
    raise TimeoutError("no message of a subscribed channel")


def test_foxglove_gets_the_same_messages():
    address = f"127.0.0.1:{free_port()}"
    with closing(Publisher(None, address)) as publisher:
        view, result = FlightPublisher(publisher, "approach", STILL), chain(frame())
        assert parse_host_port(publisher.url, ("ws",))[0] == "127.0.0.1"
        with connect(publisher.url, subprotocols=["foxglove.sdk.v1"]) as client:
            stop = threading.Event()

            def fly():
                while not stop.wait(0.05):
                    view(result, frame_record(result, STILL.approach))

            thread = threading.Thread(target=fly)
            thread.start()
            try:
                channels = {}
                while POSE not in channels:
                    text = client.recv(timeout=10)
                    written = json.loads(text) if isinstance(text, str) else {}
                    channels |= {channel["topic"]: channel for channel in written.get("channels", ())}
                pose = channels[POSE]
                assert (pose["encoding"], pose["schemaEncoding"]) == ("cdr", "ros2msg")
                wanted = [{"id": 7, "channelId": pose["id"]}]
                data = _subscribe(client, wanted)
            finally:
                stop.set()
                thread.join()
        assert data[0] == 1 and int.from_bytes(data[1:5], "little") == 7
        values = {"header": {"frame_id": "deck"}}
        assert data[13:][:4] == Encoder()("geometry_msgs/msg/PoseWithCovarianceStamped", values)[:4]
        with pytest.raises(ValueError, match=address):
            Publisher(None, address)


@pytest.mark.parametrize("address", ["nowhere", "127.0.0.1", "127.0.0.1:port", "127.0.0.1:99999"])
def test_a_wrong_address_is_one_line(address, pictures, tmp_path, capsys):
    assert main(["run", pictures, "--out", str(tmp_path / "out"), *OPTIONS, "--foxglove", address]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "ws://" in line


def test_unknown_fields_are_refused():
    with pytest.raises(ValueError, match=r"Pose.*places"):
        Encoder()("geometry_msgs/msg/Pose", {"places": {}})
