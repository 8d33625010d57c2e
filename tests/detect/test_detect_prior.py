"""Boxes of runway priors against the projections of every point that may lie there, and of the last image."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.detect import OnnxDetector
from deckline.detect.prior import ImagePrior, RunwaySurvey, prior_from_box, prior_from_survey, project_prior
from deckline.geometry import Camera, attitude
from deckline.runtime import shipped_weights
from deckline.types import DepthMode, Detection, Frame, LinePoints, LineVisibility, RunwayEstimate, RunwayPrior
from deckline_sim import SimConfig, frames

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


@pytest.mark.parametrize(("width_m", "deck_width_m"), [(24.0, 15.0), (None, 24.0)])
def test_a_survey_lays_the_lines_out(width_m, deck_width_m):
    survey = RunwaySurvey((10.0, 20.0, -5.0), heading_deg=90.0, width_m=width_m, length_m=200.0)
    prior = prior_from_survey(survey, deck_width_m)
    # Landing to the east: left is north, larger x.
    np.testing.assert_allclose(prior.left_m, [[22.0, 20.0, -5.0], [22.0, 220.0, -5.0]], atol=1e-9)
    np.testing.assert_allclose(prior.right_m, [[-2.0, 20.0, -5.0], [-2.0, 220.0, -5.0]], atol=1e-9)
    assert prior_from_survey(RunwaySurvey()) is None


def test_an_exact_box_bounds_the_lines_ends_and_a_sigma_widens_it_by_its_angle():
    # 800 m ahead, level camera, 50 m below: u = cx + f y / x, v = cy + f z / x with f = 640 px.
    u0, v0, u1, v1 = project_prior(frame_at(pitch_deg=0.0), prior_from_survey(EXACT))
    assert (u0, u1) == pytest.approx((639.5 - 640 * 12 / 800, 639.5 + 640 * 12 / 800))
    assert (v0, v1) == pytest.approx((359.5 + 640 * 50 / 1040, 359.5 + 640 * 50 / 800))
    wide = project_prior(frame_at(pitch_deg=0.0), prior_from_survey(replace(EXACT, sigma_m=10.0)))
    assert (u0 - wide[0], wide[3] - v1) == pytest.approx((640 * 2 * 10 / 800, 640 * 2 * 10 / 800))


@settings(max_examples=40, deadline=None)
@given(st.floats(-20, 20), st.floats(-15, 15), st.floats(-1500, 150), st.floats(-60, 60), st.integers(0, 99))
def test_whatever_lies_within_the_sigmas_lies_in_the_box(yaw, pitch, x, y, seed):
    rng = np.random.default_rng(seed)
    frame = frame_at((x, y, -60.0), yaw, pitch)
    prior = prior_from_survey(replace(EXACT, sigma_m=8.0, heading_sigma_deg=3.0))
    box = project_prior(frame, prior)
    turn = Rotation.from_euler("z", np.deg2rad(rng.choice([-6.0, 0.0, 6.0])))
    near, far = rng.permutation([prior.left_m, prior.right_m])[0]
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
    prior = prior_from_survey(EXACT)
    assert project_prior(frame_at(yaw_deg=180.0), prior) is None  # behind
    assert project_prior(frame_at(yaw_deg=70.0), prior) is None  # beside
    assert project_prior(replace(frame_at(), world_from_body=None), prior) is None
    assert project_prior(frame_at((1000.0, 0.0, -70.0)), prior) is None  # flown past


@pytest.mark.parametrize("field", ["left_m", "right_m", "sigma_m", "azimuth_sigma_rad"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_prior_that_is_not_finite_has_no_box(field, value):
    prior = prior_from_survey(EXACT)
    broken = value if field.startswith(("sigma", "azimuth")) else np.where([[1, 0, 0], [0, 0, 0]], value, prior.left_m)
    assert project_prior(frame_at(), replace(prior, **{field: broken})) is None


def test_a_runway_that_passes_below_the_camera_is_cut_and_fills_the_image_downwards():
    u0, v0, u1, v1 = project_prior(frame_at((100.0, 0.0, -30.0)), prior_from_survey(EXACT))
    assert (u0, u1, v1) == (0.0, 1279.0, 719.0)
    assert 200 < v0 < 500


def test_a_box_lies_on_the_deck_under_its_middle():
    level = RigidTransform.from_components([10.0, 5.0, -60.0], attitude(0.0, 0.0, 0.0))
    frame = Frame("", 0.0, np.zeros((720, 1280, 3), np.uint8), CAMERA, world_from_body=level, deck_z_m=-12.0)
    u, v = CAMERA.cx + 64.0, CAMERA.cy + 128.0  # 48 m down, at 640 px: 240 m ahead, 24 m to the right
    place = prior_from_box(frame, (u - 9.0, v - 5.0, u + 9.0, v + 5.0))
    np.testing.assert_allclose(place.left_m, np.tile([250.0, 29.0, -12.0], (2, 1)), atol=1e-6)
    np.testing.assert_array_equal(place.left_m, place.right_m)
    assert prior_from_box(frame, (u, 0.0, u + 1.0, 9.0)) is None  # above the horizon
    for unknown in ({"deck_z_m": None}, {"world_from_body": None}):
        assert prior_from_box(replace(frame, **unknown), (u, v, u + 1.0, v + 1.0)) is None


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


LEFT, RIGHT = np.array([[600.0, 400.0], [560.0, 500.0]]), np.array([[640.0, 400.0], [700.0, 510.0]])
DETECTION = Detection(*(LinePoints(points, np.ones(2), np.full(2, 0.3)) for points in (LEFT, RIGHT)))
SEEN = RunwayEstimate(LineVisibility.BOTH, DepthMode.NONE, {}, {})


def image_at(time_s: float) -> Frame:
    return replace(frame_at(), time_s=time_s, world_from_body=None)


def test_the_last_box_is_carried_with_half_its_longer_side_around_it():
    memory = ImagePrior()
    assert memory.predict(image_at(0.0)) is None
    memory.update(image_at(0.0), DETECTION, SEEN)
    later = image_at(0.2)
    assert memory.predict(later) == (560.0 - 70, 400.0 - 70, 700.0 + 70, 510.0 + 70)
    smaller = replace(later, camera=CAMERA.resized(640, 360), image_rgb=later.image_rgb[::2, ::2])
    assert memory.predict(smaller) is None


def test_a_point_that_is_no_number_does_not_spoil_the_box():
    memory, spoilt = ImagePrior(), ImagePrior()
    left = DETECTION.left
    nothing = LinePoints(
        np.vstack([left.points_px, [np.nan, 450.0]]), *(np.append(of, 1.0) for of in (left.confidence, left.sigma_px))
    )
    memory.update(image_at(0.0), DETECTION, SEEN)
    spoilt.update(image_at(0.0), replace(DETECTION, left=nothing), SEEN)
    assert spoilt.predict(image_at(0.2)) == memory.predict(image_at(0.2))


def test_what_is_old_is_forgotten():
    memory = ImagePrior()
    memory.update(image_at(10.0), DETECTION, SEEN)
    assert memory.predict(image_at(15.0)) is not None
    assert memory.predict(image_at(15.1)) is None
    assert memory.predict(image_at(15.2)) is None


@pytest.mark.parametrize("seen", [LineVisibility.ONE, LineVisibility.NONE])
def test_what_was_not_seen_whole_replaces_nothing(seen):
    memory, later = ImagePrior(), image_at(1.0)
    memory.update(image_at(0.0), DETECTION, SEEN)
    before = memory.predict(later)
    memory.update(image_at(0.5), Detection(DETECTION.left, LinePoints.empty()), replace(SEEN, seen=seen))
    assert memory.predict(later) == before


# Priors, right and wrong, on rendered approaches, with the shipped network.
APPROACH = SimConfig(
    preset="cvn", trajectory="approach", frames=3, visibility_m=(5000.0, 5000.0), seed=1005, start_m=900.0, end_m=250.0
)
# An error of the aircraft's own position, m, north and east, and of its heading, deg: up to 100 m and 10 degrees.
WRONG = [
    (0.0, 0.0, 0.0),
    (100.0, 0.0, 0.0),
    (0.0, 100.0, 0.0),
    (0.0, -100.0, 10.0),
    (-70.0, 70.0, -10.0),
    (0.0, 0.0, 10.0),
]
SAME_PX = 0.5  # median distance of points from the true line


@pytest.fixture(scope="module")
def approach() -> list[Frame]:
    return list(frames(APPROACH))


@pytest.fixture(scope="module")
def blind():
    """The shipped network, whose search of the whole image never sees anything."""
    detector = OnnxDetector(shipped_weights("ufld"))
    detector.config = replace(detector.config, min_probability=1.1)
    return detector


def true_runway(frame: Frame, sigma_m: float, sigma_deg: float) -> RunwayPrior:
    lines = (np.stack([line.p0_m, line.p1_m]) for line in (frame.truth.left, frame.truth.right))
    return RunwayPrior(*lines, sigma_m, np.deg2rad(sigma_deg))


def wrong_box(frame: Frame, error: tuple[float, float, float], sigma_m: float, sigma_deg: float):
    """The prior's box in a frame whose pose is wrong."""
    north, east, heading = error
    pose = frame.world_from_body
    turned = Rotation.from_euler("z", heading, degrees=True) * pose.rotation
    moved = RigidTransform.from_components(pose.translation + np.array([north, east, 0.0]), turned)
    return project_prior(replace(frame, world_from_body=moved), true_runway(frame, sigma_m, sigma_deg))


