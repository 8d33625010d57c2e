"""Recorded frames are read as they were."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from approach_scene import CAMERA, STILL, Approach, frame
from deckline.config import Models
from deckline.flight import Flight
from deckline.geometry import Camera
from deckline.live.folder import RECORDING, FlightRecorder
from deckline.live.pipeline import Outputs
from deckline.live.recorder import FrameFolder, round_pose
from deckline.live.source import Playback
from deckline.recording import open_recording
from deckline.report.run_folder import CONFIG, JSONL, REPORT
from deckline.types import Frame
from picture_scene import picture_result


def test_frames_with_and_without_pose_and_depth_come_back(tmp_path):
    depth = np.full((CAMERA.height, CAMERA.width), 7.5, np.float32)
    depth[0, 0] = np.nan
    kept = [replace(frame(0), depth_m=depth, sea_z_m=1.5), replace(frame(1), sea_z_m=1.5, world_from_body=None)]
    folder = FrameFolder(tmp_path / "kept")
    for one in kept:
        folder.add(one)
    folder.close()
    read = list(open_recording(tmp_path / "kept"))
    for one, again in zip(kept, read, strict=True):
        assert (again.file, again.time_s, again.deck_z_m, again.sea_z_m) == (one.file, one.time_s, -20.0, 1.5)
        np.testing.assert_array_equal(again.image_rgb, one.image_rgb)
    np.testing.assert_array_equal(read[0].depth_m, depth)
    pose, again = kept[0].world_from_body, read[0].world_from_body
    np.testing.assert_allclose(again.as_matrix(), pose.as_matrix(), rtol=0, atol=1e-6)
    assert read[1].world_from_body is None and read[1].depth_m is None


def test_a_rounded_pose_is_what_its_written_numbers_give_back(tmp_path):
    rng, folder, poses = np.random.default_rng(0), FrameFolder(tmp_path / "kept"), []
    for index in range(50):
        drawn = RigidTransform.from_components(rng.normal(0, 300, 3), Rotation.random(rng=rng))
        poses.append(round_pose(drawn))
        np.testing.assert_allclose(poses[-1].as_matrix(), drawn.as_matrix(), rtol=0, atol=1e-6)
        folder.add(replace(frame(index), world_from_body=poses[-1]))
    folder.close()
    for pose, again in zip(poses, open_recording(tmp_path / "kept"), strict=True):
        np.testing.assert_array_equal(again.world_from_body.as_matrix(), pose.as_matrix())


def test_frames_without_a_camera_come_back_without(tmp_path):
    folder = FrameFolder(tmp_path / "kept")
    folder.add(Frame("frame_1.png", 0.25, np.zeros((20, 30, 3), np.uint8)))
    folder.close()
    (read,) = open_recording(tmp_path / "kept")
    assert not read.camera.known and read.time_s == 0.25


def test_a_pose_of_the_picture_is_not_kept_as_one_of_the_navigation(tmp_path):
    folder = FrameFolder(tmp_path / "kept")
    folder.add(picture_result(in_widths=False).frame)
    folder.close()
    (read,) = open_recording(tmp_path / "kept")
    assert read.world_from_body is None and read.camera.known


def test_frames_of_a_video_have_a_file_each(tmp_path):
    folder = FrameFolder(tmp_path / "kept")
    for index in range(2):
        folder.add(replace(frame(index), file=f"a film.mp4#{index}"))
    folder.close()
    assert [one.file for one in open_recording(tmp_path / "kept")] == ["a_film.mp4#0.png", "a_film.mp4#1.png"]


def test_a_frame_of_another_camera_is_refused(tmp_path):
    folder = FrameFolder(tmp_path / "kept")
    folder.add(frame(0))
    with pytest.raises(ValueError, match="frame_001"):
        folder.add(replace(frame(1), camera=Camera.from_fov(320, 180, 0.5)))
    folder.close()


def test_recording_is_switched_on_and_off_while_it_flies(tmp_path):
    flight = Flight.from_config(replace(STILL, models=Models(dehazer="none", detector="ufld")))
    folder, other = (
        FlightRecorder(tmp_path / name, Playback(Approach(3)), flight, record=False, overwrite=False) for name in "ab"
    )
    add = folder.add_to(Outputs(print, print)).record
    for index, on in enumerate((False, True, False)):
        folder.record(on)
        add(frame(index))
    folder.finish()
    recording = tmp_path / "a" / RECORDING
    assert [path.name for path in recording.glob("*.png")] == ["frame_001.png"]
    recording.rename(tmp_path / "b" / RECORDING)
    with pytest.raises(ValueError, match=RECORDING):
        other.record(True)
    other.abandon()
    assert {path.name for path in (tmp_path / "b").iterdir()} == {RECORDING, JSONL, CONFIG}
    assert REPORT in {path.name for path in (tmp_path / "a").iterdir()}
