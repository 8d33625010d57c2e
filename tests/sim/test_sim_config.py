"""Settings of the simulator: every refusal names the setting and the value."""

from dataclasses import replace

import pytest

from deckline_lab.datasets.paper import DatasetConfig
from deckline_sim import SimConfig
from deckline_sim.config import (
    AirConfig,
    DepthConfig,
    ExposureConfig,
    FlightConfig,
    LensConfig,
    MotionConfig,
    NavigationConfig,
    SensorConfig,
    WeatherConfig,
)
from deckline_sim.record import ContactSheetConfig

INF, NAN = float("inf"), float("nan")


@pytest.mark.parametrize(
    ("kind", "settings", "named"),
    [
        (SimConfig, {"preset": "yacht"}, r"preset .*'paper', 'cvn', .*'train'.*'yacht'"),
        (SimConfig, {"trajectory": "loop"}, "trajectory .*'loop'"),
        (SimConfig, {"trajectory": "deckless"}, "trajectory deckless .*'paper'"),
        (SimConfig, {"frames": 0}, "frames .*0$"),
        (SimConfig, {"width": 0}, "width .*0$"),
        (SimConfig, {"width": 8193}, "width .*8192.*8193"),
        (SimConfig, {"seed": -1}, "seed .*-1"),
        (SimConfig, {"fov_deg": 180.0}, "fov_deg .*150.*180"),
        (SimConfig, {"visibility_m": (500.0, 100.0)}, r"visibility_m .*\(500.0, 100.0\)"),
        (SimConfig, {"visibility_m": (500.0, INF)}, r"visibility_m .*\(500.0, inf\)"),
        (SimConfig, {"range_m": (0.0, 100.0)}, r"range_m .*\(0.0, 100.0\)"),
        (SimConfig, {"range_m": (100.0, 10001.0)}, r"range_m .*10000.*\(100.0, 10001.0\)"),
        (SimConfig, {"start_m": 5.0}, "start_m .*5.0 and 12.0"),
        (SimConfig, {"start_m": INF}, "start_m .*10000.*inf"),
        (SimConfig, {"elevation_deg": (5.0, 3.0)}, r"elevation_deg .*\(5.0, 3.0\)"),
        (SimConfig, {"air": AirConfig(patchiness=0.5)}, "patchiness.*preset paper"),
        (WeatherConfig, {"time_of_day": "noon"}, "time_of_day .*'day', 'dusk', 'night'.*'noon'"),
        (WeatherConfig, {"sky": "green"}, "sky .*'green'"),
        (WeatherConfig, {"sea_state": 7}, "sea_state .*6.*7"),
        (WeatherConfig, {"wind_m_s": -1.0}, "wind_m_s .*-1.0"),
        (MotionConfig, {"sea_state": 6.5}, "sea_state .*6.*6.5"),
        (MotionConfig, {"ship_speed_m_s": -1.0}, "ship_speed_m_s .*-1.0"),
        (FlightConfig, {"glideslope_deg": 0.0}, "glideslope_deg .*1.*0.0"),
        (FlightConfig, {"speed_m_s": 500.0}, "speed_m_s .*150.*500.0"),
        (FlightConfig, {"crosswind_m_s": 41.0}, "crosswind_m_s .*40.*41.0"),
        (FlightConfig, {"lateral_offset_m": NAN}, "lateral_offset_m .*1000.*nan"),
        (FlightConfig, {"turbulence_m_s": -1.0}, "turbulence_m_s .*-1.0"),
        (FlightConfig, {"pointing": "down"}, "pointing .*'ahead', 'runway'.*'down'"),
        (LensConfig, {"distortion": (0.1, 0.2)}, r"distortion .*5.*\(0.1, 0.2\)"),
        (LensConfig, {"principal_offset_px": (NAN, 0.0)}, r"principal_offset_px .*\(nan, 0.0\)"),
        (ExposureConfig, {"exposure_s": 2.0}, "exposure_s .*1.*2.0"),
        (ExposureConfig, {"rain_mm_h": -1.0}, "rain_mm_h .*-1.0"),
        (SensorConfig, {"vignetting": 2.0}, "vignetting .*1.*2.0"),
        (SensorConfig, {"jpeg_quality": 101}, "jpeg_quality .*100.*101"),
        (SensorConfig, {"tone": "hdr"}, "tone .*'hdr'"),
        (SensorConfig, {"white_balance": (1.0, 0.0, 1.0)}, r"white_balance .*\(1.0, 0.0, 1.0\)"),
        (SensorConfig, {"white_balance": (NAN, 1.0, 1.0)}, r"white_balance .*\(nan, 1.0, 1.0\)"),
        (SensorConfig, {"white_balance": (1.0, INF, 1.0)}, r"white_balance .*\(1.0, inf, 1.0\)"),
        (AirConfig, {"model": "mist"}, "model .*'mist'"),
        (AirConfig, {"scale_height_m": 39.0}, "scale_height_m .*40.*39.0"),
        (AirConfig, {"patch_m": 0.0}, "patch_m .*1.*0.0"),
        (AirConfig, {"model": "paper", "glow": 0.0, "angstrom": 1.0}, "angstrom, glow.*paper"),
        (AirConfig, {"patchiness": 1.0}, "patchiness .*0.9.*1.0"),
        (DepthConfig, {"range_m": 0.0}, "range_m .*0.0"),
        (DepthConfig, {"noise_m": -1.0}, "noise_m .*-1.0"),
        (DepthConfig, {"dropout": 1.5}, "dropout .*1.*1.5"),
        (NavigationConfig, {"position_sigma_m": -0.1}, "position_sigma_m .*-0.1"),
        (NavigationConfig, {"drift_s": 0.0}, "drift_s .*1.*0.0"),
        (ContactSheetConfig, {"tile_px": 0}, "tile_px .*0$"),
        (DatasetConfig, {"test": 600}, "test .*599.*600"),
        (DatasetConfig, {"seed": -1}, "seed .*-1"),
        (DatasetConfig, {"visibility_m": (300.0, INF)}, r"visibility_m .*\(300.0, inf\)"),
        (DatasetConfig, {"tile_px": 721}, "tile_px .*721"),
    ],
)
def test_wrong_settings_are_named(kind, settings, named):
    with pytest.raises(ValueError, match=named):
        kind(**settings)


def test_air_that_may_be_physical_is_described():
    patchy = AirConfig(patchiness=0.5)
    assert SimConfig(preset="train", air=patchy).air == patchy
    assert SimConfig(air=replace(patchy, model="physical")).air.patchiness == 0.5


def test_training_sees_farther_and_nearer():
    assert SimConfig(preset="train").ranges_m == (30.0, 1500.0)
    assert SimConfig(preset="cvn").ranges_m == (60.0, 800.0)
    assert SimConfig(preset="train", range_m=(100.0, 200.0)).ranges_m == (100.0, 200.0)
