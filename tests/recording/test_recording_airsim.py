import json

import numpy as np
import pytest
from recording_bytes import CAMERA, HEADER, PIXELS, pfm, png, recording, row

from deckline.geometry import Camera
from deckline.recording import BadFrame, FrameError, RecordingError, open_recording

IMAGE, OTHER = "img_Drone_0_0_1000000.png", "img_Drone_0_0_2000000.png"
PLANAR, PERSPECTIVE = "img_Drone_0_1_1000000.pfm", "img_Drone_0_2_1000000.pfm"
DEPTH = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
PICTURE = {IMAGE: png(PIXELS)}


def only(tmp_path, line, files=PICTURE, header=HEADER, **options):
    """The frame of a recording of one row."""
    return open_recording(recording(tmp_path / "rec", [line], files, header), **options).load(0)


def depth(tmp_path, files, types="01", **options):
    """Depth of the one frame of a recording with these files beside its picture."""
    return only(tmp_path, row(1_000_000, types=types), PICTURE | files, **options).depth_m


def test_frame_of_airsims_own_files(tmp_path):
    frame = only(tmp_path, row(1_000_000))
    np.testing.assert_array_equal(frame.image_rgb, PIXELS)
    assert frame.file == IMAGE
    assert (frame.depth_m, frame.truth, frame.deck_z_m) == (None, None, None)
    assert frame.camera.__dict__ == Camera.from_fov(3, 2, np.pi / 2).__dict__  # AirSim's default


@pytest.mark.parametrize("ms", ["1720000000123", "1720000000123.456", "1720000000123.457"])
def test_time_stamp_is_milliseconds_and_keeps_its_fraction(tmp_path, ms):
    assert only(tmp_path, row(1_000_000, ms=ms)).time_s == pytest.approx(float(ms) / 1000, rel=0, abs=3e-7)


@pytest.mark.parametrize("length", [1.0, 0.991])  # nearly unit length: normalised
def test_quaternion_is_scalar_first_and_position_north_east_down(tmp_path, length):
    half = length * 0.5**0.5
    frame = only(tmp_path, row(1_000_000, pose=f"1\t2\t-3\t{half}\t0\t0\t{half}"))  # nose turned to the east
    np.testing.assert_allclose(frame.world_from_body.apply([10.0, 0.0, 0.0]), [1.0, 12.0, -3.0], atol=1e-9)


def test_pose_is_the_vehicles_and_the_camera_sits_elsewhere(tmp_path):
    camera = tmp_path / "mounted.toml"
    camera.write_text(CAMERA + "[body_from_camera]\ntranslation_m = [5, 0, 1]\n")
    frame = only(tmp_path, row(1_000_000), camera_file=camera)
    np.testing.assert_allclose(frame.world_from_body.apply([0.0, 0.0, 0.0]), [1.0, 2.0, -3.0])
    np.testing.assert_allclose(frame.world_from_camera.apply([0.0, 0.0, 0.0]), [6.0, 2.0, -2.0])


CAR = "Throttle\tSteering\tBrake\tGear\tHandbrake\tRPM\tSpeed"


@pytest.mark.parametrize(
    ("header", "line", "notes"),
    [
        (
            "ImageFile\tQ_Z\tQ_Y\tQ_X\tQ_W\tPOS_Z\tPOS_Y\tPOS_X\tTimeStamp",  # no VehicleName, all turned round
            f"{IMAGE}\t0\t0\t0\t1\t-3\t2\t1\t1",
            [],
        ),
        (
            HEADER.replace("ImageFile", CAR + "\tImageFile"),
            row(1_000_000).replace("img_", "0.5\t0\t0\t1\t0\t3000\t12\timg_", 1),
            [],
        ),
        (
            HEADER.replace("POS_X", "Wind\tPOS_X"),
            row(1_000_000).replace("\t1\t2\t-3", "\t99\t1\t2\t-3"),
            ["airsim_rec.txt line 1: unknown column Wind ignored"],
        ),
    ],
)
def test_columns_are_found_by_their_names_and_unknown_ones_noted(tmp_path, header, line, notes):
    source = open_recording(recording(tmp_path / "rec", [line], PICTURE, header))
    *odd, camera = (note.rpartition("/")[2] for note in source.notes)
    assert (odd, camera) == (notes, "rec: camera AirSim's default, without --fov-deg: 90 degrees across")
    frame = source.load(0)
    assert (frame.file, frame.time_s) == (IMAGE, 0.001)
    np.testing.assert_allclose(frame.world_from_body.translation, [1.0, 2.0, -3.0])
    text = (tmp_path / "rec" / "airsim_rec.txt").read_text()
    (tmp_path / "rec" / "airsim_rec.txt").write_bytes(text.replace("\n", "\r\n\r\n").encode())  # Windows, blank lines
    assert [frame.file for frame in open_recording(tmp_path / "rec")] == [IMAGE]


