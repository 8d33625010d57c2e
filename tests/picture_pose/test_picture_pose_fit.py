"""The pose of one picture: exact without noise, calibrated with it, and its refusals."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from picture_scene import (
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

from deckline.config import Deck, PicturePose, RunConfig, Sensors
from deckline.geometry import attitude, camera_mount
from deckline.picture_pose.fit import HIGHEST, LOWEST, check_belief, closed_form, fit_pose, innovations
from deckline.picture_pose.model import Mount
from deckline.picture_pose.states import USUAL_WIDTH_M, Belief, States, shared_sigmas
from deckline.types import SIDES, Diagnostic, Reason

FORWARD = Mount.of(camera_mount())
FLAT = Mount(CAMERA_MOUNT.rotation, np.zeros(3))  # the closed form knows no arm
ROUGH = RunConfig(Sensors(focal_fraction=0.02), Deck(sea_state=4.0, width_m=20.0, width_sigma_m=0.4))  # 2 %


def fit(place, config=LEVEL, horizon=True, runway=Runway(), camera=CAMERA, rng=None, tilt=(0.0, 0.0), mount=MOUNT):  # noqa: B008
    """The fit of a scene seen by `camera`, taken for `CAMERA`."""
    sights = sights_of(see(place, runway, camera, mount, rng))
    seen = turn_horizon(horizon_sight(place, camera, rng), *tilt) if horizon else None
    return fit_pose(0.0, sights, seen, Mount.of(mount), shared_sigmas(CAMERA, config), config)


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
        rng = np.random.default_rng([seed, 5])
        place = replace(draw_place(rng), roll=rng.normal(0, config.picture.roll_sigma_rad))
        drawn = rng.normal(0, shared_sigmas(CAMERA, config))
        share, cx, cy, up, tilt, width, angle, slope, cant, _, _ = drawn
        camera = replace(
            CAMERA,
            fx=CAMERA.fx * (1 + share),
            fy=CAMERA.fy * (1 + share),
            cx=CAMERA.cx + cx * CAMERA.fx,
            cy=CAMERA.cy + cy * CAMERA.fy,
        )
        runway = Runway(20.0 + width, angle, slope, cant)
        belief = fit(place, config, horizon, runway, camera, rng, (up, tilt))
        if isinstance(belief, Belief):
            off, sigma = errors_of(belief, place)
            scores.append(off / sigma)
    scores = np.array(scores)
    assert len(scores) > 285
    print(config.sensors.focal_fraction, horizon, np.mean(scores**2, axis=0), np.mean(np.abs(scores) < 1.96, axis=0))
