"""Landings with the faults of the integrity campaign."""

import pytest

from deckline_lab.campaigns.faults import FaultySight, faulty_sights, find_fault, misstate_width
from deckline_lab.campaigns.landings import check_landing, fly_landing
from deckline_sim.landing.config import LandingConfig
from deckline_sim.landing.landing import fly
from deckline_sim.landing.surroundings import surroundings
from deckline_sim.landing.touchdown import Outcome

CALM = LandingConfig(sea_state=0.0, wind_m_s=0.0, burble=0.0, start_m=600.0, navigation="exact")


def with_fault(name, **changes):
    return LandingConfig(**{**vars(CALM), **changes, "fault": name})


@pytest.mark.parametrize("name", ["no such", "rain"])  # rain needs a picture
def test_unknown_faults_and_those_of_pictures_are_refused(name):
    with pytest.raises(ValueError, match=name):
        find_fault(name)


def test_faults_need_points():
    with pytest.raises(ValueError, match="guidance"):
        faulty_sights(with_fault("swapped lines", sight="guidance"), 0)
    with pytest.raises(ValueError, match="swapped lines"):
        fly(with_fault("swapped lines"), 0)


def test_faults_need_a_picture():
    with pytest.raises(ValueError, match=r"swapped lines.*navigation"):
        check_landing(with_fault("swapped lines", guidance="navigation"))


@pytest.mark.parametrize("name", ["pose late by 0.2 s", "deck height of the sea"])
def test_faults_of_a_pose_need_one(name):
    with pytest.raises(ValueError, match=f"{name}.*picture"):
        check_landing(with_fault(name, guidance="picture"))


def test_a_width_is_told_wrongly():
    run = surroundings(CALM, 0).run
    assert misstate_width(run, 0.2).deck.width_m == pytest.approx(1.2 * run.deck.width_m)
    assert misstate_width(run, 0.0) is run


def test_a_sudden_fault_begins_on_the_way():
    sight = FaultySight(with_fault("swapped lines"), 1)
    sight.close()
    assert 3.0 <= sight.onset_s <= 20.0


def test_a_camera_that_is_turned_does_not_land_unseen():
    landing = fly_landing(with_fault("mount 12 deg in yaw"), 2)
    assert landing.outcome is Outcome.WAVE_OFF
    assert landing.called_for
    assert landing.misleading == 0
