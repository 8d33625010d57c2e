"""The pose of one picture: exact without noise, calibrated with it, and its refusals."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from runway_picture import (
    CAMERA,
    CAMERA_MOUNT,
    IN_WIDTHS,
    LEVEL,
    MOUNT,
    Place,
    Runway,
    belief_of,
    draw_place,
    errors_of,
    horizon_sight,
    see,
    sights_of,
)
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.config import USUAL_WIDTH_M, Deck, RunConfig, Sensors
from deckline.geometry import attitude, camera_mount
from deckline.picture_pose.fit import HIGHEST, LOWEST, check_belief, closed_form, fit_pose
from deckline.picture_pose.model import Mount
from deckline.picture_pose.sights import LevelSight
from deckline.picture_pose.states import RAMP_SIGMA_M, RAMP_SIGMA_SHARE, Belief, States, shared_sigmas
from deckline.types import SIDES, Diagnostic, Reason
from runway_scene import off_camera

FORWARD = Mount.of(camera_mount())
FLAT = Mount(CAMERA_MOUNT.rotation, np.zeros(3))  # the closed form knows no arm
ROUGH = RunConfig(Sensors(focal_fraction=0.02), Deck(sea_state=4.0, width_m=20.0, width_sigma_m=0.4))  # 2 %


def fit(place, config=LEVEL, horizon=True, runway=Runway(), camera=CAMERA, rng=None, tilt=(0.0, 0.0), mount=MOUNT):  # noqa: B008
    """The fit of a scene seen by `camera`, taken for `CAMERA`."""
    sights = sights_of(see(place, runway, camera, mount, rng))
    seen = turn_horizon(horizon_sight(place, camera, mount, rng), *tilt) if horizon else None
    return fit_pose(0.0, sights, LevelSight(seen), Mount.of(mount), shared_sigmas(CAMERA, config), config)


def turn_horizon(sight, up, tilt):
    """A horizon seen too high and tilted, rad."""
    return replace(sight, middle=sight.middle - [0.0, up, 0.0], slope=sight.slope + tilt)


@given(seed=st.integers(0, 10_000), width=st.floats(8.0, 60.0))
@settings(max_examples=40)
def test_the_closed_form_is_exact_without_noise(seed, width):
    place = replace(draw_place(np.random.default_rng(seed)), roll=0.0)
    config = RunConfig(deck=Deck(width_m=width))
    seen = see(place, Runway(width), mount=RigidTransform.from_rotation(MOUNT.rotation))
    rotation, at = closed_form(sights_of(seen), FLAT, 0.0, config)
    np.testing.assert_allclose(at[1:], place.position_m[1:], atol=2e-3)
    true = attitude(0.0, place.pitch, place.heading)
    turn = (Rotation.from_matrix(rotation) * true.inv()).magnitude()
    assert turn < 2e-4  # points are drawn to a hundredth of a pixel


def test_the_closed_form_takes_the_roll_that_it_is_given():
    place, mount = Place(roll=0.1, pitch=0.02, heading=0.05), camera_mount()
    rotation, at = closed_form(sights_of(see(place, mount=mount)), FORWARD, 0.1, LEVEL)
    np.testing.assert_allclose(at[1:], place.position_m[1:], atol=0.1)
    roll = Rotation.from_matrix(rotation).as_euler("ZYX")[2]
    assert roll == pytest.approx(0.1, abs=2e-3)  # about the camera's axis, which is not quite the nose's


@given(seed=st.integers(0, 10_000))
@settings(max_examples=30)
def test_the_fit_is_at_the_truth_without_noise(seed):
    place = draw_place(np.random.default_rng(seed))
    belief = fit(place)
    off, sigma = errors_of(belief, place)
    assert np.all(np.abs(off) < 0.35 * sigma)
    np.testing.assert_allclose(off[2:], 0.0, atol=2e-3)


def test_an_angle_of_the_lines_that_is_stated_is_used():
    runway, place = Runway(angle_rad=np.deg2rad(2.0)), Place()
    stated = RunConfig(deck=Deck(sea_state=0.0, width_m=20.0, angle_deg=2.0, angle_sigma_deg=0.05))
    off, sigma = errors_of(fit(place, stated, runway=runway), place)
    # The closed form starts with parallel lines; the ramp is not seen, so that the width holds somewhere nearby.
    assert np.all(np.abs(off) < sigma)


@pytest.mark.parametrize("horizon", [True, False])
@pytest.mark.parametrize("config", [LEVEL, ROUGH], ids=["exact", "2 %"])
def test_errors_agree_with_the_covariance(config, horizon):
    """Everything that the prior states is drawn from it: camera, width, slopes, paint, roll, horizon, pixels."""
    scores = []
    for seed in range(300):
        rng = np.random.default_rng([seed, horizon, config is ROUGH])
        place = replace(draw_place(rng), roll=rng.normal(0, config.picture.roll_sigma_rad))
        drawn = rng.normal(0, shared_sigmas(CAMERA, config))
        share, cx, cy, up, tilt, width, angle, slope, cant, *painted = drawn
        camera = off_camera(CAMERA, share, cx * CAMERA.fx, cy * CAMERA.fy)
        beyond = rng.normal(0, RAMP_SIGMA_M + RAMP_SIGMA_SHARE * place.distance_m)  # where the width holds
        runway = Runway(20.0 + width + angle * beyond, angle, slope, cant, painted_m=tuple(painted))
        belief = fit(place, config, horizon, runway, camera, rng, (up, tilt))
        if isinstance(belief, Belief):
            off, sigma = errors_of(belief, place)
            scores.append(off / sigma)
    scores = np.array(scores)
    assert len(scores) > 290
    np.testing.assert_allclose(np.mean(scores**2, axis=0), 1.0, atol=0.27)  # chance: 0.08
    assert 0.93 < np.mean(np.abs(scores) < 1.96) < 0.97


def test_a_horizon_makes_lateral_deviation_and_roll_surer():
    place = Place(distance_m=150.0, height_m=14.0)
    sigma = {horizon: errors_of(fit(place, horizon=horizon), place)[1] for horizon in (True, False)}
    assert sigma[True][0] < 0.5 * sigma[False][0]
    assert sigma[True][2] < np.deg2rad(0.25)
    assert sigma[False][2] == pytest.approx(np.deg2rad(5.0), rel=0.05)


@pytest.mark.parametrize("width", [10.0, 40.0])
def test_without_a_stated_width_the_unit_is_one_width(width):
    """The picture is the same; an arm of the mount, which is known in metres, is none here."""
    mount, stated = camera_mount(), RunConfig(deck=Deck(sea_state=0.0, width_m=width))
    unit, belief = fit(Place(), IN_WIDTHS, mount=mount), fit(Place(), stated, mount=mount)
    assert (unit.width_m, belief.width_m) == pytest.approx((USUAL_WIDTH_M, width))
    one, other = (b.mean[States.PLACE][1:] / b.width_m for b in (unit, belief))
    np.testing.assert_allclose(one, other, rtol=2e-3)
    np.testing.assert_allclose(unit.rotation, belief.rotation, atol=1e-4)


def flipped(sights, across=1):
    """The sights of a picture flipped top to bottom, and left to right where `across` is -1, named by their place."""
    flip, names = np.array([across, -1.0, 1.0]), dict(zip(SIDES, SIDES[::across], strict=True))
    return {names[s]: replace(one, rays=one.rays * flip, across=one.across * flip[:2]) for s, one in sights.items()}


def upright(u, sigma=1e-3):
    """A sight of a line along a column of the picture."""
    rays = np.array([[u, 0.05, 1.0], [u, 0.3, 1.0]])
    return replace(sights_of(see())["left"], rays=rays, across=np.array([1.0, 0.0]), sigma=np.full(2, sigma))


def refusal(sights, horizon=None):
    found = fit_pose(0.0, sights, LevelSight(horizon), CAMERA_MOUNT, shared_sigmas(CAMERA, LEVEL), LEVEL)
    return found.reason if isinstance(found, Diagnostic) else found


ON_ITS_SIDE = Place(roll=np.deg2rad(80.0), distance_m=100.0, height_m=30.0, lateral_m=0.0)


@pytest.mark.parametrize(
    ("sights", "reason"),
    [
        ({}, Reason.NO_VANISHING_POINT),
        ({"left": sights_of(see())["left"]}, Reason.NO_VANISHING_POINT),
        ({"left": upright(-0.2), "right": upright(0.2)}, Reason.NO_VANISHING_POINT),  # parallel in the picture
        ({"left": upright(0.1), "right": upright(0.1)}, Reason.NO_VANISHING_POINT),  # one line twice
        (flipped(sights_of(see())), Reason.NO_VANISHING_POINT),  # a staircase
        (flipped(sights_of(see()), -1), Reason.NO_VANISHING_POINT),  # upside down
        (sights_of(see(ON_ITS_SIDE)), Reason.NO_VANISHING_POINT),
        (dict(zip(SIDES, list(sights_of(see()).values())[::-1], strict=True)), Reason.CROSSED),
    ],
    ids=["none", "one", "parallel", "same", "up", "over", "side", "crossed"],
)
def test_what_is_no_runway_ahead_is_refused(sights, reason):
    assert refusal(sights) is reason


def test_lines_too_unsure_to_show_where_they_meet_are_refused():
    sights = sights_of(see())
    assert isinstance(refusal(sights), Belief)
    assert refusal({side: replace(one, sigma=2000 * one.sigma) for side, one in sights.items()}) is (
        Reason.NO_VANISHING_POINT
    )


def test_a_horizon_that_contradicts_the_lines_is_refused():
    place = Place()
    wrong = turn_horizon(horizon_sight(place), up=np.deg2rad(3.0), tilt=0.0)
    assert refusal(sights_of(see(place)), wrong) is Reason.ATTITUDE
    assert isinstance(refusal(sights_of(see(place)), horizon_sight(place)), Belief)


@pytest.mark.parametrize(
    ("widths", "is_believed"), [(LOWEST / 2, False), (0.1, True), (HIGHEST * 2, False), (np.nan, False)]
)
def test_heights_that_no_approach_has_are_refused(widths, is_believed):
    belief = replace(belief_of(Place(height_m=20.0 * widths)), covariance=np.diag(np.full(States.SIZE, 1e-4)))
    found = check_belief(belief, belief, {}, LevelSight(), CAMERA_MOUNT)
    assert isinstance(found, Belief) is is_believed
    assert is_believed or found.reason is Reason.NO_VANISHING_POINT
