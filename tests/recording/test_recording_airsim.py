import json

import numpy as np
import pytest
from recording_bytes import CAMERA, HEADER, PIXELS, pfm, png, recording, row

from deckline.geometry import Camera
from deckline.recording import BadFrame, FrameError, RecordingError, open_recording

IMAGE, OTHER = "img_Drone_0_0_1000000.png", "img_Drone_0_0_2000000.png"
DEPTH = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]


def only(tmp_path, line, files, **options):
    """The frame of a recording of one row."""
    return open_recording(recording(tmp_path / "rec", [line], files), **options).load(0)


def reason(tmp_path, line, files, **options):
    """Why the one row of a recording is skipped."""
    items = list(open_recording(recording(tmp_path / "rec", [line], files), **options).items())
    assert len(items) == 1
    assert isinstance(items[0], BadFrame)
    assert "\n" not in items[0].reason
    return f"{items[0].file}: {items[0].reason}"


def test_frame_of_airsims_own_files(tmp_path):
    frame = only(tmp_path, row(1_000_000), {IMAGE: png(PIXELS)})
    np.testing.assert_array_equal(frame.image_rgb, PIXELS)
    assert frame.file == IMAGE
    assert frame.depth_m is None
    assert frame.truth is None
    assert frame.deck_z_m is None
    camera = Camera.from_fov(3, 2, np.pi / 2)  # AirSim's default
    assert frame.camera.__dict__ == camera.__dict__


def test_time_stamp_is_milliseconds(tmp_path):
    frame = only(tmp_path, row(1_000_000, ms=1720000000123), {IMAGE: png(PIXELS)})
    assert frame.time_s == 1720000000.123


@pytest.mark.parametrize("ms", ["1720000000123.456", "1720000000123.457"])
def test_fractions_of_milliseconds_are_kept(tmp_path, ms):
    line = row(1_000_000, ms=ms)
    assert only(tmp_path, line, {IMAGE: png(PIXELS)}).time_s == pytest.approx(float(ms) / 1000, abs=5e-7)


def test_nearly_unit_quaternion_is_normalised(tmp_path):
    frame = only(tmp_path, row(1_000_000, pose="0\t0\t0\t0.991\t0\t0\t0"), {IMAGE: png(PIXELS)})
    np.testing.assert_array_equal(frame.world_from_body.as_matrix(), np.eye(4))


def test_quaternion_is_scalar_first_and_position_north_east_down(tmp_path):
    half = 0.5**0.5
    pose = f"1\t2\t-3\t{half}\t0\t0\t{half}"  # nose turned to the east
    frame = only(tmp_path, row(1_000_000, pose=pose), {IMAGE: png(PIXELS)})
    np.testing.assert_allclose(frame.world_from_body.apply([10.0, 0.0, 0.0]), [1.0, 12.0, -3.0], atol=1e-9)


def test_pose_is_the_vehicles_and_the_camera_sits_elsewhere(tmp_path):
    camera = tmp_path / "mounted.toml"
    camera.write_text(CAMERA + "[body_from_camera]\ntranslation_m = [5, 0, 1]\n")
    frame = only(tmp_path, row(1_000_000), {IMAGE: png(PIXELS)}, camera_file=camera)
    np.testing.assert_allclose(frame.world_from_body.apply([0.0, 0.0, 0.0]), [1.0, 2.0, -3.0])
    np.testing.assert_allclose(frame.world_from_camera.apply([0.0, 0.0, 0.0]), [6.0, 2.0, -2.0])


def test_columns_are_found_by_their_names(tmp_path):
    header = "ImageFile\tQ_Z\tQ_Y\tQ_X\tQ_W\tPOS_Z\tPOS_Y\tPOS_X\tTimeStamp"  # no VehicleName, all turned round
    line = f"{IMAGE}\t0\t0\t0\t1\t-3\t2\t1\t1500"
    source = open_recording(recording(tmp_path / "rec", [line], {IMAGE: png(PIXELS)}, header))
    frame = source.load(0)
    assert source.notes == ()
    assert frame.time_s == 1.5
    np.testing.assert_allclose(frame.world_from_body.translation, [1.0, 2.0, -3.0])


