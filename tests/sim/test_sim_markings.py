from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deckline.sim.layout import cvn_layout
from deckline.sim.markings import CVN_EDGE, deck_coat, edge_coat, random_edge, random_surface, smear_coat
from deckline.sim.paint import axes
from deckline.sim.structure import runway_distance

seeds = st.integers(0, 2**32 - 1)
LAYOUT = cvn_layout()


@pytest.mark.parametrize("kind", ["ladder", "stripe", "double", "dashed"])
def test_every_kind_of_edge_has_its_middle_on_the_line(kind):
    coat = edge_coat(LAYOUT.left_m, replace(CVN_EDGE, kind=kind))
    along, right, length = axes(*LAYOUT.left_m)
    across = (coat[:, :2] - LAYOUT.left_m[0]) @ right
    assert across.min() == pytest.approx(-CVN_EDGE.width_m / 2, abs=1e-3)
    assert across.max() == pytest.approx(CVN_EDGE.width_m / 2, abs=1e-3)
    reach = (coat[:, :2] - LAYOUT.left_m[0]) @ along
    assert reach.min() == pytest.approx(0.0, abs=1e-3)
    assert length - CVN_EDGE.pitch_m <= reach.max() <= length + 1e-3


@given(seeds)
@settings(max_examples=40, deadline=None)
def test_random_edges_are_narrow_and_lighter_than_their_deck(seed):
    rng = np.random.default_rng(seed)
    style, surface = random_edge(rng), random_surface(rng)
    assert 0.5 <= style.width_m <= 3.8
    assert style.pitch_m > style.bar_m
    assert np.mean(style.rgb) > np.mean(surface.rgb)


def test_opacity_thins_an_edge():
    coat = edge_coat(LAYOUT.left_m, replace(CVN_EDGE, opacity=0.3))
    np.testing.assert_allclose(coat[:, 5], 0.3)


@pytest.mark.parametrize(("line", "inward"), [(LAYOUT.left_m, 1.0), (LAYOUT.right_m, -1.0)])
def test_smeared_paint_keeps_its_outer_edge(line, inward):
    style = replace(CVN_EDGE, smear=0.5, smear_m=4.0)
    coat = smear_coat(line, inward, style, np.random.default_rng(0))
    outside = runway_distance(LAYOUT, coat[:, :2].astype(float))
    assert outside.max() == pytest.approx(style.width_m / 2, abs=1e-3)
    assert outside.min() == pytest.approx(-style.width_m / 2 - style.smear_m, abs=1e-3)
    assert not coat[outside < -style.width_m / 2 - 3.9, 5].any()


def test_edges_are_the_topmost_paint_and_missing_without_a_runway():
    edges = [edge_coat(line, CVN_EDGE) for line in (LAYOUT.left_m, LAYOUT.right_m)]
    coat = deck_coat(LAYOUT, CVN_EDGE, True, np.random.default_rng(3))
    np.testing.assert_array_equal(coat[-len(edges[1]) :], edges[1])
    np.testing.assert_array_equal(coat[-len(edges[1]) - len(edges[0]) : -len(edges[1])], edges[0])
    bare = deck_coat(LAYOUT, CVN_EDGE, False, np.random.default_rng(3))
    assert len(bare) < len(coat) - len(edges[0]) - len(edges[1])
