from dataclasses import replace

import numpy as np
import pytest

from deckline.config import GRADES
from deckline.evaluation.approaches import (
    FlightsConfig,
    add_depth_noise,
    describe_flights,
    draw_patchy_noise,
    flight_settings,
    fly,
    miscalibrate,
)
from deckline.evaluation.modelled_detector import PointNoise, fly_points
from deckline.options import RunOptions

SENSORS = GRADES["good"]


def flights(frames: int = 2, **changes) -> FlightsConfig:
    return FlightsConfig(frames, options=RunOptions(grade="good", sea_state=0.0), **changes)


def test_the_simulator_draws_the_errors_of_the_configured_sensors():
    config = FlightsConfig(options=RunOptions(grade="tactical", sea_state=5.0))
    rendered = config.approach(3)
    assert rendered.seed == config.seed + 3
    assert rendered.navigation.position_bias_m == pytest.approx(1.5)
    assert rendered.navigation.position_sigma_m == pytest.approx(0.1)
    assert rendered.navigation.attitude_bias_deg == pytest.approx(0.1)
    assert rendered.motion.sea_state == 5.0
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
        ({"frames": 1}, "--frames.*1"),
        ({"range_m": (50.0, 60.0)}, "--range-m.*50"),
        ({"visibility": "thick"}, "thick"),
        ({"options": RunOptions(sea_state=9.0)}, "sea_state.*9"),
    ],
)
def test_what_cannot_be_flown_is_refused(values, words):
    with pytest.raises(ValueError, match=words):
        FlightsConfig(**values).approach(0)
