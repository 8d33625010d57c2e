"""Approaches as flown: errors of the sensors, modelled points and depth."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.config import GRADES
from deckline.geometry import BODY_FROM_OPTICAL, Camera
from deckline.options import RunOptions
from deckline.types import LinePoints, Segment
from deckline_lab.evaluation.approaches import (
    DEPTH_RANGE_M,
    FlightsConfig,
    PointNoise,
    Sighting,
    add_depth_noise,
    describe_flights,
    draw_patchy_noise,
    draw_points,
    flight_settings,
    fly,
    fly_points,
    miscalibrate,
    sparse_depth,
)
from deckline_lab.evaluation.metrics import normal_pixel_error
from deckline_sim.flight.approach import approach_view
from deckline_sim.ship.layout import class_layout
from deckline_sim.ship.ship_class import load_class

SENSORS = GRADES["good"]
CAMERA = Camera.from_fov(640, 360, np.pi / 2)
POSE = RigidTransform.from_components([-100.0, 0.0, -20.0], Rotation.from_euler("y", -0.2) * BODY_FROM_OPTICAL)
TILTED = Segment(np.array([0.0, -8.0, 0.0]), np.array([200.0, -8.0, 6.0]))
OTHER = Segment(np.array([0.0, 8.0, 0.0]), np.array([200.0, 8.0, 6.0]))
PERFECT = PointNoise(sigma_px=0.0, outlier_share=0.0, missed_share=0.0)


def flights(frames: int = 2, **changes) -> FlightsConfig:
    return FlightsConfig(frames, options=RunOptions(grade="good", sea_state=0.0), **changes)


def test_the_simulator_draws_the_errors_of_the_configured_sensors():
    config = FlightsConfig(options=RunOptions(grade="tactical", sea_state=5.0, touchdown_m=120.0, glideslope_deg=4.0))
    rendered = config.approach(3)
    assert rendered.seed == config.seed + 3
    assert rendered.navigation.position_bias_m == pytest.approx(1.5)
    assert rendered.navigation.position_sigma_m == pytest.approx(0.1)
    assert rendered.navigation.attitude_bias_deg == pytest.approx(0.1)
    assert rendered.motion.sea_state == 5.0
    assert (rendered.flight.touchdown_m, rendered.flight.glideslope_deg) == (120.0, 4.0)
    assert "navigation tactical, sea state 5" in describe_flights(config)
    own = FlightsConfig(options=RunOptions(position_sigma_m=0.5))
    assert "navigation 0.5 m and 0.1 degrees" in describe_flights(own)
    assert "options" not in flight_settings(config)


def test_patchy_noise_has_unit_variance_and_resembles_its_neighbours():
    noise = draw_patchy_noise((300, 400), np.random.default_rng(0))
    assert noise.std() == pytest.approx(1.0, abs=0.05)
    assert np.mean(noise[:, 1:] * noise[:, :-1]) > 0.8
    assert abs(np.mean(noise[:, 20:] * noise[:, :-20])) < 0.05


@pytest.fixture(scope="module")
def frame():
    seen = next(iter(fly_points(flights().approach(0), GRADES["exact"], PointNoise()))).frame
    return replace(seen, depth_m=np.full((720, 1280), 50.0, np.float32))


def test_calibration_and_deck_height_are_wrong_by_what_is_stated(frame):
    wrong = [miscalibrate(frame, SENSORS, seed) for seed in range(60)]
    deck = np.std([each.deck_z_m - frame.deck_z_m for each in wrong])
    focal = np.std([each.camera.fx / frame.camera.fx - 1 for each in wrong])
    scale = np.std([each.depth_m[0, 0] / 50.0 - 1 for each in wrong])
    expected = (SENSORS.deck_z_m, SENSORS.focal_fraction, SENSORS.depth_scale)
    np.testing.assert_allclose([deck, focal, scale], expected, rtol=0.3)
    assert all(each.camera.fx == pytest.approx(each.camera.fy) for each in wrong)
    assert wrong[0].truth is frame.truth


def test_depths_err_in_every_frame_anew(frame):
    first, again, later = (add_depth_noise(frame, SENSORS, 3, index).depth_m for index in (0, 0, 1))
    assert np.std(first / 50.0) == pytest.approx(SENSORS.depth_fraction, rel=0.05)
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, later)
    blind = replace(frame, depth_m=None)
    assert add_depth_noise(blind, SENSORS, 3, 0) is blind


def test_an_approach_is_rendered_with_a_wrong_pose_and_the_true_one():
    small = flights(range_m=(150.0, 140.0), visibility="800")
    frame = next(iter(fly(small, 0)))
    assert frame.truth.visibility_m == 800.0
    off = frame.world_from_body.translation - frame.true_world_from_body.translation
    assert 0.0 < np.linalg.norm(off) < 1.0
    assert np.isfinite(frame.depth_m).mean() > 0.05


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"frames": 1}, "frames.*1"),
        ({"range_m": (50.0, 60.0)}, "--range-m.*50"),
        ({"visibility": "thick"}, "thick"),
        ({"options": RunOptions(sea_state=9.0)}, "sea_state.*9"),
    ],
)
def test_what_cannot_be_flown_is_refused(values, words):
    with pytest.raises(ValueError, match=words):
        FlightsConfig(**values).approach(0)


def test_points_end_where_the_line_or_the_view_does():
    rng = np.random.default_rng(0)
    seen = draw_points(TILTED, POSE, CAMERA, np.inf, PERFECT, rng).points_px
    ends = CAMERA.project(POSE.inv().apply(np.stack([TILTED.p0_m, TILTED.p1_m])))
    np.testing.assert_allclose(seen[[-1, 0]], ends, atol=1e-6)
    hazy = draw_points(TILTED, POSE, CAMERA, 150.0, PERFECT, rng).points_px
    assert hazy[:, 1].min() > seen[:, 1].min() + 1
    assert len(draw_points(TILTED, POSE, CAMERA, 50.0, PERFECT, rng)) == 0


def test_depth_of_a_tilted_deck_is_the_deck_s():
    points = draw_points(TILTED, POSE, CAMERA, np.inf, PERFECT, np.random.default_rng(0))
    seen = LinePoints(np.rint(points.points_px), points.confidence, points.sigma_px)
    depth = sparse_depth(CAMERA, POSE, (TILTED, OTHER), [seen, LinePoints.empty()], 0.0, np.random.default_rng(0))
    at = seen.points_px.astype(int)
    back = POSE.apply(depth[at[:, 1], at[:, 0], None] * CAMERA.rays(at))
    near = np.isfinite(back[:, 0])
    assert near.sum() > 10
    np.testing.assert_allclose(back[near, 2], 0.03 * back[near, 0], atol=1e-3)
    assert np.isfinite(depth).mean() < 0.01
    assert 190.0 < np.nanmax(depth) <= DEPTH_RANGE_M < np.max(POSE.inv().apply(TILTED.p1_m))


def still_flights(frames: int = 6, visibility: str = "clear") -> FlightsConfig:
    return FlightsConfig(frames, visibility=visibility, options=RunOptions(grade="exact", sea_state=0.0))


def fly_still(noise: PointNoise, number: int = 0, **changes) -> list[Sighting]:
    return list(fly_points(still_flights(**changes).approach(number), GRADES["exact"], noise))


def ends(sighting, side: str) -> np.ndarray:
    line = getattr(sighting.frame.truth, side)
    return sighting.frame.true_world_from_camera.inv().apply(np.stack([line.p0_m, line.p1_m]))


@pytest.fixture(scope="module")
def exact():
    return fly_still(PERFECT)


@pytest.mark.parametrize("side", ["left", "right"])
def test_points_without_noise_lie_on_the_true_lines(exact, side):
    for sighting in exact:
        points = getattr(sighting.detection, side).points_px
        assert len(points) == 40
        errors = normal_pixel_error(points, ends(sighting, side), sighting.frame.camera)
        assert errors.max() < 0.02  # between samples of the line


def test_the_flight_is_the_simulator_s(exact):
    """Same path, same lines, same errors of the pose as in a rendered approach."""
    config = still_flights().approach(0)
    view = approach_view(config, class_layout(load_class("paper")), 3)
    np.testing.assert_allclose(exact[3].frame.world_from_body.as_matrix(), view.world_from_body.as_matrix())
    np.testing.assert_allclose(exact[3].frame.truth.left.p0_m[2], exact[3].frame.deck_z_m)
    assert not np.array_equal(exact[0].frame.image_rgb, exact[1].frame.image_rgb)


def test_noise_is_as_stated():
    noise = PointNoise(sigma_px=0.5, outlier_share=0.0, missed_share=0.0, correlation=0.6)
    exact = draw_points(TILTED, POSE, CAMERA, np.inf, PERFECT, np.random.default_rng(0)).points_px
    draws = [draw_points(TILTED, POSE, CAMERA, np.inf, noise, np.random.default_rng(k)).points_px for k in range(2000)]
    errors = np.array(draws)[..., 0] - exact[:, 0]
    np.testing.assert_allclose(errors.std(axis=0), 0.5, rtol=0.07)
    assert np.mean(errors[:, 3] * errors[:, 5]) / 0.25 == pytest.approx(0.36, abs=0.06)


def test_missed_lines_and_outliers():
    blind = fly_still(PointNoise(missed_share=1.0))[0]
    assert len(blind.detection.left) == len(blind.detection.right) == 0
    wild = fly_still(PointNoise(sigma_px=0.0, outlier_share=1.0, missed_share=0.0))[0]
    assert normal_pixel_error(wild.detection.left.points_px, ends(wild, "left"), wild.frame.camera).max() > 3.0


def test_haze_hides_what_is_far():
    sightings = fly_still(PERFECT, visibility="1000")
    assert len(sightings[0].detection.left) == 0  # 800 m away, with 700 m to be seen
    assert len(sightings[3].detection.left) == 40
    assert sightings[0].frame.truth.visibility_m == 1000.0
