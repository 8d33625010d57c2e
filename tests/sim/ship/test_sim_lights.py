import numpy as np
import pytest

from deckline.sim.ship.layout import class_layout, random_layout
from deckline.sim.ship.lights import CENTRE_STRENGTH, DROP_STRENGTH, EDGE_STRENGTH, FLOOD_STRENGTH, RED, deck_lights
from deckline.sim.ship.mesh import box, join
from deckline.sim.ship.paint import axes
from deckline.sim.ship.ship_class import load_class

CVN = class_layout(load_class("cvn"))
ISLAND = box(30.0, 5.0, 0.0, (12.0, 6.0, 15.0), 0.0, (0.5, 0.5, 0.5))


@pytest.mark.parametrize("seed", range(20))
def test_lamps_are_on_the_ship(seed):
    layout = random_layout(np.random.default_rng(seed))
    lamps = deck_lights(layout, seed % 4 > 0, ISLAND, np.random.default_rng(seed))
    low, high = layout.outline_m.min(axis=0), layout.outline_m.max(axis=0)
    assert lamps.dtype == np.float32
    assert lamps.shape[1] == 7
    assert np.all(lamps[:, :2] >= low - [0.1, 5.0])  # the landing aid may stand on an outrigger
    assert np.all(lamps[:, :2] <= high + 0.1)
    assert np.all((lamps[:, 2] > -21.0) & (lamps[:, 2] < layout.deck_height_m))
    assert np.all((lamps[:, 3:6] >= 0.0) & (lamps[:, 3:6] <= 1.0))
    assert np.all(lamps[:, 6] > 0.0)


def lamps_near(lamps, line, strength):
    along, right, length = axes(*line)
    delta = lamps[:, :2] - line[0]
    near = (
        (np.abs(delta @ right) < 1e-3)
        & (delta @ along > 0.01)
        & (delta @ along < length)
        & (lamps[:, 6] == np.float32(strength))
    )
    return np.sort(delta[near] @ along)


def test_runway_lamps_stand_on_their_lines_at_one_pitch():
    lamps = deck_lights(CVN, True, ISLAND, np.random.default_rng(1))
    pitches = [
        np.unique(np.round(np.diff(lamps_near(lamps, line, EDGE_STRENGTH)), 2)) for line in (CVN.left_m, CVN.right_m)
    ]
    assert len(pitches[0]) == 1
    np.testing.assert_array_equal(pitches[0], pitches[1])
    assert np.diff(lamps_near(lamps, CVN.centre_m, CENTRE_STRENGTH)).mean() == pytest.approx(
        pitches[0][0] / 2, abs=0.01
    )


def test_drop_line_hangs_below_the_centre_line():
    lamps = deck_lights(CVN, True, ISLAND, np.random.default_rng(1))
    drop = lamps[(lamps[:, 2] > 0.0) & (lamps[:, 6] == DROP_STRENGTH)]
    assert len(drop) >= 3
    np.testing.assert_allclose(drop[:, 1], CVN.centre_m[0, 1], atol=1e-5)
    np.testing.assert_allclose(drop[:, 3:6], np.broadcast_to(np.float32(RED), (len(drop), 3)))


def test_a_deck_without_runway_marks_none_with_lamps():
    with_runway, without = (deck_lights(CVN, runway, ISLAND, np.random.default_rng(4)) for runway in (True, False))
    assert len(with_runway) > len(without) + 40
    for line in (CVN.left_m, CVN.right_m):
        assert not len(lamps_near(without, line, EDGE_STRENGTH))


def test_lamps_on_land_have_no_stern():
    layout = class_layout(load_class("runway"))
    assert deck_lights(layout, True, ISLAND, np.random.default_rng(0))[:, 2].max() <= 0.0


def test_flood_lamps_hang_on_the_islands_near_sides():
    found = []
    for seed in range(20):
        lamps = deck_lights(CVN, False, ISLAND, np.random.default_rng(seed))
        floods = lamps[lamps[:, 6] == FLOOD_STRENGTH]
        on_port, astern = np.isclose(floods[:, 1], 2.0 - 0.3), np.isclose(floods[:, 0], 24.0 - 0.3)
        assert np.all(on_port | astern)
        np.testing.assert_allclose(floods[:, 2], -15.0, atol=1e-5)
        found += [len(floods)]
    assert max(found) > 2
    bare = deck_lights(CVN, False, join([]), np.random.default_rng(0))
    assert not np.any(bare[:, 6] == FLOOD_STRENGTH)
