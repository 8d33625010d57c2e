import numpy as np
import pytest
from sea_scene import AIRLIGHT

from deckline.dehaze.transmission import GeometryConfig, bound_transmission, raise_to_deck, scale_length, sky_contrast

AIR = AIRLIGHT.astype(np.float32)[:, None, None]


def test_the_bound_never_exceeds_the_true_transmission():
    """Of anything that lies between a ship's darkest detail and full scale."""
    rng = np.random.default_rng(2)
    scene = rng.uniform(0.2 * AIRLIGHT.max(), 255, (3, 40, 60))
    hazy = (AIR + 0.4 * (scene - AIR)).astype(np.float32)
    bound = bound_transmission(hazy, AIR, GeometryConfig())
    assert bound.max() < 0.4 + 1e-3
    assert np.median(bound) > 0.27  # with many details it comes near


def test_the_deck_plane_raises_only_what_rises_out_of_the_sea():
    bound = np.array([[0.5, 0.5, 0.5, 0.9]], np.float32)
    sea_t = np.array([[0.5, 0.4, 0.2, 0.2]], np.float32)
    raised = raise_to_deck(bound, sea_t, np.full_like(bound, 0.8), GeometryConfig(nearer_ratio=(1.1, 1.5)))
    np.testing.assert_allclose(raised, [[0.5, 0.5 + 0.375 * 0.3, 0.8, 0.9]], atol=1e-6)


def test_darker_than_the_sky_as_high():
    """A sky that brightens towards the horizon, and one dark block in it."""
    rng = np.random.default_rng(3)
    down = rng.uniform(-0.5, 0.0, 20_000).astype(np.float32)
    sky = 200 + 60 * down
    levels = np.stack([sky, sky + 10, sky + 20]).astype(np.float32)
    block = (down > -0.2) & (rng.random(down.size) < 0.2)
    levels[:, block] -= np.array([[30.0], [50.0], [40.0]], np.float32)
    darker = sky_contrast(levels, down)
    np.testing.assert_allclose(darker[block], 50, atol=1.5)
    assert np.abs(darker[~block]).max() < 1.5


@pytest.mark.parametrize(("count", "darker"), [(0, 0), (1, 0), (59, 0), (100, 40)])
def test_a_sky_of_one_height_is_no_fault_and_a_small_sky_has_no_contrast(count, darker):
    levels = np.full((3, count), 90, np.float32)
    levels[:, :5] = 50
    found = sky_contrast(levels, np.full(count, -0.1, np.float32))
    np.testing.assert_array_equal(found, ([darker] * 5 + [0] * 95)[:count])


def test_lengths_are_odd_and_scale_with_the_width():
    assert [scale_length(15, width) for width in (1280, 640, 2560, 1)] == [15, 9, 31, 1]
