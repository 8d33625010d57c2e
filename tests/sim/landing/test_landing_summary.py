"""A landing in words."""

import pytest

from deckline_sim.landing.autopilot import WaveOff
from deckline_sim.landing.config import LandingConfig
from deckline_sim.landing.landing import Landing
from deckline_sim.landing.summary import NAMES, describe_touchdown, name_outcome, summarise_landing
from deckline_sim.landing.touchdown import Outcome, Touchdown


def landing(outcome, contact=None, wave_off=None):
    return Landing(outcome, contact, wave_off, False, None, 0.0, 0, 20.0, ())


def test_a_wire_has_its_number_and_its_place():
    made = landing(Outcome.WIRE, Touchdown(20.0, -2.66, 0.28, 3.54, 2))
    assert name_outcome(made) == "wire 2"
    text = summarise_landing(LandingConfig(visibility_m=600.0), 7, made)
    for part in ("landing 7", "600 m", "wire 2", "2.7 m short", "0.3 m right", "3.5 m/s"):
        assert part in text


@pytest.mark.parametrize(
    ("along", "across", "words"), [(1.0, -2.0, ("beyond", "left")), (-1.0, 2.0, ("short", "right"))]
)
def test_sides_of_a_touchdown(along, across, words):
    text = describe_touchdown(landing(Outcome.BOLTER, Touchdown(20.0, along, across, 3.0, None)))
    assert all(word in text for word in words)


def test_a_pass_that_is_broken_off_has_its_reason():
    assert name_outcome(landing(Outcome.WAVE_OFF, wave_off=WaveOff.LOST)) == f"wave-off, {WaveOff.LOST}"
    strike = name_outcome(landing(Outcome.RAMP_STRIKE, wave_off=WaveOff.WINDOW))
    assert strike == f"ramp strike after wave-off, {WaveOff.WINDOW}"


def test_every_outcome_has_a_name():
    assert set(NAMES) == set(Outcome)
    assert describe_touchdown(landing(Outcome.WATER)) == ""
