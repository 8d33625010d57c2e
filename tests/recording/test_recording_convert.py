import numpy as np
import pytest
from recording_bytes import CAMERA, PIXELS, pfm, png, recording, row

from deckline.geometry import Camera, attitude, camera_mount
from deckline.recording import BadFrame, RecordingError, RecordingWriter, open_recording
from deckline.recording.camera_file import read_camera_file
from deckline.recording.convert import add_scene, drop_scene
from deckline.recording.read_options import ReadOptions
from deckline.types import Frame

DEPTH = [[1.0, 2.0, 3.0], [4.0, 5.0, 65504.0]]
FILES = {f"img_Drone_0_0_{n}.png": png(PIXELS) for n in (7, 8)} | {f"img_Drone_0_1_{n}.pfm": pfm(DEPTH) for n in (7, 8)}


def plain(folder):
    """Two frames of AirSim's own layout, byte by byte."""
    return recording(folder, [row(7, types="01", ms=100), row(8, types="01", ms=350)], FILES)


def replace_by_link(folder):
    depth = folder / "images" / "img_Drone_0_1_8.pfm"
    depth.rename(folder.parent / "secret")
    depth.symlink_to(folder.parent / "secret")


def contents(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_camera_mount_and_deck_are_laid_beside_and_found_again(tmp_path):
    mount = camera_mount([0.5, 0.0, 0.1], attitude(0.0, -0.2, 0.0))
    options = ReadOptions(fov_deg=2 * np.degrees(np.arctan(0.5)), deck_z_m=-18.5)
    done = add_scene(plain(tmp_path / "a"), tmp_path / "b", options, mount)
    assert done == (2, 4, [])
    frames = list(open_recording(tmp_path / "b"))
    assert [frame.time_s for frame in frames] == [0.1, 0.35]
    for frame in frames:
        assert frame.camera == Camera.from_fov(3, 2, np.deg2rad(options.fov_deg))
        assert frame.deck_z_m == -18.5
        np.testing.assert_allclose(frame.body_from_camera.as_matrix(), mount.as_matrix(), atol=1e-12)
        np.testing.assert_array_equal(frame.image_rgb, PIXELS)
        np.testing.assert_array_equal(frame.depth_m, [[1.0, 2.0, 3.0], [4.0, 5.0, np.nan]])
        # AirSim's rows hold the vehicle's pose
        np.testing.assert_allclose(frame.world_from_body.translation, [1.0, 2.0, -3.0])
        np.testing.assert_allclose(frame.world_from_camera.translation, [1.5, 2.0, -2.9])


def test_there_and_back_gives_the_same_bytes(tmp_path):
    before = contents(plain(tmp_path / "a"))
    add_scene(tmp_path / "a", tmp_path / "b", ReadOptions())
    assert contents(tmp_path / "a") == before
    drop_scene(tmp_path / "b", tmp_path / "c")
    assert contents(tmp_path / "c") == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b", "c"]


def test_a_camera_file_gives_intrinsics_mount_and_deck(tmp_path):
    (tmp_path / "c.toml").write_text(
        CAMERA + "deck_z_m = -7.0\nsea_z_m = 3.0\n[body_from_camera]\ntranslation_m = [5, 0, 1]\n"
    )
    options = ReadOptions(camera=read_camera_file(tmp_path / "c.toml"))
    add_scene(plain(tmp_path / "a"), tmp_path / "b", options)
    frame = open_recording(tmp_path / "b").load(0)
    assert (frame.camera.fx, frame.camera.fy, frame.deck_z_m, frame.sea_z_m) == (4.0, 5.0, -7.0, 3.0)
    assert frame.body_from_camera.translation.tolist() == [5.0, 0.0, 1.0]


def test_damaged_rows_stay_what_they_are_and_missing_files_are_named(tmp_path):
    files = {name: data for name, data in FILES.items() if name != "img_Drone_0_1_8.pfm"}
    files["img_Drone_0_0_7.png"] = png(PIXELS)[:-9]
    folder = recording(tmp_path / "a", [row(7, types="01"), row(8), row(9)], files)
    done = add_scene(folder, tmp_path / "b", ReadOptions())
    assert done == (3, 3, ["1 files named in airsim_rec.txt are missing, such as img_Drone_0_0_9.png"])
    items = list(open_recording(tmp_path / "b").items())
    assert [isinstance(item, BadFrame) for item in items] == [True, False, True]
    assert "cut short" in items[0].reason
    assert "image is missing" in items[2].reason


def test_what_deckline_records_becomes_what_airsims_tools_read(tmp_path):
    cosysairsim = pytest.importorskip("cosysairsim")
    camera = Camera.from_fov(3, 2, 1.0)
    depth = np.array([[1.0, 2.0, np.nan], [4.0, 5.0, 6.0]], np.float32)
    pose = camera_mount([1.0, 2.0, 3.0])
    with RecordingWriter(tmp_path / "a") as writer:
        writer.add(Frame("x", 0.5, PIXELS, camera, depth_m=depth, world_from_body=pose, deck_z_m=-9.0))
    drop_scene(tmp_path / "a", tmp_path / "b")
    names = sorted(path.name for path in (tmp_path / "b").rglob("*") if path.is_file())
    assert names == ["airsim_rec.txt", "img_deckline_0_0_500000000.png", "img_deckline_0_1_500000000.pfm"]
    values, scale = cosysairsim.utils.read_pfm(str(tmp_path / "b" / "images" / names[2]))
    assert scale == 1.0
    np.testing.assert_array_equal(values, [[1.0, 2.0, 65504.0], [4.0, 5.0, 6.0]])
    header, line = (tmp_path / "b" / "airsim_rec.txt").read_text().splitlines()
    assert dict(zip(header.split("\t"), line.split("\t"), strict=True))["ImageFile"] == ";".join(names[1:])


def test_names_that_leave_the_folder_are_not_copied(tmp_path):
    (tmp_path / "secret.png").write_bytes(png(PIXELS))
    line = row(7).replace("img_Drone_0_0_7.png", "img_Drone_0_0_7.png;../../secret.png")
    folder = recording(tmp_path / "a", [line], FILES)
    assert add_scene(folder, tmp_path / "b", ReadOptions())[1] == 1


@pytest.mark.parametrize(
    ("prepare", "convert", "text"),
    [
        (lambda a, b: (a / "scene.json").write_text("{}"), add_scene, "has scene.json"),
        (lambda a, b: b.mkdir() or (b / "x").touch(), add_scene, "b is there"),
        (
            lambda a, b: [path.unlink() for path in (a / "images").iterdir()],
            add_scene,
            "zero usable.*_7.png",
        ),
        (lambda a, b: (a / "airsim_rec.txt").unlink(), add_scene, "airsim_rec.txt"),
        (lambda a, b: None, drop_scene, "has no scene.json"),
        (lambda a, b: replace_by_link(a), add_scene, "_8.pfm: a link out"),
        (lambda a, b: (a / "scene.json").write_text("{}"), drop_scene, "scene.json"),
    ],
)
def test_what_cannot_be_converted_is_one_line_and_leaves_nothing(tmp_path, prepare, convert, text):
    folder = plain(tmp_path / "a")
    prepare(folder, tmp_path / "b")
    before = contents(tmp_path)
    with pytest.raises(RecordingError, match=text) as raised:
        convert(folder, tmp_path / "b", *([ReadOptions()] if convert is add_scene else []))
    assert "\n" not in str(raised.value)
    assert contents(tmp_path) == before
