from itertools import pairwise

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deckline.detect.crop import Crop, crop_around, full_crop, normalise, sample_crop, tile_crops

NET = (512, 288)


def spot(width: int, height: int, u: float, v: float, sigma: float) -> np.ndarray:
    """A bright Gaussian on black, float grey levels (H, W, 3)."""
    rows, columns = np.mgrid[0:height, 0:width]
    value = 255 * np.exp(-((columns - u) ** 2 + (rows - v) ** 2) / (2 * sigma**2))
    return np.repeat(value[..., None], 3, axis=2).astype(np.float32)


def centroid(image: np.ndarray) -> np.ndarray:
    grey = np.nan_to_num(image[..., 0])
    rows, columns = np.mgrid[0 : grey.shape[0], 0 : grey.shape[1]]
    return np.array([(grey * columns).sum(), (grey * rows).sum()]) / grey.sum()


@pytest.mark.parametrize(
    "window", [full_crop((1280, 720), NET), Crop(300.0, 200.0, 0.25), Crop(250.3, 120.7, 0.8), Crop(-100.0, -60.0, 3.1)]
)
def test_a_spot_is_seen_where_the_window_has_it(window):
    u, v = 371.3, 236.8
    seen = sample_crop(spot(1280, 720, u, v, 6.0), window, NET)
    np.testing.assert_allclose(centroid(seen), window.to_network([[u, v]])[0], atol=0.02)
    np.testing.assert_allclose(window.to_image(centroid(seen)[None])[0], [u, v], atol=0.02)


def test_whole_window_shrinks_by_areas_as_opencv_does():
    rng = np.random.default_rng(1)
    image = cv2.GaussianBlur(rng.integers(0, 256, (576, 1024, 3), dtype=np.uint8), (0, 0), 3)
    seen = sample_crop(image, full_crop((1024, 576), NET), NET)
    assert np.abs(seen - cv2.resize(image, NET, interpolation=cv2.INTER_AREA)).max() < 2.0


def test_magnifying_is_bilinear():
    image = np.random.default_rng(2).integers(0, 256, (100, 120, 3)).astype(np.float32)
    window = Crop(20.0, 30.0, 0.1)
    seen = sample_crop(image, window, NET)
    u, v = window.to_image([[100, 50]])[0]
    i, j = int(v), int(u)
    a, b = v - i, u - j
    four = image[i : i + 2, j : j + 2]
    expected = (1 - a) * ((1 - b) * four[0, 0] + b * four[0, 1]) + a * ((1 - b) * four[1, 0] + b * four[1, 1])
    np.testing.assert_allclose(seen[50, 100], expected, atol=1e-2)


def test_outside_the_image_is_nan_and_becomes_zero():
    image = np.full((480, 640, 3), 90, dtype=np.uint8)
    seen = sample_crop(image, full_crop((640, 480), NET), NET)
    assert np.isnan(seen[:, :64]).all()
    assert np.isnan(seen[:, -64:]).all()
    np.testing.assert_allclose(seen[:, 64:-64], 90, atol=1e-3)
    assert (normalise(seen)[:, :, :64] == 0).all()


@settings(deadline=None)
@given(st.floats(0, 1200), st.floats(0, 650), st.floats(1, 900), st.floats(1, 700))
def test_box_window_holds_the_box_inside_the_image(u0, v0, width, height):
    box = (u0, v0, min(u0 + width, 1279.5), min(v0 + height, 719.5))
    window = crop_around(box, (1280, 720), NET, 0.6, 72.0)
    a, b, c, d = window.bounds(*NET)
    assert a >= -0.5 - 1e-6 and b >= -0.5 - 1e-6 and c <= 1279.5 + 1e-6 and d <= 719.5 + 1e-6
    assert a <= box[0] + 1e-6 and b <= box[1] + 1e-6 and c >= box[2] - 1e-6 and d >= box[3] - 1e-6
    assert c - a >= 72.0 - 1e-6
    assert (c - a) / (d - b) == pytest.approx(512 / 288)


def test_normalise_takes_off_airlight_and_fading():
    clear = np.random.default_rng(3).uniform(0, 255, (288, 512, 3)).astype(np.float32)
    hazy = 0.3 * clear + 0.7 * np.array([180, 190, 200], dtype=np.float32)
    np.testing.assert_allclose(normalise(clear), normalise(hazy), atol=1e-4)
    assert normalise(clear).std() == pytest.approx(1.0, rel=1e-3)
    assert normalise(clear).shape == (3, 288, 512)


def test_wrong_use_is_refused():
    with pytest.raises(ValueError, match=r"box .*\(5\.0, 5\.0, 5\.0, 9\.0\)"):
        crop_around((5, 5, 5, 9), (1280, 720), NET, 0.6, 72.0)
    with pytest.raises(ValueError, match=r"step.*0\.0"):
        Crop(0.0, 0.0, 0.0)


@pytest.mark.parametrize("size", [(1280, 720), (640, 640), (200, 900)])
def test_tiles_reach_every_edge_and_overlap(size):
    tiles = tile_crops(size, NET, 3, 0.4)
    assert len(tiles) == 9
    for axis, length in enumerate(size):
        spans = sorted({(crop.bounds(*NET)[axis], crop.bounds(*NET)[axis + 2]) for crop in tiles})
        assert spans[0][0] <= -0.5 + 1e-6 and spans[-1][1] >= length - 0.5 - 1e-6
        assert all(end > start for (_, end), (start, _) in pairwise(spans))
