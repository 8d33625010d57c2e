"""Clear views: ranges along the ray, what is refused, and how recordings are split."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from clear_scene import CAMERA, clear_frame, clear_recording
from deckline.geometry import Camera
from deckline.train.views import horizon_colour, make_clear_view, open_clear_views
from deckline.types import Truth


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return clear_recording(tmp_path_factory.mktemp("clear"), frames=8)


def test_view_holds_ranges_along_the_ray() -> None:
    view = make_clear_view(clear_frame(0), 640)
    frame = clear_frame(0)
    assert frame.depth_m is not None
    np.testing.assert_allclose(view.range_m[40], frame.depth_m[40] * CAMERA.ray_lengths()[40], rtol=1e-3)  # half floats
    assert np.isinf(view.range_m[:16]).all()
    assert view.horizon_rgb is not None
    np.testing.assert_allclose(view.horizon_rgb, (150, 170, 200))


def test_large_view_is_averaged_down() -> None:
    view, small = make_clear_view(clear_frame(0, Camera.from_fov(192, 128, 1.2)), 96), clear_frame(0, CAMERA)
    assert view.clear_rgb.shape == small.image_rgb.shape
    assert view.range_m.shape == small.image_rgb.shape[:2]


def test_frame_without_depth_or_clear_image_is_refused() -> None:
    frame = clear_frame(0)
    with pytest.raises(ValueError, match=r"000\.png.*depth"):
        make_clear_view(replace(frame, depth_m=None), 640)
    with pytest.raises(ValueError, match=r"000\.png.*clear"):
        make_clear_view(replace(frame, truth=Truth(visibility_m=900.0)), 640)
    with pytest.raises(ValueError, match=r"000\.png.*clear"):
        make_clear_view(replace(frame, truth=None), 640)


def test_recorded_clear_image_is_preferred() -> None:
    clear = np.full_like(clear_frame(0).image_rgb, 7)
    frame = replace(clear_frame(0), truth=Truth(visibility_m=900.0, clear_rgb=clear))
    np.testing.assert_array_equal(make_clear_view(frame, 640).clear_rgb, clear)


def test_horizon_colour_is_the_lowest_sky() -> None:
    image = np.zeros((20, 10, 3), dtype=np.uint8)
    image[:8], image[8:10] = 30, 200
    ranges = np.full((20, 10), 100.0)
    ranges[:10] = np.inf
    np.testing.assert_allclose(horizon_colour(image, ranges), 200)
    assert horizon_colour(image, np.full((20, 10), 100.0)) is None


def test_held_out_views_are_no_training_views(recording: Path) -> None:
    assert len(open_clear_views([recording], 640, 0.25)) == 6
    assert len(open_clear_views([recording, recording], 640, 0.25)) == 12
    assert len(open_clear_views([recording, recording], 640, 0.25, train=False)) == 2
    with pytest.raises(ValueError, match=str(recording)):
        open_clear_views([recording], 640, 0.0, train=False)


def test_unreadable_frames_are_named_and_others_drawn(tmp_path: Path) -> None:
    clear_recording(tmp_path, frames=4)
    images = sorted((tmp_path / "images").glob("*.ppm"))
    images[1].write_bytes(images[1].read_bytes()[:100])
    views = open_clear_views([tmp_path], 640, 0.0)
    rng = np.random.default_rng(0)
    assert all(views.draw(rng).clear_rgb.shape == (64, 96, 3) for _ in range(20))
    assert list(views.skipped) == [images[1].name]
    for image in images:
        image.write_bytes(b"P6")
    with pytest.raises(ValueError, match=r"20.*\.ppm"):
        open_clear_views([tmp_path], 640, 0.0).draw(rng)
