import json
import math
import pickle
import resource
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from recording_bytes import HEADER, PIXELS, png, recording, row
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.atomic import write_atomic
from deckline.geometry import Camera, camera_mount, pose
from deckline.recording import BadFrame, RecordingError, RecordingWriter, open_recording
from deckline.recording.writer import encode_frame
from deckline.types import Frame, Segment, Truth

CAMERA = Camera(3, 2, 4.0, 5.0, 1.0, 0.5)
LINE = Segment(np.array([-10.0, 3.0, -17.0]), np.array([-200.0, 4.0, -17.0]))


def frame(index: int, **changes) -> Frame:
    rng = np.random.default_rng(index)
    depth = rng.uniform(1.0, 500.0, (2, 3)).astype(np.float32)
    depth[0, 0] = np.nan
    values = {
        "file": f"frame {index}",
        "time_s": index / 30,
        "image_rgb": rng.integers(0, 256, (2, 3, 3), dtype=np.uint8),
        "camera": CAMERA,
        "body_from_camera": camera_mount([1.0, 0.0, 0.25]),
        "depth_m": depth,
        "world_from_body": RigidTransform.from_components(rng.normal(0, 100, 3), Rotation.random(rng=rng)),
        "deck_z_m": -17.0,
        "sea_z_m": 2.0,
        "truth": Truth(LINE, LINE, 800.0, (200.0, 205.0, 210.0), PIXELS),
    }
    return Frame(**{**values, **changes})


def write(out: Path, frames: list[Frame], **options) -> None:
    with RecordingWriter(out, **options) as writer:
        for item in frames[writer.count :]:
            writer.add(item)


