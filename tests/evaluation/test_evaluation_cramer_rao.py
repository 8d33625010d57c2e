from dataclasses import replace

import numpy as np
import pytest

from deckline.evaluation.cramer_rao import cramer_rao
from deckline.localize import AgreementConfig, DeckConfig, LocalizeConfig, NoiseConfig
from deckline.localize.depth import deck_points
from deckline.types import SIDES, DepthMode
from runway_scene import LEFT, PARALLEL_CENTRE, PARALLEL_RIGHT, approach, detection, line_points, with_depth

AT_M = PARALLEL_CENTRE.p0_m
FREE, PARALLEL = AgreementConfig(parallel_rad=np.inf), AgreementConfig(parallel_rad=1e-3)
ONLY_PIXELS = NoiseConfig(
    depth_fraction=0, attitude_rad=0, position_m=0, deck_z_m=0, focal_fraction=0, depth_scale=0, min_pixel=1e-3
)
FRAME = approach(120.0, 10.0, right=PARALLEL_RIGHT)


def pixels(frame, sigma_px=0.5, count=20):
    found = detection(frame, PARALLEL_RIGHT, count, sigma_px)
    return (
        {side: getattr(found, side).points_px for side in SIDES},
        {side: getattr(found, side).sigma_px for side in SIDES},
    )


def test_with_pixel_noise_alone_it_is_a_weighted_regression_on_the_deck():
    config = LocalizeConfig(noise=ONLY_PIXELS, agreement=FREE)
    points, sigma = pixels(FRAME)
    bound = cramer_rao(FRAME, points, sigma, "coarse", config, AT_M)
    angle = np.arctan2(*(LEFT.p1_m - LEFT.p0_m)[1::-1])
    along, right = np.array([np.cos(angle), np.sin(angle), 0.0]), np.array([-np.sin(angle), np.cos(angle), 0.0])
    ground = deck_points(FRAME, points["left"], sigma["left"], np.arange(20), DepthMode.COARSE, ONLY_PIXELS)
    design = np.column_stack([np.ones(20), (ground.points_m - AT_M) @ along])
    across = ground.pixel_m @ right
    expected = np.linalg.inv((design / across[:, None] ** 2).T @ design)
    # A row's v is taken as 0.05 px unsure, a percent of the variance of lines as oblique as these.
    np.testing.assert_allclose(bound.lines[:2, :2], expected, rtol=0.05, atol=1e-9)
    assert np.abs(bound.lines[:2, 3:5]).max() < 1e-3 * bound.lines[0, 0]  # the lines know nothing of each other
    assert np.sqrt(bound.lines[2, 2]) == pytest.approx(
        1e-4
    )  # what is known exactly is known to a tenth of a millimetre


@pytest.mark.parametrize("correlation", [0.5, -0.3])
def test_points_that_err_alike_are_a_generalised_regression(correlation):
    """With the whole covariance of the points, of which the bound knows only each point's neighbour."""
    config = LocalizeConfig(noise=ONLY_PIXELS, agreement=FREE)
    points, sigma = pixels(FRAME)
    shuffled = np.random.default_rng(0).permutation(20)
    mixed = {**points, "right": points["right"][shuffled]}, {**sigma, "right": sigma["right"][shuffled]}
    bound = cramer_rao(FRAME, *mixed, "coarse", config, AT_M, correlation=correlation)
    lag = np.abs(np.subtract.outer(np.arange(20), np.arange(20)))
    for side, first in (("left", 0), ("right", 3)):
        truth = {"left": LEFT, "right": PARALLEL_RIGHT}[side]
        angle = np.arctan2(*(truth.p1_m - truth.p0_m)[1::-1])
        along, right = np.array([np.cos(angle), np.sin(angle), 0.0]), np.array([-np.sin(angle), np.cos(angle), 0.0])
        ground = deck_points(FRAME, points[side], sigma[side], np.arange(20), DepthMode.COARSE, ONLY_PIXELS)
        design = np.column_stack([np.ones(20), (ground.points_m - AT_M) @ along])
        across = ground.pixel_m @ right
        noise = np.outer(across, across) * correlation**lag
        expected = np.linalg.inv(design.T @ np.linalg.solve(noise, design))
        found = bound.lines[first : first + 2, first : first + 2]
        np.testing.assert_allclose(found, expected, rtol=0.05, atol=1e-9)


