import pickle

import pytest
from recording_bytes import PIXELS, png, recording, row

from deckline.recording import BadFrame, FrameError, RecordingError, open_recording
from deckline.types import Frame

IMAGE = "img_Drone_0_0_1000000.png"


def test_the_record_file_itself_opens_its_folder(tmp_path):
    folder = recording(tmp_path / "rec", [row(1)], {"img_Drone_0_0_1.png": png(PIXELS)})
    assert open_recording(folder / "airsim_rec.txt").load(0).file == "img_Drone_0_0_1.png"
    assert open_recording(str(folder)).name == str(folder)


def test_folder_that_is_nothing_known(tmp_path):
    with pytest.raises(RecordingError, match=r"zero frames: neither airsim_rec.txt nor images"):
        open_recording(tmp_path)


def test_folder_of_recordings_points_to_one(tmp_path):
    recording(tmp_path / "2024-07-01", [row(1)], {})
    with pytest.raises(RecordingError, match=r"did you mean .*2024-07-01"):
        open_recording(tmp_path)


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
        open_recording(folder, **options)


def test_airsim_recording_takes_no_poses_file(tmp_path):
    folder = recording(tmp_path / "rec", [row(1)], {})
    poses = tmp_path / "p.csv"
    poses.write_text("file,time_s,x_m,y_m,z_m,qw,qx,qy,qz\na,0,0,0,0,1,0,0,0\n")
    with pytest.raises(RecordingError, match=r"has its poses in airsim_rec.txt"):
        open_recording(folder, poses_file=poses)


def test_missing_path(tmp_path):
    with pytest.raises(RecordingError, match="there is no such file or folder"):
        open_recording(tmp_path / "nothing")


def test_sources_and_errors_travel_between_processes(tmp_path):
    folder = recording(tmp_path / "rec", [row(1), row(2)], {"img_Drone_0_0_1.png": png(PIXELS)})
    source = pickle.loads(pickle.dumps(open_recording(folder)))
    assert source.load(0).file == "img_Drone_0_0_1.png"
    error = pickle.loads(pickle.dumps(FrameError("a.png", "torn")))
    assert (str(error), error.file) == ("a.png: torn", "a.png")


def test_iterating_gives_frames_alone_and_tells_of_damaged_ones(tmp_path, capsys):
    skipped = []
    folder = recording(tmp_path / "rec", [row(1_000_000), row(2_000_000)], {IMAGE: png(PIXELS)})
    assert [frame.file for frame in open_recording(folder, on_skip=skipped.append)] == [IMAGE]
    assert [bad.file for bad in skipped] == [row(2_000_000).rpartition("\t")[2]]
    assert capsys.readouterr().err == ""
    source = open_recording(folder)
    assert [type(item) for item in source.items()] == [Frame, BadFrame]
    assert [type(item) for item in source] == [Frame]
    assert capsys.readouterr().err == f"skipped {skipped[0].file}: {skipped[0].reason}\n"
