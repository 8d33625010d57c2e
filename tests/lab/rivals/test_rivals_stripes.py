"""Stripes: their response by hand, lines to a fraction of a pixel, and what is no line."""

import numpy as np
import pytest

from deckline_lab.rivals.stripes import StripeConfig, find_stripes, stripe_response
from detect.drawn_deck import BOTTOM, TOP, at, deck


def test_response_is_the_contrast_of_a_matching_stripe() -> None:
    """By hand: three pixels of 90 on 40, of which the middle answers with 50 at width three; an edge gives nothing."""
    image = np.full((1, 40, 3), 40, np.uint8)
    image[0, 19:22] = 90
    response = stripe_response(image, (1, 3))[0]
    assert response[20] == 50
    assert response[10] == 0
    step = np.full((1, 40, 3), 40, np.uint8)
    step[0, 20:] = 90
    assert stripe_response(step, (1, 3))[0].max() == pytest.approx(0)


def test_coloured_paint_is_no_stripe() -> None:
    image = np.full((1, 40, 3), 40, np.uint8)
    image[0, 19:22] = (200, 40, 40)
    assert stripe_response(image, (3,))[0].max() == 0


@pytest.mark.parametrize("share", [0.0, 0.37, 1.0])
def test_a_stripe_is_found_where_it_was_drawn(share: float) -> None:
    (line,) = find_stripes(deck([share]), StripeConfig())
    assert abs(line.top - TOP) <= 2 and abs(line.bottom - BOTTOM) <= 2
    for v in (TOP, 300, BOTTOM):
        assert line.x_at(v) == pytest.approx(at(v, share), abs=0.3)
    assert np.abs(line.points_px[:, 0] - at(line.points_px[:, 1], share)).mean() < 0.3
    assert line.fill > 0.98 and 120 < line.contrast < 145


def test_short_broken_and_flat_things_are_no_lines() -> None:
    dashes = deck([0.3])
    dashes[np.arange(480) % 24 < 12] = 70  # gaps of twelve rows
    assert find_stripes(dashes, StripeConfig()) == []
    flat = np.full((200, 300, 3), 70, np.uint8)
    flat[100:103] = 210
    assert find_stripes(flat, StripeConfig()) == []
    assert find_stripes(np.zeros((5, 5, 3), np.uint8), StripeConfig()) == []
