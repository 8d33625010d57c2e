import pickle
import re

import numpy as np
import pytest
from bag_files import rows, write
from recording_bytes import CAMERA, PIXELS, images, pfm, png, recording, row
from scipy.spatial.transform import Rotation

from deckline.config import Navigation
from deckline.geometry import Camera, camera_mount
from deckline.recording import BadFrame, FrameError, RecordingError, open_recording
from deckline.types import NO_CAMERA, Frame

IMAGE = "img_Drone_0_0_1000000.png"
POSES = "file,time_s,x_m,y_m,z_m,qw,qx,qy,qz\n"


def test_the_record_file_itself_opens_its_folder(tmp_path):
    folder = recording(tmp_path / "rec", [row(1)], {"img_Drone_0_0_1.png": png(PIXELS)})
    assert open_recording(folder / "airsim_rec.txt").load(0).file == "img_Drone_0_0_1.png"
    assert open_recording(str(folder)).name == str(folder)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"pfm_rows": "upside-down"}, "pfm_rows.*upside-down"),
        ({"fov_deg": 0.5}, "fov_deg.*0.5"),
        ({"fov_deg": 171.0}, "fov_deg.*171"),
        ({"fov_deg": float("nan")}, "fov_deg.*nan"),
        ({"deck_z_m": float("nan")}, "deck_z_m.*nan"),
        ({"sea_z_m": float("inf")}, "sea_z_m.*inf"),
        ({"far_m": 0.0}, "far_m.*0"),
        ({"camera_file": "/nowhere/camera.toml"}, r"/nowhere/camera\.toml"),
        ({"poses_file": "/nowhere/p.csv"}, r"airsim_rec\.txt.*/nowhere/p\.csv"),
    ],
)
def test_wrong_options_say_what_is_wrong(tmp_path, options, text):
    folder = recording(tmp_path / "rec", [row(1)], {})
    with pytest.raises(ValueError, match=text):
        open_recording(folder, **options)


@pytest.mark.parametrize(
    ("path", "text"), [("nothing", "nothing"), ("2024-07-01/images", "airsim_rec.txt"), ("", "07-01")]
)
def test_paths_without_frames_are_named(tmp_path, path, text):
    recording(tmp_path / "2024-07-01", [row(1)], {})
    with pytest.raises(RecordingError, match=text):
        open_recording(tmp_path / path)


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


def test_images_come_in_natural_order_one_second_apart(tmp_path):
    images(tmp_path, ["f10.webp", "f9.png", "f09.png", "F1.PNG", ".hidden.png"])
    (tmp_path / "notes.txt").write_text("")
    source = open_recording(tmp_path)
    files = ["F1.PNG", "f09.png", "f9.png", "f10.webp"]
    assert [(item.file, item.time_s) for item in source] == [(file, float(n)) for n, file in enumerate(files)]
    assert source.load(0).world_from_body is None
    assert "no poses.csv" in source.notes[0]


def test_poses_are_read_by_header_in_any_order(tmp_path):
    poses = "qz,qy,qx,qw,z_m,y_m,x_m,file,time_s,wind\n0,0,0,1,-3,2,1,a.png,12.5,9\n"
    source = open_recording(images(tmp_path, ["a.png"], poses=poses))
    frame = source.load(0)
    assert frame.time_s == 12.5
    np.testing.assert_allclose(frame.world_from_body.translation, [1.0, 2.0, -3.0])
    assert "unknown column wind ignored" in source.notes[0]


ANGLES = Rotation.from_euler("ZYX", [100.0, -5.0, 20.0], degrees=True)  # yaw, pitch, roll


@pytest.mark.parametrize("by_time", [False, True])
@pytest.mark.parametrize("unit", [("deg", 1.0), ("rad", np.pi / 180)])
def test_attitudes_may_be_roll_pitch_and_yaw(tmp_path, unit, by_time):
    name, size = unit
    header = f"{'' if by_time else 'file,'}time_s,x_m,y_m,z_m,roll_{name},pitch_{name},yaw_{name}\n"
    angles = ",".join(repr(angle * size) for angle in (20.0, -5.0, 100.0))
    rows = f"{'' if by_time else 'a.png,'}1,0,0,-30,{angles}\n"
    images(tmp_path, ["a.png"], poses=header + rows + (rows.replace("1,", "1.4,", 1) if by_time else ""))
    if by_time:
        (tmp_path / "times.csv").write_text("file,time_s\na.png,1.2\n")
    found = open_recording(tmp_path).load(0).world_from_body.rotation
    assert (found.inv() * ANGLES).magnitude() == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("names", ["lat,lon,alt", "latitude,longitude,altitude", "lat_deg,lon_deg,alt_m"])
