from dataclasses import replace

import pytest

from deckline.sim import SimConfig
from deckline.sim.camera.atmosphere import AirConfig


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"preset": "yacht"}, "preset must be one of .*'paper', 'cvn', .*'train'.* got 'yacht'"),
        ({"trajectory": "loop"}, "trajectory must be one of .* got 'loop'"),
        ({"frames": 0}, "frames must be at least 1, got 0"),
        ({"width": 0}, "width must be at least 1, got 0"),
        ({"seed": -1}, "seed must not be negative, got -1"),
        ({"fov_deg": 180.0}, "fov_deg must lie between 1 and 150, got 180.0"),
        ({"visibility_m": (500.0, 100.0)}, r"visibility_m must be \(low, high\).* got \(500.0, 100.0\)"),
        ({"range_m": (0.0, 100.0)}, r"range_m must be .* got \(0.0, 100.0\)"),
        ({"visibility_m": (500.0, float("inf"))}, r"finite on both sides or on none, got \(500.0, inf\)"),
        ({"width": 8193}, "width and height must be at most 8192 px, got 8193x720"),
        ({"start_m": 5.0}, "start_m must exceed end_m > 0, got 5.0 and 12.0"),
        ({"start_m": float("inf")}, "ships are drawn up to 10000 m away, got a distance of inf m"),
        ({"elevation_deg": (5.0, 3.0)}, r"elevation_deg must be .* got \(5.0, 3.0\)"),
        ({"range_m": (100.0, 10001.0)}, "ships are drawn up to 10000 m away, got a distance of 10001 m"),
        ({"air": AirConfig(patchiness=0.5)}, "physical knows patchiness, and preset paper uses model paper"),
    ],
)
def test_wrong_settings_are_named(settings, message):
    with pytest.raises(ValueError, match=message):
        SimConfig(**settings)


def test_air_that_may_be_physical_is_described():
    patchy = AirConfig(patchiness=0.5)
    assert SimConfig(preset="train", air=patchy).air == patchy
    assert SimConfig(air=replace(patchy, model="physical")).air.patchiness == 0.5


def test_training_sees_farther_and_nearer():
    assert SimConfig(preset="train").ranges_m == (30.0, 1500.0)
    assert SimConfig(preset="cvn").ranges_m == (60.0, 800.0)
    assert SimConfig(preset="train", range_m=(100.0, 200.0)).ranges_m == (100.0, 200.0)