def test_joined_names_give_image_and_depth_of_the_same_camera(tmp_path):
    names = "img_Drone_low_0_7.png;img_Drone_high_1_7.pfm;img_Drone_low_5_7.png;img_Drone_low_1_7.pfm"
    files = {"img_Drone_low_0_7.png": png(PIXELS), "img_Drone_low_1_7.pfm": pfm(DEPTH)}
    frame = only(tmp_path, row(7).replace("img_Drone_0_0_7.png", names), files)
    assert frame.file == "img_Drone_low_0_7.png"
    assert frame.depth_m.tolist() == DEPTH  # AirSim's first row is the top one
    name = "img_My_Drone_2_front_center_0_1_0_99.ppm"  # vehicle and camera may hold underscores and digits
    files = {name: b"P6\n3 2\n255\n" + PIXELS.tobytes()}
    frame = only(tmp_path / "ppm", row(99).replace("img_Drone_0_0_99.png", name), files)
    np.testing.assert_array_equal(frame.image_rgb, PIXELS)


@pytest.mark.parametrize(
    ("types", "options", "expected"), [("021", {}, DEPTH), ("01", {"pfm_rows": "bottom-to-top"}, DEPTH[::-1])]
)
def test_planar_depth_goes_first_and_its_rows_are_turned_when_told(tmp_path, types, options, expected):
    assert depth(tmp_path, {PLANAR: pfm(DEPTH)}, types, **options).tolist() == expected


@pytest.mark.parametrize(
    ("stored", "options", "known"),
    [
        ([[65504.0, 65503.0, np.inf], [0.0, -1.0, np.nan]], {}, [[False, True, False], [False, False, False]]),
        (DEPTH, {"far_m": 4.0}, [[True, True, True], [False, False, False]]),
    ],
)
def test_far_value_and_what_is_no_distance_become_nan(tmp_path, stored, options, known):
    np.testing.assert_array_equal(np.isfinite(depth(tmp_path, {PLANAR: pfm(stored)}, **options)), known)


def test_perspective_depth_is_brought_to_the_axis_and_its_far_value_judged_as_stored(tmp_path):
    camera = Camera(3, 2, 4.0, 5.0, 1.0, 0.5)
    (tmp_path / "c.toml").write_text(CAMERA)
    axis = np.array([[10.0, 20.0, 30.0], [40.0, 50.0, 60.0]])
    u, v = np.meshgrid([0.0, 1.0, 2.0], [0.0, 1.0])
    ranges = axis * np.sqrt(1 + ((u - camera.cx) / camera.fx) ** 2 + ((v - camera.cy) / camera.fy) ** 2)
    found = depth(tmp_path, {PERSPECTIVE: pfm(ranges.tolist())}, "02", camera_file=tmp_path / "c.toml")
    np.testing.assert_allclose(found, axis, rtol=1e-6)
    assert np.isnan(depth(tmp_path / "far", {PERSPECTIVE: pfm([[65504.0] * 3] * 2)}, "02")).all()


def test_cut_png_in_the_middle_is_skipped_and_named(tmp_path):
    whole, third = png(PIXELS), "img_Drone_0_0_3000000.png"
    files = {IMAGE: whole, OTHER: whole[:-20], third: whole}
    source = open_recording(recording(tmp_path / "rec", [row(n * 1_000_000) for n in (1, 2, 3)], files))
    items = list(source.items())
    assert [item.file for item in items] == [IMAGE, OTHER, third]
    assert [isinstance(item, BadFrame) for item in items] == [False, True, False]
    with pytest.raises(FrameError, match=r"cut short.*airsim_rec.txt line 3") as error:
        source.load(1)
    assert error.value.file == OTHER
    with pytest.raises(IndexError, match="3"):
        source.load(3)


LEAVING = "img_../../../etc_0_0_1.png"


@pytest.mark.parametrize(
    ("line", "files", "text"),
    [
        (row(1_000_000, pose="1\t2\t3\t0\t0\t0\t0"), PICTURE, "quaternion.* \\(airsim_rec.txt line 2\\)"),
        (row(1_000_000, pose="1\t2\t3\tnan\t0\t0\t0"), PICTURE, "quaternion.*nan.*line 2"),
        (row(1_000_000, pose="1\t2\t3\t0.3\t0.3\t0.3\t0"), PICTURE, "quaternion.*0\\.52.*line 2"),
        (row(1_000_000, pose="1\tinf\t3\t1\t0\t0\t0"), PICTURE, "position.*inf.*line 2"),
        (row(1_000_000, pose="1\ttwo\t3\t1\t0\t0\t0"), PICTURE, "POS_Y.*'two'.*line 2"),
        ("Drone\t1\t2", {}, "airsim_rec.txt line 2.*ImageFile"),
        (row(1).replace("img_Drone_0_0_1.png", LEAVING), {}, f"ImageFile.*{LEAVING}"),
        (row(1_000_000), {}, IMAGE),
        (row(1_000_000, types="01"), PICTURE, f"depth.*{PLANAR}"),
        (row(1_000_000, types="01"), PICTURE | {PLANAR: pfm([[1.0, 2.0]])}, f"{PLANAR}.* 2x1 .* 3x2 "),
        (row(1_000_000).replace(IMAGE, f"{IMAGE};{PLANAR[:-4]}.png"), PICTURE, f"{PLANAR[:-4]}.png.*PixelsAsFloat"),
    ],
)
def test_bad_row_costs_one_frame_and_says_what_and_where(tmp_path, line, files, text):
    (item,) = open_recording(recording(tmp_path / "rec", [line], files)).items()
    assert isinstance(item, BadFrame)
    assert "\n" not in item.reason
    with pytest.raises(FrameError, match=text):
        raise FrameError(item.file, item.reason)


