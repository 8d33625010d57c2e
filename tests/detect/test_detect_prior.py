"""Boxes of expected runways against the projections of every point that may lie there."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.detect.prior import RunwaySurvey, prior_from_survey, project_prior
from deckline.geometry import Camera, attitude
from deckline.types import Frame, RunwayPrior

CAMERA = Camera.from_fov(1280, 720, np.deg2rad(90))
EXACT = RunwaySurvey((0.0, 0.0, -20.0), sigma_m=0.0, heading_sigma_deg=0.0)


def frame_at(
    position_m: tuple[float, float, float] = (-800.0, 0.0, -70.0),
    yaw_deg: float = 0.0,
    pitch_deg: float = -3.0,
    camera: Camera = CAMERA,
) -> Frame:
    turn = attitude(0.0, np.deg2rad(pitch_deg), np.deg2rad(yaw_deg))
    pose = RigidTransform.from_components(np.array(position_m), turn)
    return Frame("f", 0.0, np.zeros((camera.height, camera.width, 3), np.uint8), camera, world_from_body=pose)


def test_a_survey_lays_the_lines_out():
    expected = prior_from_survey(RunwaySurvey((10.0, 20.0, -5.0), heading_deg=90.0, width_m=24.0, length_m=200.0))
    # Landing to the east: left is north, larger x.
    np.testing.assert_allclose(expected.left_m, [[22.0, 20.0, -5.0], [22.0, 220.0, -5.0]], atol=1e-9)
    np.testing.assert_allclose(expected.right_m, [[-2.0, 20.0, -5.0], [-2.0, 220.0, -5.0]], atol=1e-9)
    assert prior_from_survey(RunwaySurvey()) is None


def test_an_exact_box_bounds_the_lines_ends():
    # 800 m ahead, level camera, 50 m below: u = cx + f y / x, v = cy + f z / x with f = 640 px.
    u0, v0, u1, v1 = project_prior(frame_at(pitch_deg=0.0), prior_from_survey(EXACT))
    assert (u0, u1) == pytest.approx((639.5 - 640 * 12 / 800, 639.5 + 640 * 12 / 800))
    assert (v0, v1) == pytest.approx((359.5 + 640 * 50 / 1040, 359.5 + 640 * 50 / 800))


def test_sigma_widens_by_its_angle():
    wide = replace(EXACT, sigma_m=10.0)
    exact, box = (np.array(project_prior(frame_at(pitch_deg=0.0), prior_from_survey(s))) for s in (EXACT, wide))
    assert exact[0] - box[0] == pytest.approx(640 * 2 * 10 / 800)
    assert box[3] - exact[3] == pytest.approx(640 * 2 * 10 / 800)


@settings(max_examples=40, deadline=None)
@given(st.floats(-20, 20), st.floats(-15, 15), st.floats(-1500, 150), st.floats(-60, 60), st.integers(0, 99))
def test_whatever_lies_within_the_sigmas_lies_in_the_box(yaw, pitch, x, y, seed):
    rng = np.random.default_rng(seed)
    frame = frame_at((x, y, -60.0), yaw, pitch)
    expected = prior_from_survey(replace(EXACT, sigma_m=8.0, heading_sigma_deg=3.0))
    box = project_prior(frame, expected)
    turn = Rotation.from_euler("z", np.deg2rad(rng.choice([-6.0, 0.0, 6.0])))
    near, far = rng.permutation([expected.left_m, expected.right_m])[0]
    pivot, moved = np.array([0.0, 0.0, -20.0]), np.array([*rng.uniform(-16, 16, 2), 0.0])
    points = pivot + turn.apply(near + rng.uniform(0, 1, (200, 1)) * (far - near) - pivot)
    optical = moved + frame.world_from_camera.inv().apply(points)
    pixels = CAMERA.project(optical[optical[:, 2] > 1.0])
    seen = pixels[np.all((pixels >= 0) & (pixels <= [1279, 719]), axis=1)]
    if box is None:
        assert len(seen) == 0
    else:
        assert np.all((seen >= np.array(box[:2]) - 1e-6) & (seen <= np.array(box[2:]) + 1e-6))


def test_what_is_not_in_view_has_no_box():
    expected = prior_from_survey(EXACT)
    assert project_prior(frame_at(yaw_deg=180.0), expected) is None  # behind
    assert project_prior(frame_at(yaw_deg=70.0), expected) is None  # beside
    assert project_prior(replace(frame_at(), world_from_body=None), expected) is None
    assert project_prior(frame_at((1000.0, 0.0, -70.0)), expected) is None  # flown past


@pytest.mark.parametrize("field", ["left_m", "right_m", "sigma_m", "azimuth_sigma_rad"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_an_expectation_that_is_not_finite_has_no_box(field, value):
    expected = prior_from_survey(EXACT)
    broken = (
        value if field.startswith(("sigma", "azimuth")) else np.where([[1, 0, 0], [0, 0, 0]], value, expected.left_m)
    )
    assert project_prior(frame_at(), replace(expected, **{field: broken})) is None


def test_a_runway_that_passes_below_the_camera_is_cut_and_fills_the_image_downwards():
    u0, v0, u1, v1 = project_prior(frame_at((100.0, 0.0, -30.0)), prior_from_survey(EXACT))
    assert (u0, u1, v1) == (0.0, 1279.0, 719.0)
    assert 200 < v0 < 500


def test_a_lens_moves_the_box_and_cannot_bend_what_is_outside_into_the_image():
    strong = replace(CAMERA, distortion=(-0.3, 0.05, 0.0, 0.0, 0.0))
    ahead = np.array(project_prior(frame_at(yaw_deg=30.0, camera=strong), prior_from_survey(EXACT)))
    near, far = (
        frame_at(yaw_deg=30.0, camera=strong).world_from_camera.inv().apply(line)
        for line in (prior_from_survey(EXACT).left_m, prior_from_survey(EXACT).right_m)
    )
    pixels = strong.project(np.concatenate([near, far]))
    np.testing.assert_allclose(ahead, [*pixels.min(axis=0), *pixels.max(axis=0)], atol=1.0)
    assert project_prior(frame_at(yaw_deg=75.0, camera=strong), prior_from_survey(EXACT)) is None


def test_wrong_use_is_refused():
    with pytest.raises(ValueError, match="width and length above 0"):
        RunwaySurvey((0.0, 0.0, 0.0), width_m=0.0)
    with pytest.raises(ValueError, match="finite numbers"):
        RunwaySurvey((0.0, np.nan, 0.0))
    with pytest.raises(ValueError, match=r"RunwayPrior.left_m must have shape \(2, 3\), got \(3,\)"):
        RunwayPrior(np.zeros(3), np.zeros((2, 3)), 1.0, 0.1)