def test_columns_of_a_car_stand_before_imagefile(tmp_path):
    car = "Throttle\tSteering\tBrake\tGear\tHandbrake\tRPM\tSpeed"
    header = HEADER.replace("ImageFile", car + "\tImageFile")
    line = row(1_000_000).replace("img_", "0.5\t0\t0\t1\t0\t3000\t12\timg_", 1)
    source = open_recording(recording(tmp_path / "rec", [line], {IMAGE: png(PIXELS)}, header))
    assert source.notes == ()
    assert source.load(0).file == IMAGE


def test_unknown_column_is_named_and_reading_goes_on(tmp_path):
    header = HEADER.replace("POS_X", "Wind\tPOS_X")
    line = row(1_000_000).replace("\t1\t2\t-3", "\t99\t1\t2\t-3")
    source = open_recording(recording(tmp_path / "rec", [line], {IMAGE: png(PIXELS)}, header))
    assert len(source.notes) == 1
    assert "airsim_rec.txt line 1: unknown column Wind ignored" in source.notes[0]
    np.testing.assert_allclose(source.load(0).world_from_body.translation, [1.0, 2.0, -3.0])


def test_windows_line_ends_and_blank_lines(tmp_path):
    folder = recording(tmp_path / "rec", [], {IMAGE: png(PIXELS)})
    (folder / "airsim_rec.txt").write_bytes(f"{HEADER}\t\r\n\r\n{row(1_000_000)}\r\n".encode())
    assert [frame.file for frame in open_recording(folder)] == [IMAGE]


def test_joined_names_give_image_and_depth_of_the_same_camera(tmp_path):
    names = "img_Drone_low_0_7.png;img_Drone_high_1_7.pfm;img_Drone_low_5_7.png;img_Drone_low_1_7.pfm"
    line = row(7).replace("img_Drone_0_0_7.png", names)
    frame = only(
        tmp_path,
        line,
        {"img_Drone_low_0_7.png": png(PIXELS), "img_Drone_low_1_7.pfm": pfm(DEPTH)},
    )
    assert frame.file == "img_Drone_low_0_7.png"
    assert frame.depth_m.tolist() == DEPTH  # AirSim's first row is the top one


def test_names_of_vehicle_and_camera_may_hold_underscores_and_digits(tmp_path):
    name = "img_My_Drone_2_front_center_0_1_0_99.ppm"
    ppm = b"P6\n3 2\n255\n" + PIXELS.tobytes()
    frame = only(tmp_path, row(99).replace("img_Drone_0_0_99.png", name), {name: ppm})
    np.testing.assert_array_equal(frame.image_rgb, PIXELS)


def test_rows_of_standard_pfm_are_turned_when_told(tmp_path):
    files = {IMAGE: png(PIXELS), "img_Drone_0_1_1000000.pfm": pfm(DEPTH)}
    frame = only(tmp_path, row(1_000_000, types="01"), files, pfm_rows="bottom-to-top")
    assert frame.depth_m.tolist() == DEPTH[::-1]


def test_half_precision_far_value_and_what_is_no_distance_become_nan(tmp_path):
    stored = [[65504.0, 65503.0, np.inf], [0.0, -1.0, np.nan]]
    files = {IMAGE: png(PIXELS), "img_Drone_0_1_1000000.pfm": pfm(stored)}
    frame = only(tmp_path, row(1_000_000, types="01"), files)
    np.testing.assert_array_equal(np.isfinite(frame.depth_m), [[False, True, False], [False, False, False]])


def test_far_can_be_set(tmp_path):
    files = {IMAGE: png(PIXELS), "img_Drone_0_1_1000000.pfm": pfm(DEPTH)}
    frame = only(tmp_path, row(1_000_000, types="01"), files, far_m=4.0)
    np.testing.assert_array_equal(np.isfinite(frame.depth_m), [[True, True, True], [False, False, False]])


