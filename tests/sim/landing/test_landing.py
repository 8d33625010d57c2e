import itertools
import json
import math
from dataclasses import replace

import numpy as np
import pytest

from deckline.config import Models, Tracking
from deckline_sim.landing.aircraft import AIRCRAFT_TYPES, DYNAMICS_HZ, Aircraft, Controls
from deckline_sim.landing.autopilot import DECISION_M, WaveOff, in_window
from deckline_sim.landing.config import MODELLED_SEA_STATE, LandingCamera, LandingConfig
from deckline_sim.landing.exact_sight import ExactSight
from deckline_sim.landing.landing import Sights, fly, is_misleading, start_aircraft
from deckline_sim.landing.sight import Moment
from deckline_sim.landing.touchdown import Outcome

CALM = LandingConfig(sea_state=0.0, wind_m_s=0.0, burble=0.0, start_m=700.0)


class Recording(ExactSight):
    """Keeps the last moment."""

    def see(self, moment):
        self.moment = moment
        return super().see(moment)


class Biased(ExactSight):
    """Says 3 m too far right, with levels of 2 m."""

    def see(self, moment):
        answer = super().see(moment)
        lateral = replace(answer.lateral_deviation_m, value=answer.lateral_deviation_m.value + 3.0)
        return replace(
            answer, lateral_deviation_m=lateral, protection=replace(answer.protection, lateral_m=2.0, vertical_m=1.0)
        )


def land(config, seed=0, seen_m=math.inf):
    return fly(config, seed, Sights(ExactSight(config, seed, seen_m)))


def test_a_trimmed_aircraft_stays_on_its_path_and_the_wind_carries_it():
    flown = []
    for wind in (np.zeros(3), np.array([-8.0, 3.0, 0.0])):
        aircraft = Aircraft("A4", np.array([10.0, 20.0, -150.0]), 0.4, math.radians(-3.5), wind)
        controls = Controls(throttle=aircraft.trim_throttle)
        for _ in range(round(4 * DYNAMICS_HZ)):
            state = aircraft.step(controls, (0.0, 0.0, 0.0))
        assert state.airspeed_m_s == pytest.approx(130 * 1852 / 3600, rel=0.01)
        flown.append(np.array(state.position_m))
    path = flown[0] - [10.0, 20.0, -150.0]
    assert math.atan2(path[1], path[0]) == pytest.approx(0.4, abs=1e-3)
    assert math.degrees(math.atan2(path[2], math.hypot(*path[:2]))) == pytest.approx(3.5, abs=0.1)
    np.testing.assert_allclose(flown[1] - flown[0], [-32.0, 12.0, 0.0], atol=0.01)


@pytest.mark.parametrize(("model", "gamma_deg", "named"), [("A5", -3.5, "A5"), ("A4", 60.0, "60.0")])
def test_what_cannot_be_flown_is_refused(model, gamma_deg, named):
    with pytest.raises(ValueError, match=named):
        Aircraft(model, np.array([0.0, 0.0, -100.0]), 0.0, math.radians(gamma_deg), np.zeros(3))


@pytest.mark.parametrize("aircraft", sorted(AIRCRAFT_TYPES))
@pytest.mark.parametrize("ship", ["cvn", "paper", "axial"])
def test_in_calm_air_it_lands_on_the_point(ship, aircraft):
    landing = land(replace(CALM, ship=ship, aircraft=aircraft))
    assert landing.outcome is Outcome.WIRE
    assert abs(landing.touchdown.beyond_aim_m) < 2.0
    assert abs(landing.touchdown.right_m) < 0.2
    assert (landing.misleading, landing.wave_off, landing.ok_share) == (0, None, 1.0)


def test_the_same_seed_flies_the_same_landing():
    one, same, other = (land(LandingConfig(start_m=600.0), seed).record() for seed in (3, 3, 4))
    assert one == same != other


def test_an_aircraft_that_sees_nothing_in_time_goes_around():
    landing = land(replace(CALM, visibility_m=150.0), seen_m=100.0)
    assert (landing.outcome, landing.wave_off, landing.called_for) == (Outcome.WAVE_OFF, WaveOff.NOT_SEEN, True)
    clear = land(CALM, seen_m=100.0)
    assert (clear.wave_off, clear.called_for) == (WaveOff.NOT_SEEN, False)


@pytest.mark.parametrize("start_m", [500.0, 1500.0, 3000.0])
def test_an_aircraft_that_hears_nothing_decides_at_the_decision_range(start_m):
    config = LandingConfig(guidance="picture", visibility_m=350.0, start_m=start_m)
    sight = Recording(config, 1, seen_m=0.0)
    landing = fly(config, 1, Sights(sight))
    aim_m = sight.surroundings.run.approach.touchdown_m
    assert sight.truth(sight.moment).distance_m + aim_m == pytest.approx(DECISION_M, abs=15.0)
    assert (landing.wave_off, landing.called_for) == (WaveOff.NOT_SEEN, False)