def folder_bytes(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def check_same(read, written: Frame) -> None:
    assert isinstance(read, Frame), read
    np.testing.assert_array_equal(read.image_rgb, written.image_rgb)
    np.testing.assert_array_equal(read.depth_m, written.depth_m)
    assert (read.time_s, read.deck_z_m, read.sea_z_m) == (written.time_s, written.deck_z_m, written.sea_z_m)
    assert read.camera.__dict__ == written.camera.__dict__
    for name in ("world_from_body", "body_from_camera"):
        np.testing.assert_allclose(
            getattr(read, name).as_matrix(), getattr(written, name).as_matrix(), rtol=1e-12, atol=1e-12
        )
    assert read.truth.visibility_m == written.truth.visibility_m
    assert read.truth.airlight_rgb == written.truth.airlight_rgb
    np.testing.assert_array_equal(read.truth.left.p0_m, written.truth.left.p0_m)
    np.testing.assert_array_equal(read.truth.clear_rgb, written.truth.clear_rgb)


@pytest.mark.parametrize("image_format", ["png", "ppm"])
def test_what_is_written_reads_back(tmp_path, image_format):
    frames = [frame(index) for index in range(3)]
    frames.append(frame(3, camera=Camera(3, 2, 9.0, 9.0, 1.0, 0.5, (0.1, 0.0, 0.0, 0.0, 0.0))))
    frames += [frame(4, time_s=0.1), frame(5, time_s=0.1)]  # of the time of the one before
    write(tmp_path / "rec", frames, image_format=image_format, scene={"seed": 4})
    source = open_recording(tmp_path / "rec")
    for read, written in zip(source, frames, strict=True):
        check_same(read, written)
    np.testing.assert_allclose(source.times(), [written.time_s for written in frames], atol=1.5e-6)


def test_layout_is_airsims(tmp_path):
    write(tmp_path, [frame(1, time_s=1.5, world_from_body=pose([1, 2, -3], [1, 0, 0, 0]))])
    header, line = (tmp_path / "airsim_rec.txt").read_text().splitlines()
    assert header == HEADER
    names = "img_deckline_0_0_1500000000.png;img_deckline_0_1_1500000000.pfm"
    assert line == f"deckline\t1500\t1.0\t2.0\t-3.0\t1.0\t0.0\t0.0\t0.0\t{names}"
    image, depth = names.split(";")
    files = {"airsim_rec.txt", "scene.json", f"clear/{image}", f"images/{image}", f"images/{depth}"}
    assert set(folder_bytes(tmp_path)) == files


def test_scene_holds_the_camera_once_and_no_infinity(tmp_path):
    frames = [frame(1), frame(2, truth=Truth(visibility_m=math.inf)), frame(3, truth=None, deck_z_m=None, sea_z_m=None)]
    write(tmp_path, frames, scene={"preset": "paper"})
    scene = json.loads((tmp_path / "scene.json").read_text(), parse_constant=pytest.fail)
    assert scene["preset"] == "paper"
    assert scene["camera"]["fx"] == 4.0
    first, second, third = scene["frames"].values()
    assert "camera" not in first
    assert second["truth"] == {"left": None, "right": None, "visibility_m": None, "clear_air": True}
    assert third == {"time_s": 0.1}
    read = list(open_recording(tmp_path))
    assert read[1].truth.visibility_m == math.inf
    assert read[2].truth is None


def test_without_scene_json_times_keep_their_microseconds(tmp_path):
    write(tmp_path, [frame(0, time_s=1720000000.000001), frame(1, time_s=1720000000.000002)])
    (tmp_path / "scene.json").unlink()
    assert [read.time_s for read in open_recording(tmp_path)] == [1720000000.000001, 1720000000.000002]


numbers = st.floats(-1e7, 1e7)


@settings(max_examples=25)
@given(st.tuples(numbers, numbers, numbers), st.tuples(*[st.floats(-1, 1)] * 4), st.floats(0, 2e9))
def test_pose_and_time_round_trip(tmp_path_factory, position, quaternion, time_s):
    if np.linalg.norm(quaternion) < 1e-3:
        quaternion = (1.0, 0.0, 0.0, 0.0)
    out = tmp_path_factory.mktemp("rec")
    unit = np.array(quaternion) / np.linalg.norm(quaternion)
    written = frame(0, world_from_body=pose(position, unit), time_s=time_s)
    write(out, [written], image_format="ppm")
    check_same(open_recording(out).load(0), written)


def test_frames_encoded_elsewhere_are_written_the_same(tmp_path):
    frames = [frame(0), frame(1, depth_m=None), frame(2, truth=None), frame(3, deck_z_m=None), frame(4, truth=Truth())]
    frames.append(frame(5, camera=Camera(3, 2, 9.0, 9.0, 1.0, 0.5)))
    write(tmp_path / "here", frames)
    with RecordingWriter(tmp_path / "there") as writer:
        for item in frames:
            writer.append(pickle.loads(pickle.dumps(encode_frame(item))))
    assert folder_bytes(tmp_path / "there") == folder_bytes(tmp_path / "here")


def write_without_close(out: Path, frames: list[Frame]) -> None:
    """A writer that is never closed, as after a kill."""
    writer = RecordingWriter(out, scene={"seed": 1})
    for item in frames:
        writer.add(item)
    writer._rows.close()  # what the system does; close() would write scene.json


def test_killed_and_resumed_is_the_same_as_written_at_once(tmp_path):
    frames = [frame(index) for index in range(40)]
    write(tmp_path / "once", frames, scene={"seed": 1})
    write_without_close(tmp_path / "twice", frames[:33])
    with RecordingWriter(tmp_path / "twice", scene={"seed": 1}) as writer:
        assert writer.count == 25  # scene.json is written every 25 frames
    assert len(open_recording(tmp_path / "twice")) == 25
    write(tmp_path / "twice", frames, scene={"seed": 1})
    assert folder_bytes(tmp_path / "twice") == folder_bytes(tmp_path / "once")


def test_killed_before_the_first_scene_starts_anew(tmp_path):
    write_without_close(tmp_path, [frame(index) for index in range(3)])
    items = list(open_recording(tmp_path).items())
    assert [isinstance(item, BadFrame) for item in items] == [True] * 3  # never with a guessed camera
    with RecordingWriter(tmp_path, scene={"seed": 1}) as writer:
        assert writer.count == 0


@pytest.mark.parametrize("cut", [1, 20, 150])
def test_torn_last_row_is_written_again(tmp_path, cut):
    frames = [frame(index) for index in range(4)]
    write(tmp_path / "once", frames)
    write(tmp_path / "torn", frames)
    path = tmp_path / "torn" / "airsim_rec.txt"
    path.write_bytes(path.read_bytes()[:-cut])
    with RecordingWriter(tmp_path / "torn") as writer:
        assert writer.count == 3
    write(tmp_path / "torn", frames)
    assert folder_bytes(tmp_path / "torn") == folder_bytes(tmp_path / "once")


def test_row_whose_image_is_gone_is_not_whole(tmp_path):
    write(tmp_path, [frame(index) for index in range(4)])
    sorted(tmp_path.glob("images/*.pfm"))[1].unlink()
    with RecordingWriter(tmp_path) as writer:
        assert writer.count < 4


def test_closed_by_an_error_the_frames_so_far_are_whole(tmp_path):
    with pytest.raises(KeyboardInterrupt), RecordingWriter(tmp_path) as writer:
        writer.add(frame(0))
        raise KeyboardInterrupt
    check_same(open_recording(tmp_path).load(0), frame(0))


def test_other_settings_are_refused_and_the_command_may_differ(tmp_path):
    write(tmp_path, [frame(0)], scene={"seed": 1, "command": "a"})
    write(tmp_path, [frame(0), frame(1)], scene={"seed": 1, "command": "b"})
    with pytest.raises(RecordingError, match=r"seed = 1, not 2"):
        RecordingWriter(tmp_path, scene={"seed": 2})
    assert len(open_recording(tmp_path)) == 2


def test_somebody_elses_recording_is_left_alone(tmp_path):
    folder = recording(tmp_path / "rec", [row(1)], {"img_Drone_0_0_1.png": png(PIXELS)})
    before = folder_bytes(folder)
    with pytest.raises(RecordingError, match=r"scene\.json"):
        RecordingWriter(folder)
    assert folder_bytes(folder) == before


def test_folder_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordingError, match="file/rec"):
        RecordingWriter(tmp_path / "file" / "rec")


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"image_format": "gif"}, "image_format.*gif"),
        ({"scene": {"frames": {}}}, "frames"),
    ],
)
def test_wrong_options_say_what_is_wrong(tmp_path, options, text):
    with pytest.raises(ValueError, match=text):
        RecordingWriter(tmp_path, **options)


def test_frame_without_pose_or_in_another_format_is_refused_and_leaves_nothing(tmp_path):
    with RecordingWriter(tmp_path) as writer:
        with pytest.raises(ValueError, match=r"png .*ppm"):
            writer.append(encode_frame(frame(0), "ppm"))
        with pytest.raises(ValueError, match=r"frame 0.*world_from_body"):
            writer.add(frame(0, world_from_body=None))
        assert writer.count == 0
    with pytest.raises(ValueError, match=str(tmp_path)):
        writer.add(frame(0))


def test_a_file_that_the_disk_refuses_is_named_and_nothing_is_left(tmp_path):
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    (tmp_path / "a.bin").write_bytes(b"old")
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    try:
        with pytest.raises(OSError, match=r"a\.bin"):
            write_atomic(tmp_path / "a.bin", bytes(2000))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert [path.name for path in tmp_path.iterdir()] == ["a.bin"]
    assert (tmp_path / "a.bin").read_bytes() == b"old"
