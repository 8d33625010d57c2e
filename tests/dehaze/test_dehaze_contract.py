"""What holds for every dehazer, and what an unusable model says."""

from pathlib import Path

import numpy as np
import pytest

from deckline.dehaze import DEHAZERS, Dehazer, OnnxDehazer
from deckline.haze import add_haze, beta_from_visibility


@pytest.fixture(scope="module", params=list(DEHAZERS))
def dehazer(request: pytest.FixtureRequest) -> Dehazer:
    return DEHAZERS[request.param]()


def random_image(height: int, width: int) -> np.ndarray:
    return np.random.default_rng([height, width]).integers(0, 256, (height, width, 3), dtype=np.uint8)


@pytest.mark.parametrize(
    "size", [(1, 1), (1, 40), (2, 3), (1, 1300), (1930, 5), (33, 31), (97, 203), (360, 640), (361, 1283)]
)
def test_shape_type_determinism_and_input(dehazer: Dehazer, size: tuple[int, int]) -> None:
    image = random_image(*size)
    before = image.copy()
    first, second = dehazer(image), dehazer(image)
    assert first.shape == image.shape
    assert first.dtype == np.uint8
    np.testing.assert_array_equal(first, second)
    np.testing.assert_array_equal(image, before)
    assert not np.shares_memory(first, image)


@pytest.mark.parametrize("level", [0, 255])
def test_extremes_stay_in_range(dehazer: Dehazer, level: int) -> None:
    """A wrapped value would make white from black; half the range is far from either."""
    result = dehazer(np.full((64, 96, 3), level, dtype=np.uint8))
    if dehazer.name in ("none", "geometry", "geometry-linear"):
        assert (result == level).all()
    if level == 0:
        assert result.mean() < 128


def test_read_only_and_strided_input(dehazer: Dehazer) -> None:
    image = random_image(48, 80)[:, ::-1]
    image.flags.writeable = False
    np.testing.assert_array_equal(dehazer(image), dehazer(image.copy()))


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (np.zeros((4, 4, 3), dtype=np.float32), "must be uint8, got float32"),
        (np.zeros((4, 4), dtype=np.uint8), r"shape \(H, W, 3\).*got \(4, 4\)"),
        (np.zeros((4, 4, 4), dtype=np.uint8), r"got \(4, 4, 4\)"),
        (np.zeros((0, 4, 3), dtype=np.uint8), r"got \(0, 4, 3\)"),
    ],
)
def test_wrong_images_are_refused(dehazer: Dehazer, image: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        dehazer(image)


def test_names_are_their_keys() -> None:
    assert {key: build().name for key, build in DEHAZERS.items()} == {key: key for key in DEHAZERS}


def test_haze_over_a_known_scene_gets_less() -> None:
    """Each method that works on images alone brings a hazy deck-like scene nearer to the clear one than it was."""
    clear, ranges = scene()
    hazy = add_haze(clear, ranges, beta_from_visibility(900.0), (185, 192, 200))
    errors = {name: rms(build()(hazy), clear) for name, build in DEHAZERS.items()}
    assert errors["none"] == rms(hazy, clear)
    assert errors["dark-channel"] < 0.8 * errors["none"]
    assert errors["coarse-t"] < 0.8 * errors["none"]


def scene() -> tuple[np.ndarray, np.ndarray]:
    """Dark sea with a deck and white lines, seen from 40 to 700 m; no sky. (240, 320, 3) and (240, 320) m."""
    rng = np.random.default_rng(3)
    clear = np.clip(rng.normal((38, 58, 72), 9, (240, 320, 3)), 0, 255)
    clear[90:, 110:210] = (82, 84, 88)
    clear[90:, 120:126] = clear[90:, 194:200] = (225, 225, 220)
    rows = np.arange(240)[:, None] + np.zeros((1, 320))
    return clear.astype(np.uint8), 40 + 660 * (1 - rows / 239) ** 2


def rms(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.sqrt(np.mean((a.astype(float) - b.astype(float)) ** 2)))


def test_model_of_another_kind_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.onnx"
    path.write_text("no model")
    with pytest.raises(ValueError, match="is not a usable ONNX model"):
        OnnxDehazer(path)
    with pytest.raises(ValueError, match="does not exist"):
        OnnxDehazer(tmp_path / "none.onnx")