def test_it_falls_with_the_noise_and_with_more_points():
    config = LocalizeConfig(noise=ONLY_PIXELS, agreement=FREE)
    points, sigma = pixels(FRAME)
    one = cramer_rao(FRAME, points, sigma, "coarse", config, AT_M).lines
    double = cramer_rao(FRAME, points, {side: 2 * s for side, s in sigma.items()}, "coarse", config, AT_M).lines
    np.testing.assert_allclose(np.diag(double)[[0, 1, 3, 4]], 4 * np.diag(one)[[0, 1, 3, 4]], rtol=0.05)
    many = cramer_rao(FRAME, *pixels(FRAME, count=80), "coarse", config, AT_M).lines
    assert (np.diag(many)[[0, 1, 3, 4]] < np.diag(one)[[0, 1, 3, 4]] / 3).all()


def test_knowing_more_is_never_worse():
    frame = with_depth(FRAME)
    points, sigma = pixels(frame)

    def variances(mode, agreement=PARALLEL, **settings):
        config = LocalizeConfig(agreement=agreement, **settings)
        bound = cramer_rao(frame, points, sigma, mode, config, AT_M, relative=True)
        return np.concatenate([np.diag(bound.lines), np.diag(bound.centre)])

    base = variances("auto")
    for worse in (
        variances("coarse"),
        variances("fine"),
        variances("auto", agreement=FREE),
        variances("auto", deck=DeckConfig(tilt_rad=0.02)),
    ):
        assert (worse >= base * (1 - 1e-9)).all()
        assert (worse > base * 1.01).any()
    known = variances("auto", runway_width_m=14.7, deck=DeckConfig(width_sigma_m=0.01))
    assert (known <= base * (1 + 1e-9)).all()
    assert known[2] < 0.9 * base[2]  # a known width tells the height above the deck


def test_a_painted_centre_line_helps():
    points, sigma = pixels(FRAME, sigma_px=1.0)
    centre = line_points(FRAME, PARALLEL_CENTRE, 20, 1.0)
    config = LocalizeConfig(noise=ONLY_PIXELS, deck=DeckConfig(centre_sigma_m=0.0, centre_sigma_rad=0.0))
    without = cramer_rao(FRAME, points, sigma, "coarse", config, AT_M).centre
    painted = cramer_rao(
        FRAME, {**points, "centre": centre.points_px}, {**sigma, "centre": centre.sigma_px}, "coarse", config, AT_M
    ).centre
    # The middle of two lines has half their variance; a third like them adds as much as one.
    assert painted[0, 0] / without[0, 0] == pytest.approx(2 / 3, abs=0.02)
    assert painted[1, 1] < 0.8 * without[1, 1]


def test_the_aircrafts_own_errors_do_not_count_as_seen_from_it():
    points, sigma = pixels(FRAME)
    config = LocalizeConfig()
    worse = LocalizeConfig(noise=replace(config.noise, position_m=5.0))
    world = [cramer_rao(FRAME, points, sigma, "coarse", c, AT_M).centre for c in (config, worse)]
    # 3 m beside the line and 10 m above the deck, half as high again puts it half as far again aside.
    assert np.sqrt(world[1][0, 0]) == pytest.approx(np.hypot(5.0, 5.0 * 3 / 10), rel=0.02)
    assert np.sqrt(world[0][0, 0]) < 0.4
    relative = [cramer_rao(FRAME, points, sigma, "coarse", c, AT_M, relative=True).centre for c in (config, worse)]
    assert relative[1][1, 1] == pytest.approx(relative[0][1, 1], rel=1e-6)
    assert np.sqrt(relative[1][2, 2]) == pytest.approx(np.hypot(5.0, 0.1), rel=1e-6)


def test_offsets_are_those_beside_the_point_that_is_asked_for():
    points, sigma = pixels(FRAME)
    config = LocalizeConfig()
    near, far = (
        cramer_rao(FRAME, points, sigma, "coarse", config, at).centre
        for at in (PARALLEL_CENTRE.p0_m, PARALLEL_CENTRE.p1_m)
    )
    lever = np.linalg.norm((PARALLEL_CENTRE.p1_m - PARALLEL_CENTRE.p0_m)[:2])
    moved = np.array([[1.0, lever, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(moved @ near @ moved.T, far, rtol=1e-4, atol=1e-8)


def test_what_it_cannot_bound_is_named():
    points, sigma = pixels(FRAME)
    with pytest.raises(ValueError, match=r"exact\.png: the bound needs points of both lines and a pose, got left"):
        cramer_rao(FRAME, {"left": points["left"]}, sigma, "coarse", LocalizeConfig())
    with pytest.raises(ValueError, match="needs a deck height or depth for mode coarse"):
        cramer_rao(replace(FRAME, deck_z_m=None), points, sigma, "coarse", LocalizeConfig())
    with pytest.raises(ValueError, match="and a pose"):
        cramer_rao(replace(FRAME, world_from_body=None), points, sigma, "coarse", LocalizeConfig())