def from_truth_px(frame: Frame, detection: Detection) -> float:
    """Median distance of a line's points from the true line, along u, px, of the worse line; both are there."""
    camera_from_world, found = frame.world_from_camera.inv(), []
    for points, line in ((detection.left, frame.truth.left), (detection.right, frame.truth.right)):
        (u0, v0), (u1, v1) = frame.camera.project(camera_from_world.apply([line.p0_m, line.p1_m]))
        u, v = points.points_px.T
        assert len(u)
        found.append(float(np.median(np.abs(u - (u0 + (v - v0) * (u1 - u0) / (v1 - v0))))))
    return max(found)


def is_empty(detection: Detection) -> bool:
    return len(detection.left) == len(detection.right) == 0


@pytest.mark.parametrize("error", WRONG)
@pytest.mark.parametrize("honest", [True, False])
def test_without_a_search_a_wrong_prior_ends_in_the_true_lines_or_in_none(blind, approach, error, honest):
    sigmas = (60.0, 6.0) if honest else (2.0, 0.5)
    assert is_empty(blind(approach[0].image_rgb))
    found = [(frame, blind(frame.image_rgb, wrong_box(frame, error, *sigmas))) for frame in approach[:2]]
    seen = [(frame, detection) for frame, detection in found if not is_empty(detection)]
    assert all(from_truth_px(frame, detection) < SAME_PX for frame, detection in seen)
    assert seen or (any(error) and not honest)
