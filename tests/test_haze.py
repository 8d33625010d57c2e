import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deckline.haze import add_haze, beta_from_visibility, transmission, visibility_from_beta


def test_koschmieder_two_and_five_percent():
    assert beta_from_visibility(1000.0) == pytest.approx(3.912e-3, rel=1e-4)
    assert beta_from_visibility(1000.0, contrast=0.05) == pytest.approx(2.996e-3, rel=1e-4)
    assert beta_from_visibility(float("inf")) == 0.0
    assert visibility_from_beta(0.0) == float("inf")


@given(st.floats(1.0, 1e6))
def test_visibility_round_trip(visibility):
    assert visibility_from_beta(beta_from_visibility(visibility)) == pytest.approx(visibility)


@pytest.mark.parametrize("visibility", [0.0, -1.0, float("nan")])
def test_impossible_visibility_is_named(visibility):
    with pytest.raises(ValueError, match=f"positive metres, got {visibility}"):
        beta_from_visibility(visibility)


def test_negative_extinction_is_named():
    with pytest.raises(ValueError, match="not be negative, got -1"):
        visibility_from_beta(-1)


def test_transmission_at_the_visibility_is_the_contrast_threshold():
    beta = beta_from_visibility(800.0)
    np.testing.assert_allclose(transmission([0.0, 800.0, np.inf, np.nan], beta), [1, 0.02, 0, 0], rtol=1e-5)
    assert (transmission([0.0, np.inf, np.nan], 0.0) == 1).all()


def test_add_haze_is_the_scattering_model():
    clear = np.full((2, 3, 3), 100, dtype=np.uint8)
    ranges = np.array([[0.0, 100.0, 500.0], [np.nan, np.inf, 250.0]])
    hazy = add_haze(clear, ranges, 0.004, [200, 210, 220])
    t = np.exp(-0.004 * np.nan_to_num(ranges, nan=np.inf))[..., None]
    np.testing.assert_array_equal(hazy, np.rint(100 * t + np.array([200, 210, 220]) * (1 - t)).astype(np.uint8))
    assert hazy.dtype == np.uint8
    assert (clear == 100).all()


@given(st.integers(0, 2**31))
def test_thicker_haze_is_nearer_to_the_airlight(seed):
    rng = np.random.default_rng(seed)
    clear = rng.integers(0, 256, (4, 5, 3)).astype(np.uint8)
    ranges, airlight = rng.uniform(1, 500, (4, 5)), rng.uniform(0, 255, 3)
    thin, thick = (add_haze(clear, ranges, beta, airlight).astype(float) for beta in (0.001, 0.01))
    assert (np.abs(thick - airlight) <= np.abs(thin - airlight) + 1.0).all()  # one grey level of rounding


def test_shapes_that_differ_are_named():
    with pytest.raises(ValueError, match=r"image is \(2, 3\) but range is \(3, 2\)"):
        add_haze(np.zeros((2, 3, 3), np.uint8), np.zeros((3, 2)), 0.1, [1, 2, 3])
