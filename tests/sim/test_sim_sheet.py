import numpy as np
import pytest

from deckline.geometry import Camera, camera_mount, pose
from deckline.sim.sheet import contact_sheet, join_tiles, sheet_tile
from deckline.types import Frame, Segment, Truth

RED, GREEN = [255, 0, 0], [0, 255, 0]


def frame(width=64, height=48, **changes) -> Frame:
    """Grey; the left line runs from (16, 24) to (16, 40), the right one lies in the image's middle column."""
    left = Segment(np.array([10.0, -1.55, 0.05]), np.array([10.0, -1.55, 1.65]))
    right = Segment(np.array([10.0, 0.05, -1.0]), np.array([10.0, 0.05, 1.0]))
    values = {
        "file": "a",
        "time_s": 0.0,
        "image_rgb": np.full((height, width, 3), 90, np.uint8),
        "camera": Camera(width, height, 100.0, 100.0, (width - 1) / 2, (height - 1) / 2),
        "world_from_body": pose([0, 0, 0], [1, 0, 0, 0]),
        "body_from_camera": camera_mount(),
        "truth": Truth(left, right),
    }
    return Frame(**{**values, **changes})


def where(image: np.ndarray, colour: list[int]) -> np.ndarray:
    return np.argwhere(np.all(image == colour, axis=2))


def test_lines_are_dotted_where_the_camera_sees_them():
    image = sheet_tile(frame(), with_truth=True)
    v, u = where(image, RED).T
    assert set(u.tolist()) == {16}
    assert (v.min(), v.max()) == (24, 40)
    assert set(where(image, GREEN)[:, 1].tolist()) == {32}


def test_lines_follow_the_shrunken_image():
    image = sheet_tile(frame(), width_px=32, with_truth=True)
    assert image.shape == (24, 32, 3)
    v, u = where(image, RED).T
    assert set(u.tolist()) == {8}
    assert (v.min(), v.max()) == (12, 20)


def test_lines_follow_the_true_pose_where_the_recorded_one_is_measured():
    measured = frame(world_from_body=pose([0, 0.5, 0], [1, 0, 0, 0]))
    true = Truth(measured.truth.left, measured.truth.right, world_from_body=pose([0, 0, 0], [1, 0, 0, 0]))
    image = sheet_tile(frame(world_from_body=measured.world_from_body, truth=true), with_truth=True)
    assert set(where(image, RED)[:, 1].tolist()) == {16}


def test_a_tile_is_never_enlarged_and_leaves_its_frame_alone():
    item = frame()
    assert sheet_tile(item, width_px=200, with_truth=True).shape == (48, 64, 3)
    assert np.all(item.image_rgb == 90)


def test_shrinking_keeps_the_mean():
    rng = np.random.default_rng(0)
    item = frame(image_rgb=rng.integers(0, 256, (48, 64, 3), dtype=np.uint8))
    blocks = item.image_rgb.reshape(12, 4, 16, 4, 3).mean(axis=(1, 3))
    assert np.abs(sheet_tile(item, width_px=16) - blocks).max() <= 1.0


def test_frames_without_truth_or_pose_stay_as_they_are():
    for item in (frame(truth=None), frame(world_from_body=None), frame(truth=Truth())):
        np.testing.assert_array_equal(sheet_tile(item, with_truth=True), item.image_rgb)


def test_tiles_are_placed_row_by_row():
    tiles = [np.full((2, 3, 3), value, np.uint8) for value in (10, 20, 30)]
    sheet = join_tiles(tiles, columns=2)
    assert sheet[:, :, 0].tolist() == [[10] * 3 + [20] * 3] * 2 + [[30] * 3 + [0] * 3] * 2


def test_wrong_use_is_named():
    with pytest.raises(ValueError, match="got 0 frames and 3 columns"):
        contact_sheet([], 3)
    with pytest.raises(ValueError, match="got 1 frames and 0 columns"):
        contact_sheet([frame()], 0)
    with pytest.raises(ValueError, match="of one size"):
        contact_sheet([frame(), frame(32, 24)], 2)
    with pytest.raises(ValueError, match="width of a tile must be at least 1 px, got 0"):
        sheet_tile(frame(), width_px=0)