def test_perspective_depth_is_brought_to_the_axis(tmp_path):
    camera = Camera(3, 2, 4.0, 5.0, 1.0, 0.5)
    (tmp_path / "c.toml").write_text(CAMERA)
    axis = np.array([[10.0, 20.0, 30.0], [40.0, 50.0, 60.0]])
    u, v = np.meshgrid([0.0, 1.0, 2.0], [0.0, 1.0])
    ranges = axis * np.sqrt(1 + ((u - camera.cx) / camera.fx) ** 2 + ((v - camera.cy) / camera.fy) ** 2)
    files = {IMAGE: png(PIXELS), "img_Drone_0_2_1000000.pfm": pfm(ranges.tolist())}
    frame = only(tmp_path, row(1_000_000, types="02"), files, camera_file=tmp_path / "c.toml")
    np.testing.assert_allclose(frame.depth_m, axis, rtol=1e-6)


def test_far_value_of_perspective_depth_is_judged_as_stored(tmp_path):
    files = {IMAGE: png(PIXELS), "img_Drone_0_2_1000000.pfm": pfm([[65504.0] * 3] * 2)}
    assert np.isnan(only(tmp_path, row(1_000_000, types="02"), files).depth_m).all()


def test_planar_depth_is_preferred_to_perspective(tmp_path):
    files = {IMAGE: png(PIXELS), "img_Drone_0_1_1000000.pfm": pfm(DEPTH)}
    assert only(tmp_path, row(1_000_000, types="021"), files).depth_m.tolist() == DEPTH


def test_depth_stored_as_a_grey_picture_is_refused(tmp_path):
    line = row(1_000_000).replace(IMAGE, f"{IMAGE};img_Drone_0_1_1000000.png")
    text = reason(tmp_path, line, {IMAGE: png(PIXELS), "img_Drone_0_1_1000000.png": png(PIXELS)})
    assert "img_Drone_0_1_1000000.png is no float PFM file, its grey levels are no metres" in text
    assert "PixelsAsFloat" in text


def test_cut_png_in_the_middle_is_skipped_and_named(tmp_path):
    whole = png(PIXELS)
    third = "img_Drone_0_0_3000000.png"
    files = {IMAGE: whole, OTHER: whole[:-20], third: whole}
    items = list(open_recording(recording(tmp_path / "rec", [row(n * 1_000_000) for n in (1, 2, 3)], files)).items())
    assert [item.file for item in items] == [IMAGE, OTHER, third]
    assert [isinstance(item, BadFrame) for item in items] == [False, True, False]
    assert "cut short" in items[1].reason
    assert "airsim_rec.txt line 3" in items[1].reason


def test_load_raises_what_iterating_skips(tmp_path):
    source = open_recording(recording(tmp_path / "rec", [row(1_000_000)], {}))
    with pytest.raises(FrameError, match="image is missing") as error:
        source.load(0)
    assert error.value.file == IMAGE
    with pytest.raises(IndexError, match="has frames 0 to 0, asked for 1"):
        source.load(1)


@pytest.mark.parametrize(
    ("pose", "text"),
    [
        ("1\t2\t3\t0\t0\t0\t0", "quaternion has length 0"),
        ("1\t2\t3\tnan\t0\t0\t0", "quaternion is not finite"),
        ("1\t2\t3\t0.3\t0.3\t0.3\t0", "length 0.52"),
        ("1\tinf\t3\t1\t0\t0\t0", "position is not finite"),
        ("1\ttwo\t3\t1\t0\t0\t0", "column POS_Y is no number: 'two'"),
    ],
)
def test_bad_pose_says_what_and_where(tmp_path, pose, text):
    found = reason(tmp_path, row(1_000_000, pose=pose), {IMAGE: png(PIXELS)})
    assert text in found
    assert "airsim_rec.txt line 2" in found


def test_row_cut_short_names_its_line(tmp_path):
    assert "airsim_rec.txt line 2: no Scene image" in reason(tmp_path, "Drone\t1\t2", {})


def test_names_that_leave_the_folder_are_refused(tmp_path):
    name = "img_../../../etc_0_0_1.png"
    assert "no Scene image" in reason(tmp_path, row(1).replace("img_Drone_0_0_1.png", name), {})


def test_missing_depth_file_is_named(tmp_path):
    text = reason(tmp_path, row(1_000_000, types="01"), {IMAGE: png(PIXELS)})
    assert "depth map is missing" in text
    assert "img_Drone_0_1_1000000.pfm" in text


