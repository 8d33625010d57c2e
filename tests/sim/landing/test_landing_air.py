import math

import numpy as np
import pytest

from deckline_sim.landing.air import Gusts, steady_wind, wake
from deckline_sim.landing.aircraft import DYNAMICS_HZ, FT


def test_gusts_have_the_standards_intensities_and_fade_over_its_length():
    speed, height_ft = 67.0, 150.0
    gusts = Gusts(10.0, np.random.default_rng(1))
    steps = np.array([gusts.step(height_ft * FT, speed, 0.0) for _ in range(round(1500 * DYNAMICS_HZ))])
    sigma_w = 0.1 * 10.0
    sigma_u = sigma_w / (0.177 + 0.000823 * height_ft) ** 0.4
    np.testing.assert_allclose(np.std(steps, axis=0), [sigma_u, sigma_u, sigma_w], rtol=0.15)
    ahead = steps[:, 0]
    length_m = height_ft / (0.177 + 0.000823 * height_ft) ** 1.2 * FT
    lag = round(length_m / speed * DYNAMICS_HZ)
    assert np.corrcoef(ahead[:-lag], ahead[lag:])[0, 1] == pytest.approx(math.exp(-1.0), abs=0.12)


def test_the_wake_adds_its_own_turbulence():
    gusts = Gusts(0.0, np.random.default_rng(2))
    steps = [gusts.step(30.0, 67.0, 0.7) for _ in range(round(300 * DYNAMICS_HZ))]
    np.testing.assert_allclose(np.std(steps, axis=0), 0.7, rtol=0.1)


def test_the_wake_sinks_behind_the_ship_rises_at_its_ramp_and_ends():
    assert wake(150.0, 0.0, 10.0, 1.0) == pytest.approx((0.5, 0.8, 0.6))
    assert wake(0.0, 0.0, 10.0, 1.0)[0] < 0.0
    assert wake(150.0, 40.0, 10.0, 1.0)[0] == pytest.approx(0.25)
    assert wake(1001.0, 0.0, 10.0, 1.0) == wake(150.0, 0.0, 10.0, 0.0) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("from_deg", "expected"), [(0.0, (-5.0, 0.0)), (90.0, (0.0, -5.0)), (-90.0, (0.0, 5.0)), (180.0, (5.0, 0.0))]
)
def test_wind_comes_from_its_direction(from_deg, expected):
    np.testing.assert_allclose(steady_wind(np.array([1.0, 0.0]), 5.0, from_deg), [*expected, 0.0], atol=1e-12)