def test_images_may_have_latitude_and_longitude(tmp_path, names):
    rows = "a.png,1,60,8,10,1,0,0,0\nb.png,2,60,8.001,30,1,0,0,0\n"
    folder = images(tmp_path, ["a.png", "b.png"], poses=f"file,time_s,{names},qw,qx,qy,qz\n" + rows)
    source = open_recording(folder)
    assert "--origin 60.0000000 8.0000000 10.00" in source.notes[0]
    second = source.load(1).world_from_body
    np.testing.assert_allclose(second.translation, [0.0, 55.8, -20.0], atol=0.05)  # a radius of 3,197 km at 60 degrees
    assert second.rotation.as_euler("ZYX", degrees=True)[0] == pytest.approx(-0.001 * np.sin(np.deg2rad(60.0)))
    given = open_recording(folder, navigation=Navigation(origin=(60.0, 8.001, 0.0)))
    np.testing.assert_allclose(given.load(1).world_from_body.translation, [0.0, 0.0, -30.0], atol=1e-6)


def test_a_field_of_view_stands_for_a_camera_file(tmp_path):
    source = open_recording(images(tmp_path, ["a.png"], camera=""), fov_deg=60.0, deck_z_m=-17.0)
    frame = source.load(0)
    assert frame.camera == Camera.from_fov(3, 2, np.pi / 3)
    assert (frame.deck_z_m, frame.camera.known) == (-17.0, True)
    np.testing.assert_array_equal(frame.body_from_camera.as_matrix(), camera_mount().as_matrix())
    assert "camera stated by --fov-deg: 60.0 degrees" in source.notes[-1]


@pytest.mark.parametrize("layout", ["images", "airsim", "bag"])
def test_a_field_of_view_must_not_contradict_the_camera(tmp_path, layout):
    if layout == "airsim":
        folder = recording(tmp_path / "rec", [row(1_000_000)], {IMAGE: png(PIXELS)})
        (folder / "camera.toml").write_text(CAMERA)
    else:
        folder = images(tmp_path, ["a.png"]) if layout == "images" else write(tmp_path / "a", "mcap", rows())
    camera = open_recording(folder).load(0).camera
    fov_deg = np.rad2deg(2 * np.arctan(camera.width / 2 / camera.fx))
    assert open_recording(folder, fov_deg=round(fov_deg)).load(0).camera.fx == camera.fx
    with pytest.raises(RecordingError, match=rf"{fov_deg:.1f}.*99"):
        open_recording(folder, fov_deg=99.0)


def test_single_image(tmp_path):
    folder = images(tmp_path, ["a.png", "b.png"], poses=POSES + "a.png,1,0,0,0,1,0,0,0\nb.png,2,7,0,0,1,0,0,0\n")
    source = open_recording(folder / "b.png", deck_z_m=-17.0)
    (frame,) = source
    assert (frame.file, frame.time_s, frame.deck_z_m, source.name) == ("b.png", 2.0, -17.0, str(folder / "b.png"))
    np.testing.assert_array_equal(frame.world_from_body.translation, [7.0, 0.0, 0.0])
    (tmp_path / "c.toml").write_text(CAMERA.replace("4.0", "6.0"))
    assert open_recording(folder / "b.png", camera_file=tmp_path / "c.toml").load(0).camera.fx == 6.0
    (folder / "b.png.camera.toml").write_text(CAMERA.replace("4.0", "8.0"))
    assert open_recording(folder / "b.png").load(0).camera.fx == 8.0


def test_given_files_replace_those_beside(tmp_path):
    folder = images(tmp_path, ["a.png"], poses=POSES + "a.png,1,0,0,0,1,0,0,0\n")
    (tmp_path / "other.csv").write_text(POSES + "a.png,2,0,0,0,1,0,0,0\n")
    (tmp_path / "other.toml").write_text(CAMERA.replace("4.0", "6.0"))
    frame = open_recording(folder, poses_file=tmp_path / "other.csv", camera_file=tmp_path / "other.toml").load(0)
    assert (frame.time_s, frame.camera.fx) == (2.0, 6.0)


