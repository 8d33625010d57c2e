from dataclasses import replace

import numpy as np
import pytest

from deckline.config import GRADES, Sensors, deck
from deckline.localize.depth import locate_points
from deckline.types import SIDES, DepthMode
from deckline_lab.evaluation import cramer_rao as bound_module
from deckline_lab.evaluation.cramer_rao import cramer_rao
from runway_scene import (
    ANY_ANGLE,
    LEFT,
    PARALLEL_CENTRE,
    PARALLEL_RIGHT,
    STILL,
    approach,
    azimuth,
    detection,
    line_points,
    still_deck,
    with_depth,
)

AT_M = PARALLEL_CENTRE.p0_m
FRAME = approach(120.0, 10.0, right=PARALLEL_RIGHT)
NEARLY_PARALLEL = {"angle_sigma_deg": float(np.rad2deg(0.5e-3))}


@pytest.fixture
def pixel_noise(monkeypatch):
    """Only the detector's noise, and nothing known of the lines' angle."""
    monkeypatch.setattr(deck, "CALM_HEAVE_M", 0.0)
    return still_deck(sensors=GRADES["exact"], **ANY_ANGLE)


def pixels(sigma_px=0.5, count=20):
    found = detection(FRAME, PARALLEL_RIGHT, count, sigma_px)
    return (
        {side: getattr(found, side).points_px for side in SIDES},
        {side: getattr(found, side).sigma_px for side in SIDES},
    )


POINTS, SIGMA = pixels()


def regression(side, truth, config, correlation=0.0):
    """Covariance (2, 2) of offset and azimuth by generalised least squares on the deck."""
    angle = azimuth(truth)
    along, right = np.array([np.cos(angle), np.sin(angle), 0.0]), np.array([-np.sin(angle), np.cos(angle), 0.0])
    ground = locate_points(FRAME, POINTS[side], SIGMA[side], np.arange(20), DepthMode.COARSE, config.noise)
    design = np.column_stack([np.ones(20), (ground.points_m - AT_M) @ along])
    across = ground.pixel_m @ right
    lag = np.abs(np.subtract.outer(np.arange(20), np.arange(20)))
    return np.linalg.inv(design.T @ np.linalg.solve(np.outer(across, across) * correlation**lag, design))


@pytest.mark.parametrize("correlation", [0.0, 0.5, -0.3])
def test_with_pixel_noise_alone_it_is_a_generalised_regression_on_the_deck(correlation, pixel_noise):
    shuffled = np.random.default_rng(0).permutation(20)
    mixed = {**POINTS, "right": POINTS["right"][shuffled]}, {**SIGMA, "right": SIGMA["right"][shuffled]}
    lines = cramer_rao(FRAME, *mixed, "coarse", pixel_noise, AT_M, correlation=correlation).lines
    for first, side, truth in ((0, "left", LEFT), (3, "right", PARALLEL_RIGHT)):
        # A row's v has a sigma of 0.05 px, a percent of the variance of lines as oblique as these.
        expected = regression(side, truth, pixel_noise, correlation)
        np.testing.assert_allclose(lines[first : first + 2, first : first + 2], expected, rtol=0.05, atol=1e-9)
    assert np.abs(lines[:2, 3:5]).max() < 1e-3 * lines[0, 0]  # the lines are independent
    assert np.sqrt(lines[2, 2]) == pytest.approx(1e-4)  # floor of what is known exactly


def test_bound_falls_with_the_noise_and_with_more_points(pixel_noise):
    one, double, many = (
        np.diag(cramer_rao(FRAME, *measured, "coarse", pixel_noise, AT_M).lines)[[0, 1, 3, 4]]
        for measured in ((POINTS, SIGMA), pixels(sigma_px=1.0), pixels(count=80))
    )
    np.testing.assert_allclose(double, 4 * one, rtol=0.05)
    assert (many < one / 3).all()


