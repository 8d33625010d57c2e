"""Rivals by name: an evaluation finds them and what `deckline` has; a run finds only the latter."""

import pytest

from deckline.config import Models, RunConfig
from deckline.dehaze import DEHAZERS
from deckline.flight import Flight
from deckline.runtime import shipped_models, shipped_weights
from deckline_lab.rivals import LAB_WEIGHTS
from deckline_lab.rivals.catalog import (
    ALL_DEHAZERS,
    ALL_DETECTORS,
    RIVAL_DEHAZERS,
    flight_from_config,
    open_flights,
)
from deckline_lab.rivals.classical import ClassicalDetector
from deckline_lab.rivals.dark_channel import DarkChannelDehazer


def test_a_flight_of_rivals() -> None:
    flight = flight_from_config(RunConfig(models=Models("dark-channel", "classical")))
    assert isinstance(flight.dehazer, DarkChannelDehazer)
    assert isinstance(flight.detector, ClassicalDetector)


def test_a_part_that_is_given_is_used() -> None:
    detector = ClassicalDetector()
    flight = flight_from_config(RunConfig(models=Models("none", "hybrid")), detector=detector)
    assert flight.detector is detector
    assert flight.dehazer.name == "none"


@pytest.mark.parametrize(
    ("part", "models", "known"),
    [("dehazer", Models("fog-lamp", "classical"), ALL_DEHAZERS), ("detector", Models("none", "eye"), ALL_DETECTORS)],
)
def test_an_unknown_name_is_refused_with_all_that_there_is(part: str, models: Models, known: dict) -> None:
    with pytest.raises(ValueError, match=getattr(models, part)) as caught:
        flight_from_config(RunConfig(models=models))
    assert all(name in str(caught.value) for name in known)


@pytest.mark.parametrize("models", [Models(dehazer=name, detector="hybrid") for name in RIVAL_DEHAZERS])
def test_a_run_knows_no_rival(models: Models) -> None:
    with pytest.raises(ValueError, match=models.dehazer) as caught:
        Flight.from_config(RunConfig(models=models))
    assert all(name in str(caught.value) for name in DEHAZERS)


def test_the_lab_ships_what_its_manifest_lists() -> None:
    models = shipped_models(LAB_WEIGHTS)
    assert set(models) == {"paper-scene"}
    for name in models:
        assert shipped_weights(name, LAB_WEIGHTS).stat().st_size > 10_000


def test_flights_share_the_models_that_they_name_alike() -> None:
    pairs = [("none", "classical"), ("dark-channel", "classical"), ("none", "ufld")]
    first, second, third = open_flights(RunConfig(models=Models(*pair)) for pair in pairs)
    assert first.dehazer is third.dehazer and second.dehazer.name == "dark-channel"
    assert first.detector is second.detector and third.detector.name == "ufld"
    assert third.config.models == Models(*pairs[2])
