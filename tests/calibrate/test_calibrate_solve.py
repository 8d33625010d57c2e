import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from drawn_approach import CONFIG, MOUNT, STATED, Drawn, Off, draw_approach
from scipy.stats import chi2

from deckline.calibrate import Outcome, describe, solve, write_calibration
from deckline.calibrate.model import CAMERA_NAMES, SCALES, jacobian_px, residuals_px, start_state
from deckline.config import RunConfig
from deckline.options import read_run_config
from deckline.recording.camera_file import read_camera_file

UNKNOWN_DRIFT = replace(CONFIG, deck=replace(CONFIG.deck, ship_velocity_m_s=None))
LENS = (-0.28, 0.08, 0.001, -0.0005, -0.01)
ESTIMATED = Outcome.ESTIMATED


def truth(off: Off) -> np.ndarray:
    """Of the first seven of the state."""
    return np.array([*np.deg2rad(off.mount_deg), np.log1p(off.focal), off.cx_px, off.cy_px, off.delay_s])


@cache
def solved(drawn: Drawn, *hold: str):
    return solve(draw_approach(drawn), CONFIG, hold)


MOST_SIGMA = {"roll": np.deg2rad(0.7), "pitch": np.deg2rad(0.2), "yaw": np.deg2rad(0.5), "focal length": 0.015}
MOST_SIGMA |= {"cx": 6.0, "cy": 3.0, "delay": 0.01}
TURNED = Off((4.0, -4.0, 3.0), -0.08, delay_s=0.25)


@pytest.mark.parametrize(
    ("drawn", "hold", "names"),
    [
        (Drawn(TURNED), (), ("roll", "pitch", "yaw", "focal length", "delay")),
        (Drawn(Off(cx_px=40.0, cy_px=-30.0)), ("yaw", "pitch"), ("cx", "cy")),
        (Drawn(Off((-2.0, 2.0, -2.0), 0.07), 4, distortion=LENS), (), ("roll", "pitch", "yaw", "focal length")),
    ],
)
def test_each_wrong_value_is_recovered_within_its_uncertainty(drawn, hold, names):
    calibration, off = solved(drawn, *hold), drawn.off
    for name in names:
        number = CAMERA_NAMES.index(name)
        assert calibration.outcomes[name] is ESTIMATED
        assert calibration.fit.sigma[number] < MOST_SIGMA[name]
        assert abs(calibration.state[number] - truth(off)[number]) < 3 * calibration.fit.sigma[number]


def test_uncertainties_hold_over_seeds():
    """Mahalanobis distances of the estimated quantities sum to chi-square; sigmas are at most twice too large."""
    total, degrees = 0.0, 0
    for seed in range(100, 112):
        rng = np.random.default_rng(seed)
        turn_deg, sign = rng.choice([-1, 1], 3) * rng.uniform(2.5, 4.0, 3), rng.choice([-1, 1], 2)
        off = Off(tuple(turn_deg), sign[0] * 0.07, delay_s=sign[1] * rng.uniform(0.1, 0.3))
        calibration = solved(Drawn(off, seed))
        chosen = [number for number, name in enumerate(CAMERA_NAMES) if calibration.outcomes[name] is ESTIMATED]
        error = (calibration.state[:7] - truth(off))[chosen]
        total += error @ np.linalg.solve(calibration.fit.covariance[np.ix_(chosen, chosen)], error)
        degrees += len(chosen)
    assert degrees >= 12 * 5
    assert degrees / 4 < total < chi2.ppf(0.999, degrees)


def test_states_and_disturbances_in_a_stack_have_the_residuals_that_each_has_alone():
    view = draw_approach(Drawn(TURNED, 4, distortion=LENS))
    reference, _, state = start_state(view, CONFIG)
    rng = np.random.default_rng(0)
    states = state + SCALES * rng.normal(0, 1, (4, 13))
    disturbances = rng.normal(0, 0.01, (4, len(view.times_s), 10))
    stacked = residuals_px(view, reference, states, disturbances)
    alone = [residuals_px(view, reference, states[[k]], disturbances[[k]])[0] for k in range(4)]
    np.testing.assert_allclose(stacked, alone, rtol=0, atol=1e-8)
    step = 1e-3 * SCALES * rng.normal(0, 1, 13)
    change = np.diff(residuals_px(view, reference, np.array([state - step, state + step])), axis=0)[0]
    np.testing.assert_allclose(change, 2 * jacobian_px(view, reference, state) @ step, rtol=0, atol=1e-3)


@pytest.mark.parametrize("known", ["width", "nothing"])
def test_a_deck_of_unknown_height_is_estimated_with_it(known):
    off = Off((2.0, -2.0, 2.0))
    view = draw_approach(Drawn(off, 3))
    view = replace(view, deck_z_m=np.full_like(view.deck_z_m, np.nan))
    config = CONFIG if known == "width" else replace(CONFIG, deck=replace(CONFIG.deck, width_m=None))
    calibration = solve(view, config)
    assert (np.abs(calibration.state[:3] - truth(off)[:3]) < 3 * calibration.fit.sigma[:3]).all()


def test_turn_and_principal_point_are_named_as_not_separable():
    calibration = solved(Drawn(Off((2.0, -2.0, 2.0)), 9))
    pairs = {(pair.first, pair.second) for pair in calibration.inseparable}
    assert {("yaw", "cx"), ("pitch", "cy")} <= pairs
    assert calibration.outcomes["cx"] is calibration.outcomes["cy"] is Outcome.UNDETERMINED
    assert {calibration.held_by["cx"].second, calibration.held_by["cy"].second} == {"yaw", "pitch"}
    assert calibration.state[4] == calibration.state[5] == 0.0


