import numpy as np
import pytest
from recording_bytes import images
from scipy.spatial.transform import Rotation

from deckline.config import Navigation
from deckline.recording import BadFrame, RecordingError, open_recording
from deckline.recording.pose_track import make_track
from deckline.types import NO_POSE

LEVEL = [1.0, 0.0, 0.0, 0.0]


def track(times, *, yaw_deg=None, navigation=None, positions=None):
    times = np.asarray(times, dtype=float)
    yaws = np.zeros(len(times)) if yaw_deg is None else yaw_deg
    quaternions = Rotation.from_euler("z", np.asarray(yaws, dtype=float)[:, None], degrees=True).as_quat(
        scalar_first=True
    )
    positions = np.outer(times, [10.0, -2.0, 1.0]) if positions is None else positions
    return make_track("log", times, positions, quaternions, navigation or Navigation())


@pytest.mark.parametrize("rate_hz", [2.5, 30.0, 400.0])
def test_a_steady_turn_is_exact_at_any_rate(rate_hz):
    times = np.arange(0.0, 2.0, 1 / rate_hz)
    poses = track(times, yaw_deg=165.0 + 30.0 * times)  # beyond 180 degrees
    for time in np.arange(0.0, 1.5, 1 / 30):
        pose = poses.at(time)
        np.testing.assert_allclose(pose.translation, time * np.array([10.0, -2.0, 1.0]), atol=1e-9)
        turned = Rotation.from_euler("z", 165.0 + 30.0 * time, degrees=True)
        assert (pose.rotation.inv() * turned).magnitude() < 1e-9


@pytest.mark.parametrize(
    ("time", "known"), [(-0.01, False), (0.0, True), (1.0, False), (0.4, True), (2.2, True), (2.4, True), (2.41, False)]
)
def test_there_is_no_pose_in_long_gaps_and_beyond_the_ends(time, known):
    poses = track([0.0, 0.4, 2.0, 2.4])
    assert (poses.at(time) is not None) is known
    assert (track([0.0, 0.4, 2.0, 2.4], navigation=Navigation(max_gap_s=2.0)).at(1.0)) is not None


def test_samples_beyond_the_ends_are_those_of_the_ends():
    places, _ = track([0.0, 0.4, 0.8]).sample(np.array([-1.0, 0.6, 2.0]))
    np.testing.assert_allclose(places[:, 0], [0.0, 6.0, 8.0])


def test_the_offset_is_the_poses_clock_minus_the_pictures():
    poses = track([100.0, 100.4], navigation=Navigation(offset_s=100.0))
    np.testing.assert_allclose(poses.at(0.2).translation[0], 1002.0)


def test_times_that_are_none_or_do_not_rise_are_left_out_and_noted():
    times = [0.0, 0.1, 0.1, 0.05, np.nan, 0.2]
    poses = track(times, positions=np.arange(6.0)[:, None] * np.ones(3))
    np.testing.assert_array_equal(poses.times_s, [0.0, 0.1, 0.2])
    np.testing.assert_array_equal(poses.positions_m[:, 0], [0.0, 1.0, 5.0])
    assert [note.split()[1:4] for note in poses.notes] == [["1", "of", "6"], ["2", "of", "5"]]


def test_a_quaternion_that_is_none_costs_one_pose():
    poses = make_track("log", [0, 0.1, 0.2], np.zeros((3, 3)), [LEVEL, [0.5, 0, 0, 0], LEVEL], Navigation())
    assert len(poses.times_s) == 2


@pytest.mark.parametrize(
    ("times", "text"), [([0, 1, 2, 0.5, 1.5], r"jumps back from 2\.000 to 0\.500"), ([1.0], "1 poses"), ([], "0 poses")]
)
def test_tracks_that_cannot_be_used(times, text):
    with pytest.raises(RecordingError, match=text):
        make_track("log", times, np.zeros((len(times), 3)), np.tile(LEVEL, (len(times), 1)), Navigation())


def folder(tmp_path, poses, times=None):
    tables = {} if times is None else {"times": "file,time_s\n" + times}
    return images(tmp_path, ["a.png", "b.png", "c.png"], poses="time_s,x_m,y_m,z_m,qw,qx,qy,qz\n" + poses, **tables)


def test_images_with_times_get_poses_by_time(tmp_path):
    poses = "".join(f"{0.1 * n},{n},0,0,1,0,0,0\n" for n in range(11))
    source = open_recording(folder(tmp_path, poses, "a.png,0.25\nb.png,0.5\nc.png,3\n"))
    first, second, third = source
    np.testing.assert_allclose(
        [first.world_from_body.translation[0], second.world_from_body.translation[0]], [2.5, 5.0]
    )
    assert (third.time_s, third.missing) == (3.0, NO_POSE)
    assert "1 of 3 pictures" in source.notes[0]


def test_images_without_times_need_them(tmp_path):
    with pytest.raises(RecordingError, match=r"times\.csv.*file,time_s"):
        open_recording(folder(tmp_path, "0,0,0,0,1,0,0,0\n1,0,0,0,1,0,0,0\n"))


def test_one_bad_time_costs_one_image(tmp_path):
    poses = "0,0,0,0,1,0,0,0\n0.1,0,0,0,1,0,0,0\n"
    items = list(open_recording(folder(tmp_path, poses, "a.png,0.05\nb.png,noon\n")).items())
    assert [type(item) is BadFrame for item in items] == [False, True, True]
    assert all("times.csv" in item.reason for item in items[1:])
