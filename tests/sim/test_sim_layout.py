import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deckline.sim.config import SimConfig
from deckline.sim.layout import cvn_layout, paper_layout, random_layout, world_points
from deckline.sim.paint import axes
from deckline.sim.ship import build_ship
from deckline.sim.structure import runway_distance


def angle_deg(line):
    along = axes(*line)[0]
    return np.degrees(np.arctan2(-along[1], along[0]))


def test_paper_lines_are_the_published_ones():
    layout = paper_layout()
    for line, (slope, constant) in ((layout.left_m, (0.163, -35.788523)), (layout.right_m, (0.15632, -20.889669))):
        world = world_points(layout, line)
        np.testing.assert_allclose(slope * world[:, 0] + world[:, 1] + constant, 0.0, atol=1e-9)
        np.testing.assert_allclose(world[:, 2], 6.08)
        assert np.linalg.norm(world[1] - world[0]) == pytest.approx(220.0)
        assert world[1, 0] < world[0, 0]  # landing runs towards -x
    assert layout.sea_z_m == pytest.approx(26.08)
    assert layout.world_from_ship.apply([0.0, 0.0, 0.0])[0] == pytest.approx(10.0)


def test_cvn_has_the_public_dimensions():
    layout = cvn_layout()
    assert angle_deg(layout.left_m) == pytest.approx(8.49)
    assert angle_deg(layout.right_m) == pytest.approx(8.49)
    assert -runway_distance(layout, layout.centre_m)[0] == pytest.approx(10.9)
    assert [axes(*line)[2] for line in (layout.left_m, layout.right_m)] == pytest.approx([218.0, 239.0])
    assert np.ptp(layout.outline_m, axis=0) == pytest.approx([332.85, 76.8], abs=1.0)
    assert layout.sea_z_m == pytest.approx(0.0)


def assert_lines_lie_on_deck(layout, margin_m):
    for line in (layout.left_m, layout.right_m):
        for point in line[0] + np.linspace(0, 1, 40)[:, None] * (line[1] - line[0]):
            port, starboard = layout.edges_at(point[0])
            assert port + margin_m <= point[1] <= starboard - margin_m
            assert 0 <= point[0] <= layout.length_m


def test_named_ships_carry_their_lines():
    assert_lines_lie_on_deck(paper_layout(), 1.5)
    assert_lines_lie_on_deck(cvn_layout(), 1.5)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_random_ships_carry_their_lines_left_left_of_right(seed):
    layout = random_layout(np.random.default_rng(seed))
    assert_lines_lie_on_deck(layout, 1.5)
    _, right, _ = axes(*layout.centre_m)
    for k in (0, 1):
        assert 12.0 < (layout.right_m[k] - layout.left_m[k]) @ right < 32.0
    assert np.all(np.diff(layout.stations_m) > 0)
    assert np.all(layout.port_m < layout.starboard_m)


@given(st.integers(0, 2**31))
@settings(max_examples=25, deadline=None)
def test_nothing_stands_on_the_runway(seed):
    ship, runway, _ = build_ship(SimConfig(preset="train", seed=seed), 0)
    above = ship.solids[ship.solids[:, 2] < -0.1]
    if not runway or not len(above):
        return
    start, end = ship.layout.centre_m
    along, _, length = axes(start, end)
    s = (above[:, :2] - start) @ along
    # Radar yards may reach over the edge of the landing area, high up.
    beside = above[(s > 0) & (s < length) & (above[:, 2] > -4.0)]
    assert not len(beside) or runway_distance(ship.layout, beside[:, :2]).min() > 0.0