def test_intrinsics_for_another_resolution(tmp_path):
    (tmp_path / "c.toml").write_text(CAMERA.replace("width = 3", "width = 1280"))
    with pytest.raises(FrameError, match=r" 1280x2 .* 3x2 "):
        only(tmp_path, row(1_000_000), camera_file=tmp_path / "c.toml")


@pytest.mark.parametrize(
    ("header", "text"), [(HEADER.replace("Q_W", "QW"), "Q_W"), (HEADER.replace("\t", " "), "TimeStamp, POS_X")]
)
def test_record_file_without_its_columns_is_named(tmp_path, header, text):
    (tmp_path / "airsim_rec.txt").write_text(header + "\n")
    with pytest.raises(RecordingError, match=rf"airsim_rec\.txt.*{text}"):
        open_recording(tmp_path)


def test_second_vehicle_is_left_out_and_said(tmp_path):
    rows = [row(1_000_000), row(2_000_000).replace("Drone\t", "Boat\t", 1)]
    source = open_recording(recording(tmp_path / "rec", rows, PICTURE))
    assert len(source) == 1
    assert "1 rows of vehicles other than 'Drone'" in source.notes[0]


def scene(**values):
    camera = {"width": 3, "height": 2, "fx": 7.0, "fy": 7.0, "cx": 1.0, "cy": 0.5}
    return json.dumps({"format": "deckline-scene", "version": 1, "camera": camera, **values})


def test_camera_is_the_given_one_else_the_scenes_else_the_one_beside_else_90_degrees(tmp_path):
    folder = recording(tmp_path / "rec", [row(1_000_000)], PICTURE)
    assert open_recording(folder, fov_deg=2 * np.degrees(np.arctan(0.5))).load(0).camera.fx == pytest.approx(3.0)
    (folder / "camera.toml").write_text(CAMERA)
    assert open_recording(folder).load(0).camera.fx == 4.0
    (folder / "scene.json").write_text(scene())
    assert open_recording(folder).load(0).camera.fx == 7.0
    own = {"width": 3, "height": 2, "fx": 8.0, "fy": 8.0, "cx": 1.0, "cy": 0.5}
    (folder / "scene.json").write_text(scene(frames={IMAGE: {"camera": own}}))
    assert open_recording(folder).load(0).camera.fx == 8.0
    (tmp_path / "given.toml").write_text(CAMERA.replace("4.0", "9.0"))
    assert open_recording(folder, camera_file=tmp_path / "given.toml").load(0).camera.fx == 9.0


def test_scene_gives_deck_and_truth_and_the_caller_may_overrule_the_deck(tmp_path):
    truth = {"left": {"p0_m": [1, 2, 3], "p1_m": [4, 5, 6]}, "right": None, "visibility_m": 900}
    folder = recording(tmp_path / "rec", [row(1_000_000)], PICTURE)
    (folder / "scene.json").write_text(scene(frames={IMAGE: {"deck_z_m": -17.5, "sea_z_m": 2.5, "truth": truth}}))
    frame = open_recording(folder).load(0)
    assert (frame.deck_z_m, frame.sea_z_m) == (-17.5, 2.5)
    assert frame.truth.left.p1_m.tolist() == [4.0, 5.0, 6.0]
    assert frame.truth.right is None
    assert frame.truth.visibility_m == 900.0
    overruled = open_recording(folder, deck_z_m=-20.0, sea_z_m=0.0).load(0)
    assert (overruled.deck_z_m, overruled.sea_z_m) == (-20.0, 0.0)


@pytest.mark.parametrize(
    ("frames", "text"),
    [
        ({IMAGE: {"deck_z_m": "high"}}, "deck_z_m.*'high'"),
        ({IMAGE: {"sea_z_m": "low"}}, "sea_z_m.*'low'"),
        ({IMAGE: {"truth": {"clear_image": "../x.png"}}}, r"clear_image.*'\.\./x\.png'"),
        ({IMAGE: {"truth": {"clear_image": "clear/x.png"}}}, r"clear/x\.png"),
        ({IMAGE: {"camera": {"width": 3}}}, "scene.json: camera: height"),
        ({IMAGE: {"time_s": None}}, "time_s.*None"),
        ({}, "scene.json has no entry"),
    ],
)
def test_bad_or_missing_scene_entry_costs_one_frame(tmp_path, frames, text):
    folder = recording(tmp_path / "rec", [row(1_000_000)], PICTURE)
    (folder / "scene.json").write_text(scene(frames=frames))
    with pytest.raises(FrameError, match=text):
        open_recording(folder).load(0)
