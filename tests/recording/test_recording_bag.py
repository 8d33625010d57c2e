import re
import sqlite3
from contextlib import closing

import cv2
import numpy as np
import pytest
from bag_files import (
    COUNT,
    IMAGE,
    INFO,
    JPEG,
    MOUNT_M,
    ODOMETRY,
    POSE,
    START_S,
    TF,
    enu_pose,
    header,
    image,
    info,
    quaternion,
    rows,
    seen,
    transform,
    vector,
    write,
)
from mcap.reader import make_reader
from mcap.writer import Writer
from scipy.spatial.transform import Rotation

from approach_scene import CAMERA, chain
from deckline.cli.main import main
from deckline.config import Navigation
from deckline.geometry import camera_mount
from deckline.recording import RecordingError, open_recording
from deckline.recording.ros_messages import decode_depth, decode_picture, is_rectified

KINDS = ("mcap", "db3", "bag")


def assert_same(frames):
    """The frames of a bag are those of the approach, with the same guidance."""
    for found in frames:
        index = int(found.file.rpartition("#")[2])
        expected = seen(index)
        assert found.time_s == pytest.approx(START_S + 0.25 * index)
        np.testing.assert_array_equal(found.image_rgb, expected.image_rgb)
        np.testing.assert_allclose(found.world_from_body.as_matrix(), expected.world_from_body.as_matrix(), atol=1e-9)
        forward, left, up = MOUNT_M
        np.testing.assert_allclose(found.body_from_camera.translation, [forward, -left, -up], atol=1e-12)
        np.testing.assert_allclose(
            found.body_from_camera.rotation.as_matrix(), expected.body_from_camera.rotation.as_matrix(), atol=1e-9
        )
        ours, theirs = chain(found).guidance, chain(expected).guidance
        assert ours.lateral_deviation_m.value == pytest.approx(theirs.lateral_deviation_m.value, abs=1e-6)
        assert ours.height_above_deck_m.value == pytest.approx(theirs.height_above_deck_m.value, abs=1e-6)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("poses", ["pose", "odometry", "tf"])
def test_a_bag_gives_the_frames_that_were_recorded(kind, poses, tmp_path):
    source = open_recording(write(tmp_path / "flight", kind, rows(poses)), deck_z_m=-20.0)
    frames = list(source)
    assert len(source) == len(frames) == COUNT
    assert source.times().tolist() == [frame.time_s for frame in frames]
    assert [frame.file for frame in frames] == [f"{source.name.rsplit('/')[-1]}#{index}" for index in range(COUNT)]
    assert frames[0].camera == CAMERA
    assert_same([source.load(2), source.load(0)])  # any frame can be loaded
    assert "pictures /camera/image" in source.notes[0] and len(source.notes) == 2
    assert f"camera of /camera/camera_info: {CAMERA.fov_deg:.1f} degrees" in source.notes[1]


def test_names_say_that_axes_point_down_already(tmp_path):
    found = seen(0)
    pose = {
        "position": vector(found.world_from_body.translation),
        "orientation": quaternion(found.world_from_body.rotation),
    }
    values = {"header": header(1, "map_ned"), "child_frame_id": "base_link_frd", "pose": {"pose": pose}}
    written = [("/odom", ODOMETRY, t, values | {"header": header(t, "map_ned")}) for t in (1, 2)]
    pictures = [("/image", IMAGE, t, image(t, found.image_rgb)) for t in (1, 2)]
    path = write(tmp_path / "a", "mcap", [*written, *pictures, ("/camera_info", INFO, 1, info(1))])
    frame = open_recording(path, navigation=Navigation(2.0)).load(0)
    np.testing.assert_allclose(frame.world_from_body.as_matrix(), found.world_from_body.as_matrix(), atol=1e-9)


def test_a_gimbal_moves_the_camera_on_the_body(tmp_path):
    def tilted(time_s):
        turn = Rotation.from_euler("y", 10 * (time_s - START_S), degrees=True)  # of forward-left-up: nose down
        return transform(
            time_s, "base_link", "gimbal", {"position": vector([1, 0, 0]), "orientation": quaternion(turn)}
        )

    optical = {
        "position": vector([0, 0, 0]),
        "orientation": quaternion(Rotation.from_euler("ZYX", [-90, 0, -90], degrees=True)),
    }
    fixed = ("/tf_static", TF, START_S, {"transforms": [transform(0, "gimbal", "camera_optical_frame", optical)]})
    moving = [("/tf", TF, t, {"transforms": [tilted(t)]}) for t in (START_S, START_S + 0.5, START_S + 1.0)]
    path = write(tmp_path / "a", "mcap", [fixed, *moving, *rows("pose", mount=False)])
    frame = open_recording(path, navigation=Navigation(1.0), topics=["/pose"]).load(1)
    view = frame.body_from_camera.rotation.apply([0, 0, 1])
    down = np.deg2rad(2.5)
    np.testing.assert_allclose(view, [np.cos(down), 0, np.sin(down)], atol=1e-9)
    np.testing.assert_allclose(frame.body_from_camera.translation, [1, 0, 0], atol=1e-9)