def test_depth_lies_beside_by_stem(tmp_path):
    images(tmp_path, ["a.png", "b.png"])
    (tmp_path / "depth").mkdir()
    (tmp_path / "depth" / "b.pfm").write_bytes(pfm([[1, 2, 65504], [3, 4, 5]]))
    without, frame = open_recording(tmp_path)
    assert without.depth_m is None
    np.testing.assert_array_equal(frame.depth_m, [[1, 2, np.nan], [3, 4, 5]])


@pytest.mark.parametrize(
    ("poses", "file", "text"),
    [
        ("", "b.png", "poses.csv has no row"),
        ("b.png,0,0,0,0,0,0,0,0\n", "b.png", "line 3: quaternion"),
        ("b.png,0,0,0,0,nan,0,0,0\n", "b.png", "line 3: quaternion"),
        ("b.png,0,0,0,0,.3,.3,.3,0\n", "b.png", "0.52"),
        ("b.png,nan,0,0,0,1,0,0,0\n", "b.png", "line 3: time_s"),
        ("b.png,0,0\n", "b.png", "line 3: column y_m"),
        ("b.png,0,0,0,0,1,0,0,0\nc.png,0,0,0,0,1,0,0,0\n", "c.png", "image is missing"),
        ("b.png,0,0,0,0,1,0,0,0\n../c.png,0,0,0,0,1,0,0,0\n", "../c.png", "inside the folder"),
    ],
)
def test_one_bad_image_or_row_costs_one_frame(tmp_path, poses, file, text):
    poses = POSES + "a.png,0,0,0,0,1,0,0,0\n" + poses
    items = list(open_recording(images(tmp_path, ["a.png", "b.png"], poses=poses)).items())
    (bad,) = (item for item in items if isinstance(item, BadFrame))
    assert bad.file == file
    assert text in bad.reason


def test_sizes_must_agree(tmp_path):
    images(tmp_path, ["a.png"])
    (tmp_path / "b.png").write_bytes(png(PIXELS[:1]))
    (tmp_path / "depth").mkdir()
    (tmp_path / "depth" / "a.pfm").write_bytes(pfm([[1, 2]]))
    depth, size = open_recording(tmp_path).items()
    assert all(text in depth.reason for text in ("depth/a.pfm", "2x1", "3x2"))
    assert all(text in size.reason for text in ("3x2", "3x1"))


def test_attitudes_without_positions_are_no_pose_but_a_level(tmp_path):
    poses = "file,time_s,roll_deg,pitch_deg,yaw_deg\na.png,0,4,-3,120\nb.png,1,,,\n"
    tilted, unknown = open_recording(images(tmp_path, ["a.png", "b.png"], poses=poses))
    assert tilted.world_from_body is None and unknown.world_from_body is None
    np.testing.assert_allclose(tilted.level_from_body.as_euler("ZYX", degrees=True), [120.0, -3.0, 4.0])
    assert unknown.level_from_body is None


def test_attitudes_by_time_are_interpolated_without_positions(tmp_path):
    folder = images(tmp_path, ["a.png"], poses="time_s,roll_rad,pitch_rad,yaw_rad\n0,0,0,0\n1,0.2,0,0\n")
    (folder / "times.csv").write_text("file,time_s\na.png,0.5\n")
    (frame,) = open_recording(folder, navigation=Navigation(max_gap_s=2.0))
    assert frame.world_from_body is None
    np.testing.assert_allclose(frame.level_from_body.as_rotvec(), [0.1, 0.0, 0.0])


def test_a_poses_file_that_cannot_be_used_is_named(tmp_path):
    with pytest.raises(RecordingError, match=r"poses\.csv.*qw.*roll_deg"):
        open_recording(images(tmp_path, ["a.png"], poses=POSES.replace("qw", "w")))


def test_images_without_a_camera_file_may_have_any_size_and_have_no_pose(tmp_path):
    poses = POSES + "a.png,7,0,0,0,1,0,0,0\nb.png,8,0,0,0,1,0,0,0\n"
    source = open_recording(images(tmp_path, ["a.png"], camera="", poses=poses), deck_z_m=-17.0)
    (tmp_path / "b.png").write_bytes(png(PIXELS[:1]))
    frames = list(source)
    assert [(frame.camera.width, frame.camera.height, frame.time_s) for frame in frames] == [(3, 2, 7.0), (3, 1, 8.0)]
    assert {frame.missing for frame in frames} == {NO_CAMERA}
    assert all((frame.world_from_body, frame.deck_z_m) == (None, None) for frame in frames)
    assert re.search(r"camera assumed: 65 degrees across.* write .*camera\.toml: width", source.notes[-1])
