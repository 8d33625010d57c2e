import numpy as np
import pytest

from deckline.sim.ship.deck_edge import (
    EDGE_MARGIN_M,
    outline,
    random_outline,
    sponson_edge,
    stepped_edge,
    straight_edge,
    tapered_edge,
)

LEFT, RIGHT = np.array([[2.0, -9.0], [150.0, -25.0]]), np.array([[2.0, 9.0], [150.0, -7.0]])


def test_outline_goes_through_its_corners_and_makes_room_for_the_lines():
    stations, port, starboard = outline(200.0, [(0, -15), (200, -15)], [(0, 15), (100, 25), (200, 15)], LEFT, RIGHT)
    assert np.interp(100.0, stations, starboard) == pytest.approx(25.0)
    assert np.interp(198.0, stations, port) == pytest.approx(-15.0)
    assert np.interp(150.0, stations, port) == pytest.approx(-25.0 - EDGE_MARGIN_M - 2.0)


@pytest.mark.parametrize("shape", [stepped_edge, sponson_edge, straight_edge, tapered_edge])
def test_shapes_run_from_stern_to_bow_on_their_side(shape):
    for seed in range(50):
        corners = shape(240.0, 16.0, np.random.default_rng(seed))
        x, y = np.transpose(sorted(corners))
        assert x[0] == 0.0
        assert x[-1] == 240.0
        assert y.min() > 2.0
        assert y.max() < 2.0 * 16.0


def test_random_outlines_are_decks():
    for seed in range(100):
        stations, port, starboard = random_outline(200.0, LEFT, RIGHT, np.random.default_rng(seed))
        assert np.all(starboard - port > 3.0)
        inside = stations <= 150.0
        assert np.all(port[inside] <= np.interp(stations[inside], *LEFT.T) - EDGE_MARGIN_M)
        assert np.all(np.isfinite(port + starboard))
