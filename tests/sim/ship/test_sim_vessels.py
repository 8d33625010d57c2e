import numpy as np
import pytest
from mesh_volume import volume

from deckline.sim.ship.hull import DRAUGHT_M
from deckline.sim.ship.vessels import VESSELS, body, foam_mesh, vessel_mesh


@pytest.mark.parametrize("kind", VESSELS)
def test_vessels_float_on_their_waterline_and_have_their_length(kind):
    for seed in range(5):
        mesh, length = vessel_mesh(kind, np.random.default_rng(seed))
        assert mesh[:, 2].max() >= -1e-3  # reaches the water
        assert mesh[:, 2].min() < -0.02 * length
        assert 0.9 * length < np.ptp(mesh[:, 0]) < 1.35 * length
        assert mesh[:, 6:].min() >= 0.0 and mesh[:, 6:].max() <= 1.0
        assert len(mesh) < 3 * 30_000
        np.testing.assert_allclose(np.linalg.norm(mesh[:, 3:6], axis=1), 1.0, atol=1e-4)


def test_a_hull_is_closed_and_displaces_less_than_its_box():
    mesh = body(100.0, 12.0, 6.0, (0.5, 0.5, 0.5), (0.1, 0.1, 0.1))
    box = 100 * 12 * (6 + DRAUGHT_M)
    assert 0.5 * box < volume(mesh) < box


def test_foam_lies_on_the_water_astern_and_looks_up():
    mesh = foam_mesh(100.0, 12.0, np.random.default_rng(0))
    assert mesh[:, 0].max() <= -50.0
    np.testing.assert_allclose(mesh[:, 2], -0.03)
    np.testing.assert_allclose(mesh[:, 5], -1.0)


def test_an_unknown_vessel_is_named():
    with pytest.raises(ValueError, match=r"a vessel must be one of .*, got 'raft'"):
        vessel_mesh("raft", np.random.default_rng(0))
