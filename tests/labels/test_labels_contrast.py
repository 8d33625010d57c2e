"""How far a marking stands out: what was drawn must come back, whatever its width, and nothing from bare decks."""

import numpy as np
import pytest

from deckline.labels.truth import line_contrast

SIZE = (360, 640)
LEFT = np.stack([np.linspace(250, 300, 65), np.linspace(340, 40, 65)], axis=1)
RIGHT = np.stack([np.linspace(450, 360, 65), np.linspace(340, 40, 65)], axis=1)


def drawn(level: float, width: float = 0.06, deck: float = 60.0) -> np.ndarray:
    """A stripe along the left line, its width in parts of the way to the right one."""
    v, u = np.mgrid[: SIZE[0], : SIZE[1]].astype(float)
    left, right = (np.interp(v, line[::-1, 1], line[::-1, 0]) for line in (LEFT, RIGHT))
    image = np.full((*SIZE, 3), deck)
    image[np.abs(u - left) <= width / 2 * (right - left)] += level
    return image


@pytest.mark.parametrize("width", [0.04, 0.08, 0.14])
@pytest.mark.parametrize("level", [-30.0, 4.0, 100.0])
def test_a_stripe_has_the_contrast_it_was_drawn_with(level, width):
    found = line_contrast(drawn(level, width), LEFT, RIGHT)[8:-8]
    assert np.median(found) == pytest.approx(abs(level), rel=0.2)


def test_an_edge_between_two_tones_counts_as_well():
    image = drawn(0.0)
    v, u = np.mgrid[: SIZE[0], : SIZE[1]]
    image[u > np.interp(v, LEFT[::-1, 1], LEFT[::-1, 0])] += 20.0
    assert np.median(line_contrast(image, LEFT, RIGHT)) == pytest.approx(20.0, rel=0.1)


def test_dashes_and_haze_take_their_share_of_it():
    image = drawn(80.0)
    image[(np.arange(SIZE[0]) // 8) % 2 == 0] = 60.0
    dashed = np.median(line_contrast(image, LEFT, RIGHT))
    assert dashed == pytest.approx(40.0, rel=0.2)
    assert np.median(line_contrast(200 + 0.1 * (image - 200), LEFT, RIGHT)) == pytest.approx(0.1 * dashed, rel=0.01)


def test_a_bare_deck_has_little_and_a_line_elsewhere_does_not_count():
    noisy = drawn(0.0) + np.random.default_rng(1).normal(0, 3, (*SIZE, 3))
    assert np.median(line_contrast(noisy, LEFT, RIGHT)) < 2.0
    assert np.median(line_contrast(drawn(100.0), RIGHT, LEFT)) < 1.0


def test_colour_alone_is_enough_and_points_outside_the_image_do_no_harm():
    image = drawn(0.0)
    image[..., 0] = drawn(30.0)[..., 0]
    assert np.median(line_contrast(image, LEFT, RIGHT)) == pytest.approx(30 / np.sqrt(3), rel=0.2)
    assert np.isfinite(line_contrast(image, LEFT - [400.0, 0.0], RIGHT - [400.0, 0.0])).all()
