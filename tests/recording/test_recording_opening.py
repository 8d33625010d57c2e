import pickle

import pytest
from recording_bytes import PIXELS, png, recording, row

from deckline.recording import FrameError, RecordingError, open_source


def test_the_record_file_itself_opens_its_folder(tmp_path):
    folder = recording(tmp_path / "rec", [row(1)], {"img_Drone_0_0_1.png": png(PIXELS)})
    assert open_source(folder / "airsim_rec.txt").load(0).file == "img_Drone_0_0_1.png"
    assert open_source(str(folder)).name == str(folder)


def test_folder_that_is_nothing_known(tmp_path):
    with pytest.raises(RecordingError, match=r"zero frames: neither airsim_rec.txt nor images"):
        open_source(tmp_path)


def test_folder_of_recordings_points_to_one(tmp_path):
    recording(tmp_path / "2024-07-01", [row(1)], {})
    with pytest.raises(RecordingError, match=r"did you mean .*2024-07-01"):
        open_source(tmp_path)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"pfm_rows": "upside-down"}, "pfm_rows must be"),
        ({"fov_deg": 180.0}, "fov_deg must lie between 0 and 180"),
        ({"deck_z_m": float("nan")}, "deck_z_m must be a finite number"),
        ({"sea_z_m": float("inf")}, "sea_z_m must be a finite number"),
        ({"far_m": 0.0}, "far_m must be > 0"),
        ({"camera_file": "/nowhere/camera.toml"}, "cannot be read"),
    ],
)
def test_wrong_options_say_what_is_wrong(tmp_path, options, text):
    folder = recording(tmp_path / "rec", [row(1)], {})
    with pytest.raises(RecordingError, match=text):
        open_source(folder, **options)


def test_airsim_recording_takes_no_poses_file(tmp_path):
    folder = recording(tmp_path / "rec", [row(1)], {})
    poses = tmp_path / "p.csv"
    poses.write_text("file,time_s,x_m,y_m,z_m,qw,qx,qy,qz\na,0,0,0,0,1,0,0,0\n")
    with pytest.raises(RecordingError, match=r"has its poses in airsim_rec.txt"):
        open_source(folder, poses_file=poses)


def test_missing_path(tmp_path):
    with pytest.raises(RecordingError, match="there is no such file or folder"):
        open_source(tmp_path / "nothing")


def test_sources_and_errors_travel_between_processes(tmp_path):
    folder = recording(tmp_path / "rec", [row(1), row(2)], {"img_Drone_0_0_1.png": png(PIXELS)})
    source = pickle.loads(pickle.dumps(open_source(folder)))
    assert source.load(0).file == "img_Drone_0_0_1.png"
    error = pickle.loads(pickle.dumps(FrameError("a.png", "torn")))
    assert (str(error), error.file) == ("a.png: torn", "a.png")
