import numpy as np
import pytest
from mesh_volume import volume

from deckline.sim.ship.aircraft import KINDS, body, extents, prototype


@pytest.mark.parametrize("kind", KINDS)
def test_prototypes_stand_on_their_wheels_and_are_about_one_long(kind):
    mesh = prototype(kind)
    assert mesh[:, 2].max() == pytest.approx(0.0, abs=0.02)
    assert 0.15 < -mesh[:, 2].min() < 0.6
    assert 0.9 < np.ptp(mesh[:, 0]) < 1.2
    assert len(mesh) < 3 * 600
    np.testing.assert_allclose(np.linalg.norm(mesh[:, 3:6], axis=1), 1.0, atol=1e-4)


@pytest.mark.parametrize("kind", [kind for kind in KINDS if not kind.startswith("helicopter")])
def test_prototypes_are_symmetric_in_extent(kind):
    y = prototype(kind)[:, 1]
    assert y.max() == pytest.approx(-y.min(), abs=0.05)


@pytest.mark.parametrize("kind", ["propeller", "helicopter"])
def test_folded_ones_are_narrower(kind):
    assert extents(f"{kind} folded")[1] < 0.75 * extents(kind)[1]
    assert extents("folded")[1] < extents("swept")[1]


def test_extents_bound_the_prototype():
    for kind in KINDS:
        along, across = extents(kind)
        assert np.abs(prototype(kind)[:, 0]).max() <= along / 2 + 1e-6
        assert np.abs(prototype(kind)[:, 1]).max() <= across / 2 + 1e-6


def test_a_fuselage_of_equal_sections_has_the_volume_of_a_prism():
    mesh = body([0.0, 2.0], [0.5, 0.5], [0.0, 0.0])
    assert volume(mesh) == pytest.approx(2.0 * 1.5 * np.sqrt(3) * 0.25, rel=1e-5)


def test_an_unknown_kind_is_named():
    with pytest.raises(ValueError, match=r"an aircraft's kind must be one of .*, got 'balloon'"):
        prototype("balloon")
