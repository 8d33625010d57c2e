"""The one configuration: refused where it cannot be, derived once, read from a file, overridden by options."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from deckline.config import (
    GRADES,
    Approach,
    Deck,
    Integrity,
    Localization,
    Models,
    RunConfig,
    RunwaySurvey,
    Sensors,
    Tracking,
)
from deckline.options import TARGETS, RunOptions


@pytest.mark.parametrize(
    ("section", "name", "value"),
    [
        (Sensors, "position_m", -1.0),
        (Sensors, "attitude_deg", np.nan),
        (Sensors, "drift_s", 0.0),
        (Sensors, "position_white_m", 0.2),
        (Deck, "sea_state", 7.0),
        (Deck, "width_m", 0.0),
        (Deck, "angle_sigma_deg", 0.0),
        (Deck, "slope_deg", -0.1),
        (Approach, "glideslope_deg", 0.0),
        (Approach, "touchdown_m", -1.0),
        (Approach, "point_m", (0.0, np.inf, 0.0)),
        (RunwaySurvey, "width_m", 0.0),
        (RunwaySurvey, "sigma_m", -1.0),
        (Models, "detect_in", "clear"),
        (Localization, "mode", "depth"),
        (Tracking, "gate_sigma", 0.0),
        (Integrity, "risk", 1.0),
        (Integrity, "max_line_m", 0.0),
    ],
)
def test_what_cannot_be_is_refused_with_its_name_and_value(section, name, value):
    number = value[1] if isinstance(value, tuple) else value
    with pytest.raises(ValueError, match=rf"{name.removesuffix('_white_m')}.*{number}"):
        section(**{name: value})


def test_deck_motion_is_that_of_single_sines_between_ramp_and_touchdown():
    motion = Deck(sea_state=5.0).motion
    times = np.linspace(0.0, 396.0, 39600, endpoint=False)  # whole periods of roll, pitch and heave
    pitch = np.deg2rad(0.82) * np.sin(2 * np.pi * times / 12.0)
    heave = (166.0 + 96.0) / 2 * pitch + 1.09 * np.sin(2 * np.pi * times / 18.0)
    assert np.std(heave) == pytest.approx(motion.heave_m, rel=0.01)
    assert np.std(pitch) == pytest.approx(motion.pitch_rad, rel=1e-2)
    assert np.std(np.deg2rad(0.98) * np.sin(2 * np.pi * times / 22.0)) == pytest.approx(motion.roll_rad, rel=1e-2)


def test_a_rough_sea_makes_the_reported_deck_height_less_certain_but_not_the_height_at_rest():
    calm, rough = RunConfig(deck=Deck(sea_state=0.0)), RunConfig(deck=Deck(sea_state=5.0))
    assert calm.deck_height_sigma_m == pytest.approx(0.1)
    assert rough.deck_height_sigma_m == pytest.approx(np.hypot(0.1, rough.deck.motion.heave_m), rel=1e-3)
    assert rough.deck_rest_sigma_m == calm.deck_rest_sigma_m
    assert rough.noise.deck_z_m == rough.deck_height_sigma_m
    assert rough.noise.slope_rad == rough.deck.motion.pitch_rad > 10 * calm.noise.slope_rad
    assert RunConfig(deck=Deck(slope_deg=0.0)).noise.slope_rad == 0.0


def test_only_a_flight_without_a_track_tells_one_frame_the_width():
    config = RunConfig(deck=Deck(width_m=20.0))
    assert config.frame_deck.width_m is None
    assert replace(config, tracking=Tracking(enabled=False)).frame_deck.width_m == 20.0


def test_drift_and_white_noise_make_the_total():
    for sensors in GRADES.values():
        assert np.hypot(sensors.position_drift_m, sensors.position_white_m) == pytest.approx(sensors.position_m)
        assert np.hypot(sensors.attitude_drift_deg, sensors.attitude_white_deg) == pytest.approx(sensors.attitude_deg)
    assert GRADES["good"].position_m == pytest.approx(np.hypot(0.02, 0.1))
    floored = GRADES["exact"].with_floor(1e-5, 1e-3, 1e-4)
    assert min(vars(floored).values()) > 0
    assert floored.attitude_rad == pytest.approx(1e-5)


@pytest.fixture
def read(tmp_path):
    """The configuration of a file's text and of options."""

    def configure(text, **options):
        (tmp_path / "deck.toml").write_text(text)
        return RunOptions(config=tmp_path / "deck.toml", **options).run_config()

    return configure


def test_a_file_is_read_once_for_all_bases(tmp_path):
    path = tmp_path / "deck.toml"
    path.write_text('[sensors]\ngrade = "good"\n[deck]\nwidth_m = 12.0')
    options = RunOptions(config=path, sea_state=2.0)
    first = options.run_config()
    path.unlink()
    assert options.run_config() == first != RunConfig()
    assert options.run_config(RunConfig(seed=first.seed + 1)) == replace(first, seed=first.seed + 1)


def test_a_file_starts_from_a_grade_and_options_override_it(read):
    text = '[sensors]\ngrade = "good"\ndeck_z_m = 0.3\n[deck]\nwidth_m = 21\n'
    config = read(text, runway_width_m=22.0, touchdown_m=120.0)
    assert config.sensors == replace(GRADES["good"], deck_z_m=0.3)
    assert (config.deck.width_m, config.approach.touchdown_m) == (22.0, 120.0)
    with pytest.raises(ValueError, match=r"sensors\.grade.*perfect"):
        read('[sensors]\ngrade = "perfect"\n')


def test_a_grade_changes_position_and_attitude_alone(read):
    text = "[sensors]\nfocal_fraction = 0.004\ndelay_s = 0.05\n"
    assert read(text, grade="good").sensors == replace(GRADES["good"], focal_fraction=0.004, delay_s=0.05)
    assert read(text, grade="exact").sensors == GRADES["exact"]


def test_a_stated_accuracy_keeps_its_share_of_white_noise():
    sensors = RunOptions(position_sigma_m=1.0, attitude_sigma_deg=0.5).run_config().sensors
    assert (sensors.position_m, sensors.position_white_m) == (1.0, pytest.approx(0.5))
    assert (sensors.attitude_deg, sensors.attitude_white_deg) == (0.5, pytest.approx(0.1))


def test_every_option_has_one_target_in_the_configuration():
    config = RunConfig()
    assert set(TARGETS) == set(vars(RunOptions())) - {"config", "grade", "thorough", "no_track"}
    assert not RunOptions(no_track=True).run_config().tracking.enabled
    assert RunOptions(thorough=True).run_config().tracking.search_s == 0 < RunOptions().run_config().tracking.search_s
    assert all(hasattr(getattr(config, section), name) for section, name in TARGETS.values())


def test_the_example_file_is_readable():
    path = Path(__file__).parents[1] / "examples" / "still_deck.toml"
    config = RunOptions(config=path).run_config()
    assert (config.sensors, config.noise.slope_rad) == (GRADES["good"], 0.0)


def test_a_flag_that_is_not_set_leaves_the_files_value(read):
    assert read("[models]\nvisibility = true\n").models.visibility
    assert RunOptions(measure_visibility=True).run_config().models.visibility
    assert not RunOptions().run_config().models.visibility
