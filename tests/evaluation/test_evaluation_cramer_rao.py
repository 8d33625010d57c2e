from dataclasses import replace

import numpy as np
import pytest

from approach_scene import LEFT, RIGHT, frame, points
from deckline.config import GRADES, Deck, RunConfig, Tracking
from deckline.evaluation.cramer_rao import cramer_rao
from deckline.localize.depth import deck_points
from deckline.truth import true_centre
from deckline.types import SIDES, DepthMode, Segment

FRAME = frame(0, 120.0)
CENTRE = true_centre(FRAME.truth)
AT_M = CENTRE.p0_m
SIGMA_PX, COUNT = 0.5, 20
LEVEL = Deck(sea_state=0.0, slope_deg=0.0)
FREE = replace(LEVEL, angle_sigma_deg=1e6)  # nothing is known of the lines' directions
ONLY_PIXELS = RunConfig(sensors=GRADES["exact"], deck=FREE)


def pixels(at=FRAME, sigma_px=SIGMA_PX, count=COUNT):
    found = {side: points(at, line, count).points_px for side, line in zip(SIDES, (LEFT, RIGHT), strict=True)}
    return found, {side: np.full(count, sigma_px) for side in found}


def regression(side: str, line: Segment, correlation: float = 0.0) -> np.ndarray:
    """Covariance of offset and azimuth of a generalised regression of the points on the deck."""
    found, sigma = pixels()
    along = (line.p1_m - line.p0_m) / np.linalg.norm(line.p1_m - line.p0_m)
    right = np.array([-along[1], along[0], 0.0])
    index, noise = np.arange(COUNT), ONLY_PIXELS.noise
    ground = deck_points(FRAME, found[side], sigma[side], index, DepthMode.COARSE, noise)
    design = np.column_stack([np.ones(COUNT), (ground.points_m - AT_M) @ along])
    across = ground.pixel_m @ right
    covariance = np.outer(across, across) * correlation ** np.abs(np.subtract.outer(index, index))
    return np.linalg.inv(design.T @ np.linalg.solve(covariance, design))


@pytest.mark.parametrize("correlation", [0.0, 0.5, -0.3])
def test_with_pixel_noise_alone_it_is_a_regression_on_the_deck(correlation):
    found, sigma = pixels()
    shuffled = np.random.default_rng(0).permutation(COUNT)
    mixed = {**found, "right": found["right"][shuffled]}, sigma
    bound = cramer_rao(FRAME, *mixed, "coarse", ONLY_PIXELS, AT_M, correlation=correlation)
    for side, line, first in (("left", LEFT, 0), ("right", RIGHT, 3)):
        block = bound.lines[first : first + 2, first : first + 2]
        # A row's v is taken as 0.05 px unsure, a percent of the variance of lines as oblique as these.
        np.testing.assert_allclose(block, regression(side, line, correlation), rtol=0.06, atol=1e-9)
    # The lines share nothing but the deck's height, which is known to what a calm sea moves it.
    assert np.abs(bound.lines[:2, 3:5]).max() < 0.02 * bound.lines[0, 0]
    assert np.sqrt(bound.lines[2, 2]) == pytest.approx(ONLY_PIXELS.noise.deck_z_m, rel=1e-3)


def test_it_falls_with_the_noise_and_with_more_points():
    one, double, many = (
        np.diag(cramer_rao(FRAME, *pixels(**changes), "coarse", ONLY_PIXELS, AT_M).lines)[[0, 1, 3, 4]]
        for changes in ({}, {"sigma_px": 2 * SIGMA_PX}, {"count": 4 * COUNT})
    )
    np.testing.assert_allclose(double, 4 * one, rtol=0.05)
    assert (many < one / 3).all()


def test_knowing_more_is_never_worse():
    v, u = np.mgrid[0 : FRAME.camera.height, 0 : FRAME.camera.width]
    rays = FRAME.world_from_camera.rotation.apply(FRAME.camera.rays(np.stack([u.ravel(), v.ravel()], axis=1)))
    depth = np.where(rays[:, 2] > 0.02, (FRAME.deck_z_m - FRAME.world_from_camera.translation[2]) / rays[:, 2], np.nan)
    at = replace(FRAME, depth_m=depth.reshape(v.shape).astype(np.float32))

    def variances(mode="auto", deck=LEVEL):
        bound = cramer_rao(
            at, *pixels(), mode, RunConfig(deck=deck, tracking=Tracking(enabled=False)), AT_M, relative=True
        )
        return np.concatenate([np.diag(bound.lines), np.diag(bound.centre)])

    base = variances()
    for worse in (
        variances("coarse"),
        variances("fine"),
        variances(deck=FREE),
        variances(deck=replace(LEVEL, slope_deg=1.0)),
    ):
        assert (worse >= base * (1 - 1e-9)).all()
        assert (worse > base * 1.01).any()
    known = variances(deck=replace(LEVEL, width_m=16.0, width_sigma_m=0.01))
    assert (known <= base * (1 + 1e-9)).all()
    assert (known < 0.9 * base).any()


def test_a_painted_centre_line_helps():
    found, sigma = pixels()
    painted = {**found, "centre": points(FRAME, CENTRE, COUNT).points_px}, {**sigma, "centre": sigma["left"]}
    without, centre = (
        cramer_rao(FRAME, *given, "coarse", ONLY_PIXELS, AT_M).centre for given in ((found, sigma), painted)
    )
    assert centre[0, 0] < 0.9 * without[0, 0]


def test_own_errors_of_position_do_not_count_as_seen_from_the_aircraft():
    good, bad = (RunConfig(sensors=replace(GRADES["standard"], position_m=value), deck=LEVEL) for value in (0.1, 5.0))
    world, relative = (
        [cramer_rao(FRAME, *pixels(), "coarse", config, AT_M, relative=own).centre for config in (good, bad)]
        for own in (False, True)
    )
    assert np.sqrt(world[1][0, 0]) > 4.9 and np.sqrt(world[0][0, 0]) < 0.5
    assert relative[1][1, 1] == pytest.approx(relative[0][1, 1], rel=1e-6)


def test_offsets_are_those_beside_the_point_that_is_asked_for():
    near, far = (
        cramer_rao(FRAME, *pixels(), "coarse", RunConfig(deck=LEVEL), at).centre for at in (CENTRE.p0_m, CENTRE.p1_m)
    )
    lever = np.linalg.norm((CENTRE.p1_m - CENTRE.p0_m)[:2])
    shift = np.array([[1.0, lever, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(shift @ near @ shift.T, far, rtol=1e-4, atol=1e-8)


@pytest.mark.parametrize("changes", [{"deck_z_m": None}, {"world_from_body": None}])
def test_a_frame_that_it_cannot_bound_is_named(changes):
    with pytest.raises(ValueError, match=r"frame_000\.png"):
        cramer_rao(replace(FRAME, **changes), *pixels(), "coarse", ONLY_PIXELS)


def test_one_line_is_too_few():
    found, sigma = pixels()
    with pytest.raises(ValueError, match="left"):
        cramer_rao(FRAME, {"left": found["left"]}, sigma, "coarse", ONLY_PIXELS)