def test_depth_of_another_size(tmp_path):
    files = {IMAGE: png(PIXELS), "img_Drone_0_1_1000000.pfm": pfm([[1.0, 2.0]])}
    text = reason(tmp_path, row(1_000_000, types="01"), files)
    assert "depth img_Drone_0_1_1000000.pfm is 2x1 px but the image is 3x2 px" in text


def test_intrinsics_for_another_resolution(tmp_path):
    (tmp_path / "c.toml").write_text(CAMERA.replace("width = 3", "width = 1280"))
    text = reason(tmp_path, row(1_000_000), {IMAGE: png(PIXELS)}, camera_file=tmp_path / "c.toml")
    assert "the intrinsics are for 1280x2 px but the image is 3x2 px" in text


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ("", "the file is empty"),
        ("\n \n", "the file is empty"),
        (HEADER + "\n", "zero frames: there is a header but no row"),
        (HEADER.replace("Q_W", "QW") + "\n", "line 1: column Q_W missing"),
        (HEADER.replace("\t", " ") + "\n", "TimeStamp, POS_X"),
        (HEADER + "\tQ_W\n", "column Q_W stands there more than once"),
    ],
)
def test_record_file_that_cannot_be_read(tmp_path, content, text):
    (tmp_path / "airsim_rec.txt").write_text(content)
    with pytest.raises(RecordingError, match=text) as error:
        open_recording(tmp_path)
    assert "airsim_rec.txt" in str(error.value)


def test_second_vehicle_is_left_out_and_said(tmp_path):
    rows = [row(1_000_000), row(2_000_000).replace("Drone\t", "Boat\t", 1)]
    source = open_recording(recording(tmp_path / "rec", rows, {IMAGE: png(PIXELS)}))
    assert len(source) == 1
    assert "1 rows of vehicles other than 'Drone' are left out" in source.notes[0]


def scene(**values):
    camera = {"width": 3, "height": 2, "fx": 7.0, "fy": 7.0, "cx": 1.0, "cy": 0.5}
    return json.dumps({"format": "deckline-scene", "version": 1, "camera": camera, **values})


def test_camera_is_the_given_one_else_the_scenes_else_the_one_beside_else_90_degrees(tmp_path):
    folder = recording(tmp_path / "rec", [row(1_000_000)], {IMAGE: png(PIXELS)})
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
    folder = recording(tmp_path / "rec", [row(1_000_000)], {IMAGE: png(PIXELS)})
    (folder / "scene.json").write_text(scene(frames={IMAGE: {"deck_z_m": -17.5, "sea_z_m": 2.5, "truth": truth}}))
    frame = open_recording(folder).load(0)
    assert (frame.deck_z_m, frame.sea_z_m) == (-17.5, 2.5)
    assert frame.truth.left.p1_m.tolist() == [4.0, 5.0, 6.0]
    assert frame.truth.right is None
    assert frame.truth.visibility_m == 900.0
    overruled = open_recording(folder, deck_z_m=-20.0, sea_z_m=0.0).load(0)
    assert (overruled.deck_z_m, overruled.sea_z_m) == (-20.0, 0.0)


@pytest.mark.parametrize(
    ("entry", "text"),
    [
        ({"deck_z_m": "high"}, "deck_z_m must be a finite number"),
        ({"sea_z_m": "low"}, "sea_z_m must be a finite number"),
        ({"truth": {"clear_image": "../x.png"}}, "must be a path inside the recording"),
        ({"truth": {"clear_image": "clear/x.png"}}, "image is missing"),
        ({"camera": {"width": 3}}, "scene.json: camera: height"),
        ({"time_s": None}, "time_s must be a finite number"),
    ],
)
def test_bad_scene_entry_costs_one_frame(tmp_path, entry, text):
    folder = recording(tmp_path / "rec", [row(1_000_000)], {IMAGE: png(PIXELS)})
    (folder / "scene.json").write_text(scene(frames={IMAGE: entry}))
    (item,) = open_recording(folder).items()
    assert text in item.reason


def test_frame_that_the_scene_does_not_know_is_skipped(tmp_path):
    folder = recording(tmp_path / "rec", [row(1_000_000)], {IMAGE: png(PIXELS)})
    (folder / "scene.json").write_text(scene(frames={}))
    (item,) = open_recording(folder).items()
    assert "scene.json has no entry for it" in item.reason
