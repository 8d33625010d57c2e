import numpy as np
import pytest
from PIL import Image

from deckline.geometry import Camera
from deckline.live.recorder import FrameFolder
from deckline.recording import open_recording
from deckline.recording.exif import EXIF_FOCAL_SIGMA, EXIF_IFD, FOCAL_35_MM, PIXEL_X, PIXEL_Y

ORIENTATION, ROTATED = 274, 6
SIDES = np.hypot(36.0, 24.0)


def write_photo(path, focal_mm, size=(60, 40), orientation=None, stated=None):
    exif = Image.Exif()
    tags = {FOCAL_35_MM: focal_mm} | ({} if stated is None else {PIXEL_X: stated[0], PIXEL_Y: stated[1]})
    exif.get_ifd(EXIF_IFD).update({tag: value for tag, value in tags.items() if value is not None})
    if orientation is not None:
        exif[ORIENTATION] = orientation
    path.parent.mkdir(exist_ok=True)
    Image.new("RGB", size, (90, 120, 150)).save(path, exif=exif)
    return path


@pytest.mark.parametrize("focal_mm", [14, 26, 50, 200])
def test_a_35_mm_equivalent_gives_the_field_of_view_of_a_3_to_2_picture(tmp_path, focal_mm):
    camera = open_recording(write_photo(tmp_path / "a.jpg", focal_mm)).load(0).camera
    assert camera.fov_deg == pytest.approx(2 * np.degrees(np.arctan(18.0 / focal_mm)))
    assert (camera.known, camera.focal_sigma, camera.fx) == (True, EXIF_FOCAL_SIGMA, camera.fy)


@pytest.mark.parametrize("size", [(64, 48), (64, 36), (40, 40)])
def test_other_shapes_keep_the_diagonal_of_the_equivalent(tmp_path, size):
    camera = open_recording(write_photo(tmp_path / "a.jpg", 28, size)).load(0).camera
    corner = (np.array(size) - 1.0) / 2 + np.array(size) / 2  # the outer corner of the last pixel
    across = 2 * np.hypot(*camera.rays(corner[None])[0, :2])
    assert across == pytest.approx(SIDES / 28.0)


def test_a_turned_photo_has_the_camera_of_the_upright_picture(tmp_path):
    frame = open_recording(write_photo(tmp_path / "a.jpg", 28, (60, 40), ROTATED, (60, 40))).load(0)
    assert frame.image_rgb.shape == (60, 40, 3)
    assert (frame.camera.width, frame.camera.height, frame.camera.cx) == (40, 60, 19.5)
    assert frame.camera.fx == pytest.approx(28.0 * np.hypot(60, 40) / SIDES)


def test_a_zoom_on_the_way_gives_every_photo_its_own_camera(tmp_path):
    for name, focal_mm in (("a.jpg", 24), ("b.jpg", 48), ("c.jpg", None)):
        write_photo(tmp_path / name, focal_mm)
    wide, long, plain = (frame.camera for frame in open_recording(tmp_path))
    assert long.fx == pytest.approx(2 * wide.fx) and not plain.known


@pytest.mark.parametrize(
    ("focal_mm", "stated", "reason"),
    [(0, None, "of 0 mm"), (3, None, "of 3 mm"), (65535, None, "of 65535 mm"), (26, (60, 60), "cropped to 60x40")],
)
def test_an_absurd_equivalent_and_a_cropped_photo_are_noted_and_not_used(tmp_path, focal_mm, stated, reason):
    source = open_recording(write_photo(tmp_path / "a.jpg", focal_mm, stated=stated))
    assert not source.load(0).camera.known
    assert reason in source.notes[-1] and "camera assumed" in source.notes[-1]


@pytest.mark.parametrize("kept", [14, 20, 30, 40])
def test_exif_that_is_cut_short_is_not_used(tmp_path, kept):
    path = write_photo(tmp_path / "a.jpg", 26)
    with Image.open(path) as photo:
        exif = photo.info["exif"]
    Image.new("RGB", (60, 40)).save(path, exif=exif[:kept])
    source = open_recording(path)
    assert not source.load(0).camera.known and "camera assumed" in source.notes[-1]


def test_a_stated_camera_goes_before_exif_and_only_the_one_that_is_taken_is_noted(tmp_path):
    path = write_photo(tmp_path / "photos" / "a.jpg", 26)
    (note,) = (note for note in open_recording(path).notes if ": camera " in note)
    assert "camera of EXIF, 26 mm equivalent: 69.4 degrees across 60x40 px, focal length to 5%" in note
    source = open_recording(path, fov_deg=40.0)
    assert (source.load(0).camera.focal_sigma, source.load(0).camera.fov_deg) == (None, pytest.approx(40.0))
    assert sum(": camera " in note for note in source.notes) == 1 and "--fov-deg" in source.notes[-1]


def test_a_recording_keeps_that_a_focal_length_is_of_exif(tmp_path):
    frame = open_recording(write_photo(tmp_path / "photos" / "a.jpg", 26), deck_z_m=-18.0).load(0)
    folder = FrameFolder(tmp_path / "copy")
    folder.add(frame)
    folder.close()
    again = open_recording(tmp_path / "copy").load(0)
    assert again.camera == frame.camera and again.deck_z_m == -18.0


def test_an_assumed_camera_carries_its_wide_sigma():
    camera = Camera.assumed(60, 40)
    assert (camera.known, camera.fov_deg, camera.focal_sigma) == (True, pytest.approx(65.0), 0.35)
    assert camera.resized(30, 20).focal_sigma == 0.35
    with pytest.raises(ValueError, match=r"focal_sigma.*-0\.1"):
        Camera(60, 40, 1.0, 1.0, 1.0, 1.0, focal_sigma=-0.1)
