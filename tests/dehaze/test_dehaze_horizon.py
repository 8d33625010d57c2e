from functools import partial

import numpy as np
import pytest
from sea_scene import draw_horizon

from deckline.dehaze.horizon import Horizon, NoHorizon, find_horizon

WIDTH, HEIGHT = 320, 200
sea = partial(draw_horizon, (WIDTH, HEIGHT))


@pytest.mark.parametrize("haze", [0.0, 0.02, 0.1])
@pytest.mark.parametrize(("row", "slope"), [(60.0, 0.0), (100.0, 0.15), (90.0, -0.3)])
def test_finds_the_line_within_its_sigma(haze: float, row: float, slope: float) -> None:
    found = find_horizon(sea(row, slope, haze))
    assert isinstance(found, Horizon)
    assert abs(found.middle_px - row) < 2 * found.middle_sigma_px < 0.06 * HEIGHT
    assert abs(found.slope - slope) < 2 * found.slope_sigma + 0.01


def test_a_ship_on_the_horizon_hides_it_in_its_own_columns_only() -> None:
    image = sea(80.0, 0.05, 0.05)
    image[50:120, 130:210] = (90, 92, 95)
    found = find_horizon(image)
    assert isinstance(found, Horizon)
    assert abs(found.middle_px - 80) < 2 * found.middle_sigma_px


def test_the_horizon_scales_with_the_image_and_is_less_sure_in_more_haze() -> None:
    image = sea(80.0, 0.1, 0.05)
    shown = (image, image.repeat(3, axis=0).repeat(3, axis=1), sea(70.0, 0.0, 0.0), sea(70.0, 0.0, 0.1))
    small, large, clear, hazy = map(find_horizon, shown)
    assert large.middle_px == pytest.approx(3 * small.middle_px + 1, abs=2)
    assert large.slope == pytest.approx(small.slope, abs=0.005)
    assert clear.middle_sigma_px < hazy.middle_sigma_px


def texture(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (HEIGHT // 10, WIDTH // 10, 3), dtype=np.uint8)


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((HEIGHT, WIDTH, 3), np.uint8),
        np.full((HEIGHT, WIDTH, 3), 255, np.uint8),
        np.full((HEIGHT, WIDTH, 3), 128, np.uint8),
        texture(1).repeat(10, axis=0).repeat(10, axis=1),
        np.random.default_rng(2).integers(100, 140, (HEIGHT, WIDTH, 3), dtype=np.uint8),
        sea(60.0, 0.0, 0.02)[::-1].copy(),
        np.full((8, 8, 3), 100, np.uint8),
    ],
    ids=["black", "white", "grey", "texture", "noise", "upside down", "tiny"],
)
def test_a_missing_horizon_has_its_reason(image: np.ndarray) -> None:
    before = image.copy()
    found = find_horizon(image)
    assert isinstance(found, NoHorizon) and found.reason
    np.testing.assert_array_equal(image, before)