@pytest.mark.parametrize(
    ("topic", "expected"),
    [
        ("/camera/image_rect", True),
        ("/camera/image_rect_color", True),
        ("image_rect/compressed", True),
        ("/camera/image_raw", False),
        ("/camera/image_raw/compressed", False),
        ("/camera/direct/image_raw", False),  # "rect" is in it
        ("/image_rect/image_raw", False),
        ("/camera/image_unrectified", False),
        ("/compressed", False),
    ],
)
def test_the_name_of_a_topic_states_whether_its_pictures_are_rectified(topic, expected):
    assert is_rectified(topic) is expected


@pytest.mark.parametrize(("topic", "scale"), [("/direct/image_raw", 1.0), ("/camera/image_rect", 0.5)])
def test_the_projection_of_camera_info_counts_for_rectified_pictures_alone(topic, scale, tmp_path):
    fx, fy, cx, cy = 0.5 * CAMERA.fx, 0.5 * CAMERA.fy, CAMERA.cx, CAMERA.cy
    p = {"p": [fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0]}
    placed = [
        (topic if name == "/camera/image" else name, kind, time_s, values | p if kind == INFO else values)
        for name, kind, time_s, values in rows()
    ]
    frame = open_recording(write(tmp_path / "a", "mcap", placed)).load(0)
    assert frame.camera.fx == pytest.approx(scale * CAMERA.fx)


def test_a_fix_and_an_attitude_make_poses(tmp_path):
    def written():
        for index in range(COUNT):
            time_s = START_S + 0.25 * index
            turn = enu_pose(seen(index))["orientation"]
            yield "/imu", "sensor_msgs/msg/Imu", time_s, {"header": header(time_s, "base_link"), "orientation": turn}
            fix = {"header": header(time_s, "gps"), "latitude": 47.0 + 1e-5 * index, "longitude": 8.0, "altitude": 50.0}
            yield "/fix", "sensor_msgs/msg/NavSatFix", time_s, fix

    path = write(tmp_path / "a", "db3", [*written(), *rows("none")])
    source = open_recording(path, navigation=Navigation(origin=(47.0, 8.0, 0.0)))
    frame = source.load(1)
    assert frame.world_from_body.translation == pytest.approx(
        [1.1118, 0.0, -50.0], abs=1e-3
    )  # 1e-5 degrees of a meridian
    rotation = seen(1).world_from_body.rotation
    np.testing.assert_allclose(frame.world_from_body.rotation.as_matrix(), rotation.as_matrix(), atol=1e-6)


@pytest.mark.parametrize(
    ("encoding", "pixels"),
    [("16UC1", np.full((180, 320), 42_000, np.uint16)), ("32FC1", np.full((180, 320), 42.0, "f4"))],
)
def test_depth_comes_in_metres(encoding, pixels, tmp_path):
    pixels[0, 0] = 0
    frame = open_recording(write(tmp_path / "a", "mcap", rows(depth=(pixels, encoding)))).load(1)
    assert np.isnan(frame.depth_m[0, 0]) and frame.depth_m[90, 9] == pytest.approx(42.0)


def test_depth_of_another_size_is_left_out_with_a_note(tmp_path):
    path = write(tmp_path / "a", "mcap", rows(depth=(np.ones((90, 160), "f4"), "32FC1")))
    source = open_recording(path)
    assert source.load(0).depth_m is None
    assert any("depth left out: /camera/depth" in note for note in source.notes)


def test_compressed_depth_is_refused(tmp_path):
    depth = {"header": header(1, "camera_optical_frame"), "format": "16UC1; compressedDepth png"}
    path = write(tmp_path / "a", "mcap", [*rows(), ("/depth/compressedDepth", JPEG, 1, depth)])
    assert any("compressed" in note for note in open_recording(path).notes)
    with pytest.raises(RecordingError, match="compressedDepth"):
        open_recording(path, topics=["/depth/compressedDepth"])


