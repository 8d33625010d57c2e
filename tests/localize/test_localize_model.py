import numpy as np
import pytest

from deckline.config import Deck
from deckline.localize.model import (
    NUISANCES,
    DeckPlane,
    FitState,
    linearize_deck_prior,
    linearize_height_prior,
    linearize_measurements,
    linearize_nuisance_prior,
)
from deckline.types import SIDES
from runway_scene import LEFT, LENS, NOISE, PARALLEL_RIGHT, approach, azimuth, detection, observe_lines, with_depth

ALONG = np.array([np.cos(azimuth(LEFT)), np.sin(azimuth(LEFT))])
PLANE = DeckPlane(np.array([-40.0, 35.0]), np.stack([ALONG, [-ALONG[1], ALONG[0]]]), np.array([0.01, 0.02]))
FRAME = approach(70.0, 8.0, right=PARALLEL_RIGHT)
TRUTH = FitState(
    np.stack([line.p0_m[:2] + 40 * ALONG for line in (LEFT, PARALLEL_RIGHT)]),
    np.full(2, azimuth(LEFT)),
    float(LEFT.p0_m[2]),
    np.zeros(NUISANCES),
)


def measure(frame, mode="auto", sides=SIDES, shift_px=0.0):
    """Observations of points that lie `shift_px` beside the lines."""
    found = detection(frame, PARALLEL_RIGHT, 15, sigma_px=0.5)
    for side in sides:
        getattr(found, side).points_px[:, 0] += shift_px
    return observe_lines(frame, found, mode, sides)[0]


def derivative(residuals, k, size, step_size):
    """Central difference of the expectations, which are measurements less residuals."""
    step = np.zeros(size)
    step[k] = step_size
    return (residuals(TRUTH.step(-step)) - residuals(TRUTH.step(step))) / (2 * step_size)


@pytest.mark.parametrize("camera", [FRAME.camera, LENS], ids=["pinhole", "distorted"])
def test_residuals_vanish_at_the_truth_and_the_jacobian_equals_finite_differences(camera):
    frame = approach(70.0, 8.0, roll=0.3, right=PARALLEL_RIGHT, camera=camera)
    observations = measure(with_depth(frame))

    def residuals(state):
        return np.concatenate([t.residuals for t in linearize_measurements(observations, state, PLANE, NOISE)])

    pixels, depths = linearize_measurements(observations, TRUTH, PLANE, NOISE)
    assert len(pixels.residuals) == 30
    assert len(depths.residuals) > 20
    np.testing.assert_allclose(pixels.residuals, 0, atol=1e-5)
    # 0.05 % of depth: inverse depth behind a lens is not linear between pixels.
    np.testing.assert_allclose(depths.residuals, 0, atol=0.05)
    jacobian = np.vstack([pixels.jacobian, depths.jacobian])
    for k in range(jacobian.shape[1]):
        scale = np.abs(jacobian[:, k]).max()
        assert scale > 1e-3, k
        numerical = derivative(residuals, k, jacobian.shape[1], 1e-5)
        np.testing.assert_allclose(jacobian[:, k], numerical, atol=2e-4 * scale)


def test_pixel_residual_is_the_distance_from_the_line_in_sigma():
    observations = measure(FRAME, sides=("left",), shift_px=1.0)
    residuals = linearize_measurements(observations, TRUTH.select([0]), PLANE, NOISE)[0].residuals
    np.testing.assert_allclose(np.abs(residuals), 2.0, rtol=0.02)  # 1 px of u at 0.5 px; a row's own sigma is small


def test_coarse_mode_uses_no_depth():
    observations = measure(with_depth(FRAME), "coarse")
    assert len(linearize_measurements(observations, TRUTH, PLANE, NOISE)[1].residuals) == 0


def test_priors_of_nuisances_and_reported_height_are_in_sigma():
    state = TRUTH.step(np.array([0, 0, 0, 0, 0.3, *np.arange(6.0)]))
    np.testing.assert_allclose(linearize_nuisance_prior(state).residuals, -np.arange(6.0))
    sigma = np.hypot(NOISE.deck_z_m, NOISE.position_m)
    assert linearize_height_prior(state, LEFT.p0_m[2], NOISE).residuals[0] == pytest.approx(-0.3 / sigma)
    assert len(linearize_height_prior(state, None, NOISE).residuals) == 0


@pytest.mark.parametrize(
    "names", [("left", "right"), ("left", "right", "centre"), ("left", "centre"), ("right", "centre")]
)
def test_deck_prior_holds_at_the_truth_and_its_jacobian_equals_finite_differences(names):
    deck = Deck(width_m=14.7, width_sigma_m=0.3, angle_deg=float(np.rad2deg(0.01)))
    offsets = {"left": -7.35, "centre": 0.0, "right": 7.35}
    turns = {"left": -0.005, "centre": 0.0, "right": 0.005}
    azimuths = np.array([azimuth(LEFT) + turns[name] for name in names])
    state = FitState(np.stack([offsets[name] * PLANE.axes[1] for name in names]), azimuths, 6.0, np.zeros(NUISANCES))
    terms = linearize_deck_prior(names, state, deck)
    assert len(terms.residuals) == (4 if len(names) == 3 else 2)
    np.testing.assert_allclose(terms.residuals, 0, atol=0.02)  # widths are exact across the mean direction only
    for k in range(2 * len(names)):
        step = np.zeros(terms.jacobian.shape[1])
        step[k] = 1e-4
        low, high = (linearize_deck_prior(names, state.step(sign * step), deck).residuals for sign in (-1, 1))
        np.testing.assert_allclose(terms.jacobian[:, k], (low - high) / 2e-4, rtol=1e-3, atol=0.2)


def test_single_line_has_no_deck_prior():
    one = FitState(np.zeros((1, 2)), np.zeros(1), 0.0, np.zeros(NUISANCES))
    assert linearize_deck_prior(("left",), one, Deck(width_m=14.7)).jacobian.shape == (0, 9)
