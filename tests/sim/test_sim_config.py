"""Settings of the simulator: every refusal names the setting and the value."""

import re

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
from deckline_sim.visibility import parse_visibility, visibility_text

INF, NAN = float("inf"), float("nan")
# Values out of range, and the limit or the choices that the error names.
REFUSED = {
    SimConfig: [
        *[("preset", "yacht", "paper, cvn, "), ("trajectory", "loop", "approach"), ("frames", 0, "1 ")],
        *[("width", 0, "8192"), ("width", 8193, "8192"), ("seed", -1, "0 "), ("fov_deg", 180.0, "150")],
        *[("visibility_m", (500.0, 100.0), ""), ("visibility_m", (500.0, INF), "")],
        *[("range_m", (0.0, 100.0), ""), ("range_m", (100.0, 10001.0), "10000")],
        *[("start_m", 5.0, ""), ("start_m", INF, "10000"), ("elevation_deg", (5.0, 3.0), "45")],
    ],
    WeatherConfig: [
        *[("time_of_day", "noon", "day, dusk, night"), ("sky", "green", "clear"), ("sea_state", 7, "6")],
        *[("wind_m_s", -1.0, "40")],
    ],
    MotionConfig: [("sea_state", 6.5, "6"), ("ship_speed_m_s", -1.0, "30")],
    FlightConfig: [
        *[("glideslope_deg", 0.0, "1"), ("speed_m_s", 500.0, "150"), ("crosswind_m_s", 41.0, "40")],
        *[("lateral_offset_m", NAN, "1000"), ("turbulence_m_s", -1.0, "10"), ("pointing", "down", "ahead, runway")],
    ],
    LensConfig: [("distortion", (0.1, 0.2), "5"), ("principal_offset_px", (NAN, 0.0), "2")],
    ExposureConfig: [("exposure_s", 2.0, "1"), ("rain_mm_h", -1.0, "500")],
    SensorConfig: [
        *[("vignetting", 2.0, "1"), ("jpeg_quality", 101, "100"), ("tone", "hdr", "gamma")],
        *[("white_balance", gains, "3") for gains in ((1.0, 0.0, 1.0), (NAN, 1.0, 1.0), (1.0, INF, 1.0))],
    ],
    AirConfig: [
        *[("model", "mist", "paper"), ("scale_height_m", 39.0, "40"), ("patch_m", 0.0, "1")],
        *[("patchiness", 1.0, r"0\.9")],
    ],
    DepthConfig: [("range_m", 0.0, ""), ("noise_m", -1.0, "0 "), ("dropout", 1.5, "1")],
    NavigationConfig: [("position_sigma_m", -0.1, "0 "), ("drift_s", 0.0, "1")],
    ContactSheetConfig: [("tile_px", 0, "1")],
    DatasetConfig: [("test", 600, "599"), ("seed", -1, ""), ("visibility", "clear", ""), ("tile_px", 721, "")],
}


@pytest.mark.parametrize(
    ("kind", "name", "value", "limit"),
    [(kind, *row) for kind, rows in REFUSED.items() for row in rows],
)
def test_wrong_settings_are_named(kind, name, value, limit):
    with pytest.raises(ValueError, match=rf"{name}\b.*{limit}.*{re.escape(repr(value))}"):
        kind(**{name: value})


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: SimConfig(trajectory="deckless"), "deckless .*'paper'"),
        (lambda: SimConfig(air=AirConfig(patchiness=0.5)), "patchiness.*preset paper"),
        (lambda: AirConfig(model="paper", glow=0.0, angstrom=1.0), "angstrom, glow.*paper"),
    ],
)
def test_settings_that_contradict_each_other_are_named(make, named):
    with pytest.raises(ValueError, match=named):
        make()


def test_training_may_have_physical_air():
    assert SimConfig(preset="train", air=AirConfig(patchiness=0.5)).air.patchiness == 0.5


@pytest.mark.parametrize(
    ("text", "expected"),
    [("clear", (INF, INF)), ("800", (800.0, 800.0)), ("300..3000", (300.0, 3000.0))],
)
def test_visibility_is_one_value_a_range_or_clear(text, expected):
    assert parse_visibility(text) == expected
    assert visibility_text(expected) == text


@pytest.mark.parametrize("text", ["", "fog", "3000..300", "0", "-5..10", "nan"])
def test_other_visibilities_are_refused_by_name(text):
    with pytest.raises(ValueError, match=f"visibility .* got {text!r}"):
        parse_visibility(text)