def test_an_aircraft_that_sees_the_ramp_late_lands():
    config = LandingConfig(guidance="picture", visibility_m=350.0, sea_state=1.0)
    assert fly(config, 1, Sights(ExactSight(config, 1, seen_m=280.0))).outcome is Outcome.WIRE


def test_a_wrong_guidance_that_says_ok_is_counted():
    landing = fly(CALM, 0, Sights(Biased(CALM, 0)))
    assert landing.misleading > 0
    assert landing.touchdown.right_m == pytest.approx(-3.0, abs=0.3)


def test_an_ok_without_a_protection_level_is_misleading():
    sight = ExactSight(CALM, 0)
    moment = Moment(
        0.0, start_aircraft(sight.surroundings).state.world_from_body, np.array([60.0, 0.0, 3.0]), np.zeros(3)
    )
    answer = sight.see(moment)
    assert not is_misleading(answer, sight.truth(moment))
    assert is_misleading(replace(answer, protection=None), sight.truth(moment))
    assert not is_misleading(replace(answer, protection=None, height_above_deck_m=None), sight.truth(moment))


@pytest.mark.parametrize("airspeed_m_s", [math.nan, 1e36])
def test_an_aircraft_whose_flight_model_diverges_is_an_outcome(monkeypatch, airspeed_m_s):
    step, steps = Aircraft.step, itertools.count()

    def diverge(self, *args):
        state = step(self, *args)
        return state if next(steps) < 3 * DYNAMICS_HZ else replace(state, airspeed_m_s=airspeed_m_s)

    monkeypatch.setattr(Aircraft, "step", diverge)
    landing = land(CALM, 2)
    assert landing.outcome == Outcome.DEPARTED
    json.dumps(landing.record(), allow_nan=False)
    assert landing.samples and all(not sample.state.has_departed for sample in landing.samples)


@pytest.mark.parametrize(
    "changes",
    [{"airspeed_m_s": math.nan}, {"airspeed_m_s": 400.0}, {"load_factor": math.inf}, {"rates_rad_s": (0, math.nan, 0)}],
)
def test_a_state_that_is_not_finite_has_departed(changes):
    state = Aircraft("A4", np.array([0.0, 0.0, -100.0]), 0.0, -0.06, np.zeros(3)).state
    assert not state.has_departed
    assert replace(state, **changes).has_departed


@pytest.mark.parametrize(
    ("lateral", "height", "to_go", "inside"),
    [(0.0, 0.0, 300.0, True), (10.0, 0.0, 300.0, True), (11.0, 0.0, 300.0, False), (0.0, -5.4, 300.0, False)],
)
def test_the_window_narrows_towards_the_deck(lateral, height, to_go, inside):
    assert in_window(lateral, height, to_go) is inside


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"ship": "tanker"}, "tanker"),
        ({"sea_state": 7.0}, "7.0"),
        ({"deck_period_factor": 0.1}, "deck_period_factor.*0.1"),
        ({"deck_period_factor": 5.0}, "deck_period_factor.*5.0"),
        ({"wind_m_s": math.nan}, "nan"),
        ({"visibility_m": 0.0}, "visibility_m"),
        ({"sight": "eyes"}, "eyes"),
        ({"start_m": 100.0}, "100.0"),
        ({"models": Models(detector="ufld")}, "rendered"),
        ({"sight": "guidance", "tracking": Tracking(enabled=False)}, "usual tracking.*rendered"),
        ({"sight": "exact", "tracking": Tracking(enabled=False)}, "usual tracking.*rendered"),
        ({"sight": "guidance", "ship": "paper"}, "ship cvn, got paper.*points"),
        ({"sight": "guidance", "time_of_day": "dusk"}, "time_of_day day, got dusk"),
        ({"sight": "guidance", "deck_period_factor": 0.5}, "deck_period_factor 1.0, got 0.5"),
        ({"sight": "guidance", "camera": LandingCamera(fov_deg=30.0)}, "camera.fov_deg 60.0, got 30.0"),
        ({"sight": "guidance", "camera": LandingCamera(width=640)}, "camera.width 1280, got 640"),
        ({"sight": "guidance", "guidance": "picture"}, "points"),
        ({"sight": "guidance", "sea_state": 4.5}, "sea_state 4, got 4.5"),
    ],
)
def test_impossible_settings_are_named(changes, named):
    with pytest.raises(ValueError, match=named):
        LandingConfig(**changes)


def test_modelled_guidance_flies_what_it_is_fitted_to():
    config = LandingConfig(sight="guidance", sea_state=4.0, camera=LandingCamera(rate_hz=20.0, latency_s=0.2))
    assert config.sea_state == MODELLED_SEA_STATE


def test_an_impossible_camera_is_named():
    with pytest.raises(ValueError, match="latency_s"):
        LandingCamera(latency_s=2.0)
