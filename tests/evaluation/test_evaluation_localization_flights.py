from dataclasses import replace

import numpy as np
import pytest

from deckline.evaluation.integrity_flights import point_flight
from deckline.evaluation.integrity_points import PointNoise
from deckline.evaluation.localization_flights import (
    ERRORS,
    FlightsConfig,
    fly,
    miscalibrated,
    noisy_depth,
    patchy,
)

OF_POINTS = ("min_pixel", "point_correlation", "point_correlation_sigma")


def test_localization_is_told_what_its_sensors_are_worth():
    noise = FlightsConfig(navigation="tactical").noise
    assert noise.position_m == pytest.approx(np.hypot(1.5, 0.1))
    assert noise.attitude_rad == pytest.approx(np.deg2rad(np.hypot(0.1, 0.02)))
    assert (noise.depth_fraction, noise.deck_z_m) == (ERRORS.depth_fraction, ERRORS.deck_z_m)
    exact = FlightsConfig(navigation="exact").noise
    assert {value for name, value in vars(exact).items() if name not in OF_POINTS} == {0.0}


def test_the_tracker_is_told_of_the_sea_and_the_runway():
    config = FlightsConfig(sea_state=5, runway_width_m=14.7)
    assert config.track.errors.deck_z_m > 10 * FlightsConfig().track.errors.deck_z_m
    assert config.localize.noise.deck_z_m == config.track.errors.deck_z_m
    assert config.localize.deck.tilt_rad == config.track.motion.tilt_rad > FlightsConfig().localize.deck.tilt_rad == 0.0
    assert FlightsConfig().localize.noise == FlightsConfig().noise
    assert config.track.runway_width_m == config.localize.runway_width_m == 14.7
    assert FlightsConfig(navigation="exact").track.errors.position_m < 0.01


def test_patchy_noise_has_unit_variance_and_resembles_its_neighbours():
    noise = patchy((300, 400), np.random.default_rng(0))
    assert noise.std() == pytest.approx(1.0, abs=0.05)
    assert np.mean(noise[:, 1:] * noise[:, :-1]) > 0.8
    assert abs(np.mean(noise[:, 20:] * noise[:, :-20])) < 0.05


@pytest.fixture(scope="module")
def frame():
    seen = next(iter(point_flight(FlightsConfig(frames=2, navigation="exact").approach(0), PointNoise()))).frame
    return replace(seen, depth_m=np.full((720, 1280), 50.0, np.float32))


def test_calibration_and_deck_height_are_wrong_by_what_is_stated(frame):
    wrong = [miscalibrated(frame, seed) for seed in range(60)]
    deck = np.std([each.deck_z_m - frame.deck_z_m for each in wrong])
    focal = np.std([each.camera.fx / frame.camera.fx - 1 for each in wrong])
    scale = np.std([each.depth_m[0, 0] / 50.0 - 1 for each in wrong])
    expected = (ERRORS.deck_z_m, ERRORS.focal_fraction, ERRORS.depth_scale)
    np.testing.assert_allclose([deck, focal, scale], expected, rtol=0.3)
    assert all(each.camera.fx == pytest.approx(each.camera.fy) for each in wrong)
    assert wrong[0].truth is frame.truth


def test_depths_err_in_every_frame_anew(frame):
    first, again, later = (noisy_depth(frame, 3, index).depth_m for index in (0, 0, 1))
    assert np.std(first / 50.0) == pytest.approx(ERRORS.depth_fraction, rel=0.05)
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, later)
    blind = replace(frame, depth_m=None)
    assert noisy_depth(blind, 3, 0) is blind


def test_an_approach_is_rendered_with_a_wrong_pose_and_the_true_one():
    small = FlightsConfig(frames=2, range_m=(150.0, 140.0), visibility="800")
    frame = next(iter(fly(small, 0)))
    assert frame.truth.visibility_m == 800.0
    off = frame.world_from_body.translation - frame.true_world_from_body.translation
    assert 0.0 < np.linalg.norm(off) < 1.0
    assert np.isfinite(frame.depth_m).mean() > 0.05


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"frames": 1}, "--frames must be at least 2, got 1"),
        ({"range_m": (50.0, 60.0)}, "--range-m must be FAR NEAR"),
        ({"visibility": "thick"}, "visibility must be metres"),
        ({"sea_state": 9.0}, "sea_state must lie between 0 and 6"),
    ],
)
def test_what_cannot_be_flown_is_refused(values, words):
    with pytest.raises(ValueError, match=words):
        FlightsConfig(**values).approach(0)
