import numpy as np
import pytest

from deckline_sim.ship.layout import class_layout, random_layout
from deckline_sim.ship.ship_class import load_class


@pytest.fixture(scope="session")
def cvn():
    return class_layout(load_class("cvn"))


@pytest.fixture(scope="session")
def volume():
    """Volume, m^3, of a closed mesh (N, 9); negative where its normals point inwards."""

    def enclose(mesh):
        a, b, c = (mesh[k::3, :3].astype(np.float64) - mesh[:, :3].mean(axis=0, dtype=np.float64) for k in range(3))
        return float(np.sum(a * np.cross(b, c)) / 6)

    return enclose


@pytest.fixture(scope="session")
def afloat():
    """Random layouts that have a hull, each with its generator."""

    def draw(count):
        drawn = [(random_layout(rng), rng) for rng in map(np.random.default_rng, range(2 * count))]
        return [(layout, rng) for layout, rng in drawn if not layout.on_land][:count]

    return draw
