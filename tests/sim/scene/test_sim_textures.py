"""Textures: shadows, noise, sizes."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from deckline.sim.scene.textures import light_from_ship, noise_field, texture_size
from deckline.sim.scene.weather import sun_direction


@given(st.integers(0, 2**32 - 1))
def test_every_caster_lies_on_the_map_and_light_runs_along_its_depth(seed):
    rng = np.random.default_rng(seed)
    sun, points = sun_direction(rng), rng.uniform(-200.0, 200.0, (30, 3))
    matrix = light_from_ship(sun, points)
    spots = points @ matrix[:3, :3].T + matrix[:3, 3]
    assert np.all((spots > 0.0) & (spots < 1.0))
    step = matrix[:3, :3] @ sun
    np.testing.assert_allclose(step[:2], 0.0, atol=1e-12)
    assert step[2] > 0


def test_a_sun_along_the_ship_is_no_exception():
    matrix = light_from_ship(np.array([1.0, 0.0, 0.0]), np.eye(3))
    assert np.all(np.isfinite(matrix))
    assert np.linalg.matrix_rank(matrix) == 4


def test_noise_is_tileable_and_centred():
    noise = noise_field(64).astype(float)
    np.testing.assert_allclose(noise.mean(axis=(0, 1)), 127.5, atol=2.0)
    inner = np.abs(np.diff(noise, axis=0)).mean()
    assert np.abs(noise[0] - noise[-1]).mean() < 1.5 * inner


def test_deck_textures_halve_evenly():
    for extent in ((333.0, 77.0), (150.0, 31.0), (201.0, 64.5)):
        size = texture_size(np.array(extent), 8.0)
        assert all(n & (n - 1) == 0 for n in size)
        assert size[1] / extent[1] >= 8.0
        assert 5.6 < size[0] / extent[0] < 11.4
