import numpy as np
import pytest
from coat_area import area_and_middle
from hypothesis import given
from hypothesis import strategies as st

from deckline_sim.ship.paint_shapes import bars, blots, dashes, streaks, stripe

WHITE = (1.0, 1.0, 1.0)
coordinates = st.floats(-200, 200)


@given(coordinates, coordinates, st.floats(-3, 3), st.floats(5, 100), st.floats(0.1, 5))
def test_stripe_has_its_area_and_its_middle_on_the_line(x, y, angle, length, width):
    start = np.array([x, y])
    end = start + length * np.array([np.cos(angle), np.sin(angle)])
    area, centroid = area_and_middle(stripe((start, end), width, WHITE))
    assert area == pytest.approx(length * width, rel=1e-2, abs=1e-2)
    np.testing.assert_allclose(centroid, (start + end) / 2, atol=1e-2)


def test_dashes_take_turns_and_stay_on_the_line():
    coat = dashes(((0, 0), (25, 0)), 1.0, [WHITE, (1.0, 1.0, 0.0)], dash_m=4.0, gap_m=6.0)
    assert area_and_middle(coat)[0] == pytest.approx(4 + 4 + 4)
    assert [tuple(c) for c in coat[::6, 2:5]] == [WHITE, (1.0, 1.0, 0.0), WHITE]
    assert coat[:, 0].max() <= 25.0


def test_bars_lie_along_and_across_their_line():
    coat = bars(((3, 4), (3, 10)), [(0.0, 2.0), (5.0, 6.0)], [(-1.0, 1.0), (0.0, 3.0)], WHITE, [[0.5], [0.8]])
    first, second = coat[:6, :2], coat[6:, :2]  # along +y, its right is -x
    np.testing.assert_allclose([first.min(axis=0), first.max(axis=0)], [[2.0, 4.0], [4.0, 6.0]], atol=1e-6)
    np.testing.assert_allclose([second.min(axis=0), second.max(axis=0)], [[0.0, 9.0], [3.0, 10.0]], atol=1e-6)
    np.testing.assert_allclose(coat[:, 5], np.repeat([0.5, 0.8], 6))
    assert area_and_middle(coat)[0] == pytest.approx(4.0 + 3.0)


def test_streaks_fade_to_their_sides_and_ends():
    coat = streaks([(0, 0), (0, 20)], [(10, 0), (10, 20)], [2.0, 4.0], [WHITE, (0, 0, 0)], [0.6, 0.3])
    first, second = coat[:36], coat[36:]
    assert first[:, 5].max() == pytest.approx(0.6)
    assert second[:, 5].max() == pytest.approx(0.3)
    assert np.abs(second[:, 1] - 20).max() == pytest.approx(2.0)
    assert not first[np.abs(first[:, 1]) > 0.9, 5].any()
    assert not first[np.isin(first[:, 0], (0.0, 10.0)), 5].any()
    assert first[:, 2].all() and not second[:, 2].any()


def test_blots_fade_to_their_rims():
    coat = blots([(1, 2), (30, 40)], [3.0, 1.0], [WHITE, WHITE], [0.7, 0.2])
    for blot, middle, radius, strong in ((coat[:36], (1, 2), 3.0, 0.7), (coat[36:], (30, 40), 1.0, 0.2)):
        distance = np.hypot(*(blot[:, :2] - middle).T)
        assert distance.max() == pytest.approx(radius, rel=1e-5)
        np.testing.assert_allclose(blot[:, 5], np.where(distance < 1e-6, strong, 0.0), atol=1e-6)


def test_a_line_without_length_is_named():
    with pytest.raises(ValueError, match=r"\[1, 2\]"):
        bars(((1, 2), (1, 2)), (0, 1), (0, 1), WHITE)
