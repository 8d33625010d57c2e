import numpy as np
import pytest

from deckline.sim.ship.clearance import runway_distance
from deckline.sim.ship.layout import class_layout
from deckline.sim.ship.paint import axes
from deckline.sim.ship.plan import DeckSurface
from deckline.sim.ship.ship_class import load_class
from deckline.sim.ship.weathering import damage_coat, plate_coat, rubber_coat, stain_coat

LAYOUT = class_layout(load_class("cvn"))
SURFACE = DeckSurface((0.3, 0.3, 0.3), grain=0.2, wear=0.2)


@pytest.mark.parametrize("seed", range(20))
def test_every_stain_is_valid_paint(seed):
    rng = np.random.default_rng(seed)
    coats = [rubber_coat(LAYOUT, rng), stain_coat(LAYOUT, rng), plate_coat(LAYOUT, SURFACE, rng)]
    coats.append(damage_coat(LAYOUT, 3.4, SURFACE.rgb, rng))
    for coat in coats:
        assert coat.dtype == np.float32
        assert coat.shape[1] == 7
        assert len(coat) % 3 == 0
        assert np.isfinite(coat).all()
        assert np.all((coat[:, 2:] >= 0.0) & (coat[:, 2:] <= 1.0))


@pytest.mark.parametrize("seed", range(20))
def test_rubber_is_dark_and_stays_within_the_landing_area(seed):
    coat = rubber_coat(LAYOUT, np.random.default_rng(seed))
    if not len(coat):
        return
    assert coat[:, 2:5].max() <= 0.12
    assert runway_distance(LAYOUT, coat[:, :2].astype(float)).max() < 2.0
    reach = (coat[:, :2] - LAYOUT.centre_m[0]) @ axes(*LAYOUT.centre_m)[0]
    assert reach.min() > -0.5
    assert reach.max() < axes(*LAYOUT.centre_m)[2] + 1.0


def test_damage_lies_on_the_edge_markings_and_hides_little():
    hidden = []
    for seed in range(40):
        coat = damage_coat(LAYOUT, 3.4, SURFACE.rgb, np.random.default_rng(seed)).astype(float)
        if not len(coat):
            continue
        for line in (LAYOUT.left_m, LAYOUT.right_m):
            along, right, length = axes(*line)
            on_line = coat[np.abs((coat[:, :2] - line[0]) @ right) < 5.0]
            assert np.all(np.abs((on_line[:, :2] - line[0]) @ right) <= 1.8 + 1e-3)
            reach = ((on_line[:, :2] - line[0]) @ along).reshape(-1, 6)
            assert reach.size == 0 or (reach.min() > -1e-3 and reach.max() < length + 1e-3)
            hidden.append(np.ptp(reach, axis=1).sum() / length)
    assert 0.05 < np.mean(hidden) < 0.2
    assert np.max(hidden) < 0.5


def test_damage_keeps_half_of_a_marking_at_times():
    sides = set()
    for seed in range(20):
        coat = damage_coat(LAYOUT, 3.4, SURFACE.rgb, np.random.default_rng(seed)).astype(float)
        right = axes(*LAYOUT.left_m)[1]
        across = ((coat[:, :2] - LAYOUT.left_m[0]) @ right).reshape(-1, 6)
        near = across[np.abs(across).max(axis=1) < 5.0]
        sides |= set(np.round(near.mean(axis=1), 1))
    assert {0.0, 0.9} <= {abs(side) for side in sides}
