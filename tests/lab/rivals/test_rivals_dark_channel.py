"""The dark channel prior against the definitions it is made of."""

import numpy as np
import pytest
from scipy.ndimage import minimum_filter, uniform_filter

from deckline.dehaze.filters import dark_channel
from deckline_lab.rivals.dark_channel import DarkChannelConfig, DarkChannelDehazer, estimate_airlight, guided_filter


def random_image(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).random((40, 50, 3), dtype=np.float32)


def test_dark_channel_is_the_minimum_over_window_and_colours() -> None:
    image = random_image()
    expected = minimum_filter(image.min(axis=2), size=7, mode="constant", cval=1.0)
    np.testing.assert_array_equal(dark_channel(image, 7), expected)


def test_airlight_is_the_brightest_of_the_haziest() -> None:
    image = np.full((20, 50, 3), 0.2, dtype=np.float32)
    dark = np.full((20, 50), 0.1, dtype=np.float32)
    dark[3, 4:6] = 0.9
    image[3, 4], image[3, 5], image[10, 10] = (0.7, 0.7, 0.7), (0.8, 0.9, 0.7), (1.0, 1.0, 1.0)
    np.testing.assert_allclose(estimate_airlight(image, dark, 0.002), [0.8, 0.9, 0.7])


def test_guided_filter_against_scipy_boxes() -> None:
    guide, values = random_image(1)[..., 0], random_image(2)[..., 0]

    def box(x: np.ndarray) -> np.ndarray:
        return uniform_filter(x.astype(np.float64), 9, mode="nearest")

    cov = box(guide * values) - box(guide) * box(values)
    slope = cov / (box(guide * guide) - box(guide) ** 2 + 1e-3)
    offset = box(values) - slope * box(guide)
    np.testing.assert_allclose(guided_filter(guide, values, 4, 1e-3), box(slope) * guide + box(offset), atol=1e-4)


def test_uniform_haze_is_removed_as_the_model_has_it() -> None:
    """One depth, one airlight, a dark pixel in every window: t = 1 - omega (1 - t_true) exactly."""
    rng = np.random.default_rng(0)
    clear = rng.uniform(0, 0.5, (80, 80, 3))
    clear[::4, ::4] = 0
    airlight, t = 0.8, 0.6
    hazy = clear * t + airlight * (1 - t)
    hazy[:8, :8] = airlight  # a patch of sky shows the airlight
    result = DarkChannelDehazer(DarkChannelConfig(patch_px=7, guide_radius_px=3))(np.rint(255 * hazy).astype(np.uint8))
    kept = 1 - 0.95 * (1 - t)
    expected = 255 * ((hazy - airlight) / kept + airlight)
    inner = slice(30, 70)
    assert np.abs(result[inner, inner] - np.clip(expected[inner, inner], 0, 255)).mean() < 3.0


@pytest.mark.parametrize(("name", "value"), [("patch_px", 4), ("omega", 1.5), ("min_transmission", 0.0)])
def test_config_errors(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"{name}.*{value}"):
        DarkChannelConfig(**{name: value})


@pytest.mark.parametrize("size", [(1, 1), (1, 40), (40, 1), (2, 3), (33, 31)])
@pytest.mark.parametrize("colour", [(0, 0, 0), (1, 1, 1), (77, 77, 77), (255, 255, 255), (255, 0, 0), (254, 255, 1)])
def test_a_picture_of_one_colour_is_its_own_airlight(size: tuple[int, int], colour: tuple[int, int, int]) -> None:
    """J = (I - A) / t + A with A = I: nothing to remove, whatever t is, and nothing divides by zero or wraps."""
    image = np.broadcast_to(np.array(colour, dtype=np.uint8), (*size, 3)).copy()
    np.testing.assert_array_equal(DarkChannelDehazer()(image), image)


def test_a_saturated_sky_stays_white_and_what_is_below_never_wraps() -> None:
    """A is white, so that the result is never brighter than the picture: a wrapped value would be."""
    image = np.random.default_rng(5).integers(0, 200, (120, 90, 3), dtype=np.uint8)
    image[:50] = 255
    result = DarkChannelDehazer()(image)
    assert (result[:30] == 255).all()
    assert (result[50:] <= image[50:]).all()
    assert (result[90:] < image[90:]).any()