def test_attitudes_of_a_table_are_no_poses_of_a_bag(tmp_path):
    poses = tmp_path / "attitudes.csv"
    poses.write_text(f"time_s,roll_rad,pitch_rad,yaw_rad\n{START_S},0.1,0,0\n{START_S + 60},0.1,0,0\n")
    source = open_recording(
        write(tmp_path / "flight.mcap", "mcap", rows("none")), poses_file=poses, navigation=Navigation(max_gap_s=99.0)
    )
    frame = next(iter(source))
    assert frame.world_from_body is None
    np.testing.assert_allclose(frame.level_from_body.as_rotvec(), [0.1, 0.0, 0.0])


def test_without_camera_info_lines_are_in_pixels(tmp_path):
    path = write(tmp_path / "a", "mcap", rows(camera_info=False, mount=False))
    source = open_recording(path)
    assert not source.load(0).camera.known
    assert any("no camera_info" in note and "--camera FILE" in note for note in source.notes)
    (tmp_path / "camera.toml").write_text("width = 640\nheight = 360\nfx = 500\nfy = 500\ncx = 319.5\ncy = 179.5\n")
    frame = open_recording(path, camera_file=tmp_path / "camera.toml").load(0)
    assert frame.camera.fx == 250.0 and frame.world_from_body is not None


def test_without_a_mount_the_camera_points_forward(tmp_path):
    source = open_recording(write(tmp_path / "a", "mcap", rows(mount=False)))
    assert any("no transform from base_link" in note for note in source.notes)
    np.testing.assert_array_equal(source.load(0).body_from_camera.as_matrix(), camera_mount().as_matrix())


def test_a_stated_field_of_view_stands_for_camera_info(tmp_path):
    source = open_recording(write(tmp_path / "a", "mcap", rows(camera_info=False)), fov_deg=90.0)
    frame = source.load(0)
    assert (frame.camera.known, frame.camera.fx) == (True, pytest.approx(160.0))
    np.testing.assert_allclose(frame.body_from_camera.translation, [0.5, -0.1, 0.2])  # as transforms state


def test_null_data_of_a_bag_are_named(tmp_path):
    folder = write(tmp_path / "a", "db3", rows())
    with closing(sqlite3.connect(folder / "a.db3")) as file:
        file.executescript(
            "create table other (id integer, topic_id integer, timestamp integer, data blob);"
            "insert into other select id, topic_id, timestamp, null from messages;"
            "drop table messages; alter table other rename to messages;"
        )
    with pytest.raises(RecordingError, match=r"/camera/image.*NULL"):
        open_recording(folder)


def rewrite(folder, **options):
    """The file of a bag as the mcap package writes it."""
    out = folder.with_suffix(".mcap")
    with (folder / f"{folder.name}.mcap").open("rb") as old, out.open("wb") as new:
        writer, channels = Writer(new, **options), {}
        writer.start(profile="ros2")
        for schema, channel, message in make_reader(old).iter_messages():
            if channel.topic not in channels:
                known = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = writer.register_channel(channel.topic, "cdr", known)
            writer.add_message(channels[channel.topic], message.log_time, message.data, message.publish_time)
        writer.finish()
    return out


