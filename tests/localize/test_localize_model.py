import numpy as np
import pytest

from deckline.localize import DeckConfig, LocalizeConfig, NoiseConfig
from deckline.localize.model import (
    NUISANCES,
    Deck,
    State,
    deck_terms,
    height_term,
    measured_terms,
    nuisance_terms,
)
from deckline.localize.ransac import fit_pixel_line
from deckline.localize.sight import sight
from deckline.types import SIDES
from runway_scene import LEFT as LEFT_LINE
from runway_scene import LENS, approach, azimuth, detection, with_depth
from runway_scene import PARALLEL_RIGHT as RIGHT_LINE

NOISE = NoiseConfig()
ALONG = np.array([np.cos(azimuth(LEFT_LINE)), np.sin(azimuth(LEFT_LINE))])
DECK = Deck(np.array([-40.0, 35.0]), np.stack([ALONG, [-ALONG[1], ALONG[0]]]), np.array([0.01, 0.02]))


def view_of(frame, config=None):
    found = detection(frame, RIGHT_LINE, 15)
    points = {side: getattr(found, side) for side in SIDES}
    config = config or LocalizeConfig()
    lines = {
        side: fit_pixel_line(points[side], frame.camera, config.ransac, np.random.default_rng(0)) for side in SIDES
    }
    return sight(frame, points, lines, config)[0]


def truth():
    points = np.stack([line.p0_m[:2] + 40 * ALONG for line in (LEFT_LINE, RIGHT_LINE)])
    return State(points, np.full(2, azimuth(LEFT_LINE)), float(LEFT_LINE.p0_m[2]), np.zeros(NUISANCES))


@pytest.mark.parametrize("camera", [None, LENS], ids=["pinhole", "distorted"])
def test_residuals_vanish_at_the_truth_and_derivatives_are_numerical_ones(camera):
    frame = approach(70.0, 8.0, roll=0.3, right=RIGHT_LINE, **({} if camera is None else {"camera": camera}))
    view = view_of(with_depth(frame))

    def residuals(state):
        return np.concatenate([terms.residuals for terms in measured_terms(view, state, DECK, NOISE)])

    pixels, depths = measured_terms(view, truth(), DECK, NOISE)
    assert len(pixels.residuals) == 30
    assert len(depths.residuals) > 20
    np.testing.assert_allclose(pixels.residuals, 0, atol=1e-5)
    np.testing.assert_allclose(
        depths.residuals, 0, atol=0.05
    )  # of a percent: inverse depth behind a lens is not linear
    jacobian = np.vstack([pixels.jacobian, depths.jacobian])
    for k in range(jacobian.shape[1]):
        step = np.zeros(jacobian.shape[1])
        step[k] = 1e-5
        numerical = (residuals(truth().moved(-step)) - residuals(truth().moved(step))) / 2e-5
        scale = np.abs(jacobian[:, k]).max()
        assert scale > 1e-3, k
        np.testing.assert_allclose(jacobian[:, k], numerical, atol=2e-4 * scale)


def test_a_points_residual_is_its_distance_across_the_line_in_sigma():
    frame = approach(70.0, 8.0, right=RIGHT_LINE)
    found = detection(frame, RIGHT_LINE, 15, sigma_px=0.5)
    moved = found.left.points_px + np.array([1.0, 0.0])
    points = {"left": type(found.left)(moved, found.left.confidence, found.left.sigma_px)}
    config = LocalizeConfig()
    lines = {"left": fit_pixel_line(points["left"], frame.camera, config.ransac, np.random.default_rng(0))}
    view, _ = sight(frame, points, lines, config)
    state = truth()
    one = State(state.points_m[:1], state.azimuths_rad[:1], state.z_m, state.nuisances)
    residuals = measured_terms(view, one, DECK, NOISE)[0].residuals
    np.testing.assert_allclose(np.abs(residuals), 2.0, rtol=0.02)  # 1 px of u at 0.5 px; a row's own sigma is small


def test_depth_is_not_looked_at_in_coarse_mode():
    frame = with_depth(approach(70.0, 8.0, right=RIGHT_LINE))
    assert len(measured_terms(view_of(frame, LocalizeConfig(mode="coarse")), truth(), DECK, NOISE)[1].residuals) == 0


def test_nuisances_and_the_reported_height_pull_by_their_sigma():
    state = truth().moved(np.array([0, 0, 0, 0, 0.3, *np.arange(6.0)]))
    np.testing.assert_allclose(nuisance_terms(state).residuals, -np.arange(6.0))
    sigma = np.hypot(NOISE.deck_z_m, NOISE.position_m)
    assert height_term(state, LEFT_LINE.p0_m[2], NOISE).residuals[0] == pytest.approx(-0.3 / sigma)
    assert len(height_term(state, None, NOISE).residuals) == 0


@pytest.mark.parametrize(
    "names", [("left", "right"), ("left", "right", "centre"), ("left", "centre"), ("right", "centre")]
)
def test_what_is_known_of_the_deck_holds_at_the_truth_and_its_derivatives_are_numerical_ones(names):
    config = LocalizeConfig(runway_width_m=14.7, deck=DeckConfig(angle_rad=0.01))
    offsets = {"left": -7.35, "centre": 0.0, "right": 7.35}
    turns = {"left": -0.005, "centre": 0.0, "right": 0.005}
    across = DECK.axes[1]
    azimuths = np.array([azimuth(LEFT_LINE) + turns[name] for name in names])
    state = State(np.stack([offsets[name] * across for name in names]), azimuths, 6.0, np.zeros(NUISANCES))
    terms = deck_terms(names, state, config)
    assert len(terms.residuals) == (4 if len(names) == 3 else 2)
    np.testing.assert_allclose(terms.residuals, 0, atol=0.02)  # widths are exact across the mean direction only
    for k in range(2 * len(names)):
        step = np.zeros(terms.jacobian.shape[1])
        step[k] = 1e-4
        moved = [deck_terms(names, state.moved(sign * step), config).residuals for sign in (-1, 1)]
        np.testing.assert_allclose(terms.jacobian[:, k], (moved[0] - moved[1]) / 2e-4, rtol=1e-3, atol=0.2)


def test_a_line_alone_knows_nothing():
    one = State(np.zeros((1, 2)), np.zeros(1), 0.0, np.zeros(NUISANCES))
    assert deck_terms(("left",), one, LocalizeConfig(runway_width_m=14.7)).jacobian.shape == (0, 9)