def test_knowing_more_is_never_worse():
    def variances(mode, **deck):
        config = still_deck(**{**NEARLY_PARALLEL, **deck})
        bound = cramer_rao(with_depth(FRAME), POINTS, SIGMA, mode, config, AT_M, relative=True)
        return np.concatenate([np.diag(bound.lines), np.diag(bound.centre)])

    base = variances("auto")
    for worse in (
        variances("coarse"),
        variances("fine"),
        variances("auto", **ANY_ANGLE),
        variances("auto", slope_deg=float(np.rad2deg(0.02))),
    ):
        assert (worse >= base * (1 - 1e-9)).all()
        assert (worse > base * 1.01).any()
    known = variances("auto", width_m=14.7, width_sigma_m=0.01)
    assert (known <= base * (1 + 1e-9)).all()
    assert known[2] < 0.9 * base[2]  # a known width shows the height above the deck


def test_painted_centre_line_helps(monkeypatch, pixel_noise):
    monkeypatch.setattr(bound_module, "CENTRE_SIGMA_M", 0.0)
    monkeypatch.setattr(bound_module, "CENTRE_SIGMA_RAD", 0.0)
    config = replace(pixel_noise, deck=replace(pixel_noise.deck, angle_sigma_deg=0.3))
    points, sigma = pixels(sigma_px=1.0)
    centre = line_points(FRAME, PARALLEL_CENTRE, 20, 1.0)
    three = {**points, "centre": centre.points_px}, {**sigma, "centre": centre.sigma_px}
    plain, painted = (cramer_rao(FRAME, *p, "coarse", config, AT_M).centre for p in ((points, sigma), three))
    # The middle of two lines has half their variance; a third like them adds as much as one.
    assert painted[0, 0] / plain[0, 0] == pytest.approx(2 / 3, abs=0.02)
    assert painted[1, 1] < 0.8 * plain[1, 1]


def test_position_errors_of_the_aircraft_do_not_count_relative_to_it():
    configs = STILL, still_deck(sensors=Sensors(position_m=5.0))
    world, relative = (
        [cramer_rao(FRAME, POINTS, SIGMA, "coarse", config, AT_M, relative).centre for config in configs]
        for relative in (False, True)
    )
    # 3 m beside the line and 10 m above the deck: half as high again shifts the line by half the distance again.
    assert np.sqrt(world[1][0, 0]) == pytest.approx(np.hypot(5.0, 5.0 * 3 / 10), rel=0.02)
    assert np.sqrt(world[0][0, 0]) < 0.4
    assert relative[1][1, 1] == pytest.approx(relative[0][1, 1], rel=1e-6)
    assert np.sqrt(relative[1][2, 2]) == pytest.approx(np.hypot(5.0, 0.1), rel=1e-6)


def test_offsets_are_bounded_at_the_reference_point():
    ends = PARALLEL_CENTRE.p0_m, PARALLEL_CENTRE.p1_m
    near, far = (cramer_rao(FRAME, POINTS, SIGMA, "coarse", STILL, at_m).centre for at_m in ends)
    jacobian = np.eye(3)
    jacobian[0, 1] = np.linalg.norm((ends[1] - ends[0])[:2])
    np.testing.assert_allclose(jacobian @ near @ jacobian.T, far, rtol=1e-4, atol=1e-8)


@pytest.mark.parametrize(
    ("sides", "missing", "named"),
    [(("left",), "", "got left"), (SIDES, "deck_z_m", "deck height.*coarse"), (SIDES, "world_from_body", "pose")],
)
def test_what_is_missing_for_a_bound_is_named(sides, missing, named):
    frame = replace(FRAME, **{missing: None}) if missing else FRAME
    with pytest.raises(ValueError, match=rf"exact\.png.*{named}"):
        cramer_rao(frame, {side: POINTS[side] for side in sides}, SIGMA, "coarse", STILL)