@pytest.mark.parametrize("options", [{"use_chunking": False}, {"chunk_size": 200_000}], ids=["plain", "chunks"])
def test_what_is_whole_of_a_bag_that_was_cut_short_is_read(options, tmp_path):
    path = rewrite(write(tmp_path / "a", "mcap", rows(count=12)), **options)
    data = path.read_bytes()
    for share in (0.5, 0.7, 0.9, 0.9999):
        path.write_bytes(data[: int(share * len(data))])
        source = open_recording(path, deck_z_m=-20.0)
        frames = list(source)
        assert share * 12 - 3 <= len(frames) == len(source) <= 12
        assert_same(frames[-1:])
        assert "cut short" in source.notes[1]
        assert source.load(0).file == "a.mcap#0"
    path.write_bytes(data[:40])
    with pytest.raises(RecordingError, match=r"a\.mcap"):
        open_recording(path)
    (tmp_path / "a" / "a.mcap").write_bytes(data[: len(data) // 2])  # beside metadata that tell of more
    assert 0 < len(list(open_recording(tmp_path / "a"))) < 12


def test_damage_in_the_middle_ends_the_reading_with_a_note(tmp_path):
    path = rewrite(write(tmp_path / "a", "mcap", rows(count=12)), chunk_size=200_000)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data)
    source = open_recording(path, deck_z_m=-20.0)
    assert any("reading breaks off at 100" in note for note in source.notes)
    assert 0 < len(source) < 12
    assert_same([source.load(len(source) - 1)])


@pytest.mark.parametrize(
    ("topics", "names"),
    [
        (["/nowhere"], r"/nowhere.*/camera/image \(sensor_msgs/Image\)"),
        (["/text"], r"/text \(std_msgs/String\).*not read.*CompressedImage"),
        ([], r"2 topics with pictures: /camera/image.*, /other/image.*--topic"),
        (["/camera/image"], "2 topics with poses: /pose.*, /setpoint.*--topic"),
    ],
)
def test_topics_in_doubt_are_one_line(topics, names, tmp_path, capsys):
    more = [("/other/image", IMAGE, START_S, image(START_S, np.zeros((8, 8, 3), np.uint8)))]
    more += [("/setpoint", POSE, START_S, {"header": header(START_S)})]
    more += [("/text", "std_msgs/msg/String", START_S, {"data": "hello"})]
    path = write(tmp_path / "a", "mcap", [*rows(), *more])
    options = ["--topic", *topics] if topics else []
    assert main(["run", str(path), "--out", str(tmp_path / "out"), *options]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert re.search(names, line)
    chosen = open_recording(path, topics=["/camera/image", "/pose"], deck_z_m=-20.0)
    assert_same([chosen.load(3)])


def test_a_bag_without_pictures_lists_what_it_holds(tmp_path):
    path = write(tmp_path / "a", "bag", [("/pose", POSE, 1, {})])
    with pytest.raises(RecordingError, match=r"/pose \(geometry_msgs/PoseStamped\)"):
        open_recording(path)


def test_topics_are_of_bags_alone(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((8, 8, 3), np.uint8))
    with pytest.raises(RecordingError, match="/image"):
        open_recording(tmp_path, topics=["/image"])


class Message:
    def __init__(self, **values):
        vars(self).update(values)


def raw(pixels, encoding, step=None, big=0):
    data = np.ascontiguousarray(pixels).tobytes()
    height, width = pixels.shape[:2]
    values = {"step": step or len(data) // height, "is_bigendian": big, "data": data}
    return Message(height=height, width=width, encoding=encoding, **values)


RED = np.zeros((4, 6, 3), np.uint8) + np.array([200, 40, 10], np.uint8)


@pytest.mark.parametrize(
    "message",
    [
        raw(RED, "rgb8"),
        raw(RED[:, :, ::-1], "bgr8"),
        raw(np.dstack([RED, RED[:, :, :1]]), "rgba8"),
        raw(np.dstack([RED[:, :, ::-1], RED[:, :, :1]]), "bgra8"),
        raw(RED.astype(np.uint16) * 257, "rgb16"),
        raw((RED.astype(np.uint16) * 257).astype(">u2"), "rgb16", big=1),
        Message(data=cv2.imencode(".png", RED[:, :, ::-1])[1], format="png"),
    ],
    ids=lambda message: getattr(message, "encoding", "png"),
)
def test_colours_of_every_encoding(message):
    np.testing.assert_array_equal(decode_picture(message), RED)


@pytest.mark.parametrize(("name", "at"), [("rggb", (0, 0)), ("bggr", (1, 1)), ("gbrg", (1, 0)), ("grbg", (0, 1))])
def test_bayer_patterns_begin_where_their_name_says(name, at):
    """Only red pixels are bright: the picture is red."""
    mosaic = np.zeros((16, 16), np.uint8)
    mosaic[at[0] :: 2, at[1] :: 2] = 200
    assert decode_picture(raw(mosaic, f"bayer_{name}8"))[8, 8].tolist() == pytest.approx([200, 0, 0], abs=1)


def test_rows_may_be_padded_and_must_be_whole():
    padded = np.concatenate([RED.reshape(4, -1), np.full((4, 5), 99, np.uint8)], axis=1)
    message = raw(RED, "rgb8")
    message.data, message.step = padded.tobytes(), 23
    np.testing.assert_array_equal(decode_picture(message), RED)
    message.data = message.data[:50]
    with pytest.raises(ValueError, match=r"6x4 px of rgb8.*50"):
        decode_picture(message)
    with pytest.raises(ValueError, match=r"'nv21'.*rgb8"):
        decode_picture(raw(RED, "nv21"))
    with pytest.raises(ValueError, match="16UC1"):
        decode_depth(raw(RED, "rgb8"))
