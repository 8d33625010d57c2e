"""Edges that a dehazed picture shows and its scene or its hazy picture does not."""

import numpy as np
import pytest

from deckline_lab.evaluation.false_content import block_step, false_edges, noise_step, raised_noise

SIZE = (120, 200)


def picture(levels) -> np.ndarray:
    return np.repeat(np.rint(np.broadcast_to(levels, SIZE)).clip(0, 255).astype(np.uint8)[..., None], 3, axis=2)


def stripe(height: float) -> np.ndarray:
    """A bar, so many levels above 100."""
    levels = np.full(SIZE, 100.0)
    levels[:, 80:120] += height
    return levels


@pytest.mark.parametrize(("height", "is_false"), [(0.0, True), (4.0, True), (20.0, False), (60.0, False)])
def test_an_edge_is_false_where_the_clear_picture_has_less_than_half_of_it(height, is_false):
    share = false_edges(picture(stripe(30.0)), picture(stripe(height)))
    assert (share > 0.01) is is_false
    assert share < 0.1  # the edges, and not the bar


def test_what_is_too_weak_to_be_seen_or_a_pixel_aside_is_not_false():
    assert false_edges(picture(stripe(3.0)), picture(stripe(0.0))) == 0
    assert false_edges(picture(np.roll(stripe(30.0), 1, axis=1)), picture(stripe(30.0))) == 0


def test_noise_that_is_raised_counts_and_a_contrast_that_is_raised_does_not():
    grains = np.random.default_rng(0).normal(0, 1.5, SIZE)
    hazy, raised = picture(100 + grains), picture(100 + 8 * grains)
    assert raised_noise(hazy, hazy) == 0
    assert raised_noise(raised, hazy) > 0.2
    faint = stripe(8.0) + 0.3 * grains
    assert raised_noise(picture(100 + 8 * (stripe(8.0) - 100)), picture(faint)) == 0


def test_the_noise_of_a_picture_is_that_of_its_grains_its_blocks_or_one_level():
    assert noise_step(picture(100.0)) == 1.0
    grains = np.random.default_rng(1).normal(0, 6.0, SIZE)
    assert noise_step(picture(100 + grains)) == pytest.approx(6.0, rel=0.15)  # three sigmas of a third of it
    blocks = np.kron(np.random.default_rng(2).choice([0.0, 5.0], (15, 25)), np.ones((8, 8)))
    assert block_step(np.float32(100 + blocks)) > 0
    assert block_step(np.float32(100 + grains)) < 1.0