WITHOUT_ROLL = Drawn(Off((0.0, 0.0, 3.0)), 6, speed_m_s=20.0, start_m=220.0, shake_deg=(0.0, 0.7, 0.7), drift_m_s=1.0)


def test_without_roll_an_unknown_drift_leaves_the_yaw_undetermined():
    calibration = solve(draw_approach(WITHOUT_ROLL, UNKNOWN_DRIFT), UNKNOWN_DRIFT)
    assert calibration.outcomes["yaw"] is Outcome.UNDETERMINED
    assert calibration.held_by["yaw"].second in ("line drift", "line azimuth")
    assert abs(calibration.held_by["yaw"].correlation) > 0.95
    assert calibration.state[2] == 0.0
    assert any("yaw stays as stated" in line for line in describe(calibration, None))


def test_a_surveyed_heading_determines_the_yaw_in_place_of_the_drift():
    survey = replace(CONFIG.survey, ramp_m=(40.0, -30.0, -20.0), heading_deg=np.rad2deg(0.3), heading_sigma_deg=0.1)
    calibration = solve(draw_approach(WITHOUT_ROLL, UNKNOWN_DRIFT), replace(UNKNOWN_DRIFT, survey=survey))
    assert calibration.outcomes["yaw"] is ESTIMATED
    assert abs(calibration.state[2] - np.deg2rad(3.0)) < 3 * calibration.fit.sigma[2] < np.deg2rad(1.5)


def test_a_less_certain_estimate_replaces_a_stated_value_that_it_contradicts():
    calm = Drawn(Off(focal=0.12), 11, shake_deg=(2.0, 0.2, 0.2))
    calibration = solve(draw_approach(calm), CONFIG)
    sigma = calibration.free_sigma[3]
    assert sigma > 0.02  # a fifth of the prior's
    assert calibration.outcomes["focal length"] is ESTIMATED
    assert abs(calibration.state[3] - np.log(1.12)) < 3 * sigma
    right = solve(draw_approach(replace(calm, off=Off())), CONFIG)
    assert right.outcomes["focal length"] is Outcome.UNDETERMINED


def test_stated_values_that_agree_stay():
    calibration = solve(draw_approach(Drawn(seed=8, errors=0.0)), CONFIG)
    names = ("roll", "pitch", "yaw", "focal length", "delay")
    assert {calibration.outcomes[name] for name in names} == {Outcome.AGREES}
    assert not calibration.state[:7].any()


def test_a_wrong_detection_is_left_out():
    drawn = Drawn(Off((2.0, -2.0, 2.0)), 9)
    view, clean = draw_approach(drawn), solved(drawn)
    wrong = view.points_px.copy()
    wrong[40:44, 0] += 60.0
    spoilt = solve(replace(view, points_px=wrong), CONFIG)
    assert not spoilt.fit.used[40:44].any()
    np.testing.assert_allclose(spoilt.state[:3], clean.state[:3], atol=np.deg2rad(0.15))


@pytest.mark.parametrize(
    ("drawn", "named"),
    [
        (Drawn(speed_m_s=0.0, start_m=100.0), "moves"),
        (Drawn(sides=("left",)), "0 of 45 frames"),
        (Drawn(sides=()), "0 of 45 frames"),
        (Drawn(frames=6), "6 of 6 frames"),
    ],
)
def test_what_is_no_approach_is_refused(drawn, named):
    with pytest.raises(ValueError, match=named):
        solve(draw_approach(drawn), CONFIG)


def test_written_files_are_read_back(tmp_path):
    off, drawn = TURNED, Drawn(TURNED)
    view, calibration = draw_approach(drawn), solved(drawn)
    camera_file, config_file, json_file = write_calibration(tmp_path / "new", view, calibration, CONFIG, 5.0)
    mounted = read_camera_file(camera_file)
    assert mounted.camera.fx == pytest.approx(STATED.fx * np.exp(calibration.state[3]))
    assert (mounted.camera.cx, mounted.camera.cy) == (STATED.cx, STATED.cy)
    turn = (off.mount().rotation * mounted.body_from_camera.rotation.inv()).magnitude()
    assert turn < np.deg2rad(1.5) < (off.mount().rotation * MOUNT.rotation.inv()).magnitude()
    assert mounted.body_from_camera.translation.tolist() == MOUNT.translation.tolist()
    assert mounted.sea_z_m == 0.0
    config = read_run_config(config_file)
    assert config.navigation.offset_s == pytest.approx(5.0 + calibration.state[6], abs=1e-6)
    assert (config.deck, config.survey) == (CONFIG.deck, CONFIG.survey)
    assert config.sensors.focal_fraction == pytest.approx(calibration.fit.sigma[3], rel=1e-4)
    values = json.loads(json_file.read_text())
    assert values["quantities"]["pitch"]["change"] == pytest.approx(np.rad2deg(calibration.state[1]))
    assert np.shape(values["correlation"]) == (13, 13)
    # Poses of single pictures have no offset.
    _, config_file, _ = write_calibration(tmp_path / "single", view, calibration, CONFIG, None)
    assert read_run_config(config_file).navigation.offset_s is RunConfig().navigation.offset_s is None
    assert any("delay is not written" in line for line in describe(calibration, None))
