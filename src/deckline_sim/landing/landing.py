"""One landing: aircraft, ship, air, navigation, camera, guidance and autopilot on one clock, each at its own rate."""

import math
from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deckline.types import Guidance, Status
from deckline_sim.flight.approach import closing_speed
from deckline_sim.landing.air import Gusts, wake
from deckline_sim.landing.aircraft import AIRCRAFT_TYPES, DYNAMICS_HZ, Aircraft, AircraftState, Controls
from deckline_sim.landing.autopilot import DECISION_M, Autopilot, Fix, WaveOff, in_window
from deckline_sim.landing.config import LandingConfig
from deckline_sim.landing.deck import rotation_matrix
from deckline_sim.landing.deviations import Deviations, deviations
from deckline_sim.landing.exact_sight import ExactSight
from deckline_sim.landing.guidance_sight import GuidanceSight
from deckline_sim.landing.navigation_sight import NavigationSight
from deckline_sim.landing.point_sight import PointSight
from deckline_sim.landing.sight import Closing, Moment, Sight
from deckline_sim.landing.surroundings import Surroundings, surroundings
from deckline_sim.landing.touchdown import Outcome, Touchdown, outcome_of, strikes_ramp, touch

AUTOPILOT_EVERY = 2  # steps of the dynamics: 60 Hz
SAMPLE_EVERY = 4  # steps between two samples of the flight for films: 30 Hz
START_SIGMA_M = (10.0, 3.0)  # 1-sigma of the first lateral and vertical offset; our choice
NEAR_M = 60.0  # to the ramp, from which contacts are looked for
CLEAR_M = 15.0  # above the deck and climbing: a go-around is over
LONGEST_S = 120.0
SEEN_SHARE = 0.8  # of the visibility: a ramp that is nearer ought to be seen
COUNTED_M = 800.0  # to the ramp, from which answers are counted
MODELLED = {"points": PointSight, "guidance": GuidanceSight, "exact": ExactSight}  # sights without pictures
# Random streams of a landing.
AIR, START = 31, 32


@dataclass(frozen=True, eq=False)
class Sample:
    """The flight at one time, for films and plots."""

    time_s: float
    """Of the sample, s."""
    state: AircraftState
    """The aircraft, true."""
    guidance: Guidance | None
    """What the autopilot follows."""


@dataclass(frozen=True, eq=False)
class Landing:
    """How one pass went."""

    outcome: Outcome
    """How it ended."""
    touchdown: Touchdown | None
    """The contact with the deck; None: there was none."""
    wave_off: WaveOff | None
    """Why it was broken off; None: it was not."""
    called_for: bool
    """Of a pass that was broken off: whether it had to be, by what was truly so."""
    first_ok_m: float | None
    """Distance to the ramp at the first `ok` answer of the picture, m; None: there was none."""
    ok_share: float
    """Of the answers of the picture within 800 m of the ramp, how many were `ok`."""
    misleading: int
    """Answers that were `ok`, within 800 m, with an error beyond their protection level or without a level."""
    seconds: float
    """Flown time, s."""
    samples: tuple[Sample, ...]
    """The flight."""

    def record(self) -> dict[str, Any]:
        """What a campaign keeps: plain numbers and names."""
        contact = self.touchdown
        return {
            "outcome": str(self.outcome),
            "beyond_aim_m": None if contact is None else round(contact.beyond_aim_m, 3),
            "right_m": None if contact is None else round(contact.right_m, 3),
            "sink_m_s": None if contact is None else round(contact.sink_m_s, 3),
            "wire": None if contact is None else contact.wire,
            "wave_off": None if self.wave_off is None else str(self.wave_off),
            "called_for": self.called_for,
            "first_ok_m": None if self.first_ok_m is None else round(self.first_ok_m, 1),
            "ok_share": round(self.ok_share, 3),
            "misleading": self.misleading,
            "seconds": round(self.seconds, 3),
        }


@dataclass(eq=False)
class AnswerCount:
    """What came of the answers of the picture so far; `count`, `ok`, `misleading` within COUNTED_M."""

    first_ok_m: float | None = None
    count: int = 0
    ok: int = 0
    misleading: int = 0

    def add(self, answer: Guidance, truth: Deviations) -> None:
        """Count an answer to a picture."""
        is_ok = answer.status is Status.OK
        if is_ok and self.first_ok_m is None:
            self.first_ok_m = truth.distance_m
        if truth.distance_m > COUNTED_M:
            return
        self.count += 1
        self.ok += is_ok
        self.misleading += is_ok and is_misleading(answer, truth)


def is_misleading(answer: Guidance, truth: Deviations) -> bool:
    """Whether lateral deviation or height is farther from the truth than the answer's protection level, or has none."""
    level, lateral, height = answer.protection, answer.lateral_deviation_m, answer.height_above_deck_m
    if lateral is None or height is None:
        return False
    if level is None:
        return True
    off = abs(lateral.value - truth.lateral_m), abs(height.value - truth.height_m)
    return off[0] > level.lateral_m or off[1] > level.vertical_m


@dataclass(frozen=True, eq=False)
class Sights:
    """What an aircraft is guided by."""

    picture: Sight
    """What it lands with: the camera's answers, or what stands for them."""
    navigation: Sight | None = None
    """Followed on the way in while the picture gives nothing; None: it holds its path."""

    @classmethod
    def of_config(cls, config: LandingConfig, seed: int) -> "Sights":
        """The sights that a configuration names."""
        if config.guidance == "navigation":
            return cls(NavigationSight(config, seed))
        navigation = NavigationSight(config, seed) if config.guidance == "both" else None
        if config.sight == "rendered":
            from deckline_sim.landing.rendered_sight import RenderedSight  # needs OpenGL

            return cls(RenderedSight(config, seed), navigation)
        return cls(MODELLED[config.sight](config, seed), navigation)

    def close(self) -> None:
        """End the threads of the sights."""
        for sight in (self.picture, self.navigation):
            if isinstance(sight, Closing):
                sight.close()


def start_aircraft(scene: Surroundings) -> Aircraft:
    """The aircraft trimmed on the glideslope, some metres beside it.

    Raises:
        ValueError: a model that cannot be trimmed, or wind and ship too fast for it.
    """
    config, deck, slope = scene.config, scene.deck, scene.run.approach.slope
    lateral, vertical = np.random.default_rng([scene.seed, START]).normal(0.0, START_SIGMA_M)
    along, ship, wind_m_s = deck.landing_direction, deck.velocity_m_s, scene.wind_m_s
    speed = AIRCRAFT_TYPES[config.aircraft].airspeed_m_s
    closing = closing_speed(along, ship[:2], wind_m_s[:2], speed)
    through_air = ship[:2] + closing * along - wind_m_s[:2]
    to_go = config.start_m + deck.touchdown_m
    right = np.array([-along[1], along[0]])
    place = deck.centre_line(0.0, steady=True)[0] - [0.0, 0.0, to_go * slope + vertical]
    place[:2] += -config.start_m * along + lateral * right
    heading = math.atan2(through_air[1], through_air[0])
    descent = -math.asin(closing * slope / speed)
    return Aircraft(config.aircraft, place, heading, descent, wind_m_s, deck.layout.sea_z_m)


def fly(config: LandingConfig, seed: int, sights: Sights | None = None) -> Landing:
    """One pass from the start to the deck, or clear of it; the same for the same configuration, seed and sights.

    Args:
        config: what it is flown in.
        seed: of everything random.
        sights: what guides it; None: those that the configuration names.

    Raises:
        ValueError: a fault without sights that have it, an aircraft that cannot be trimmed, or wind and ship too fast.
    """
    if sights is None and config.fault is not None:
        raise ValueError(f"fault {config.fault!r} needs sights that have it: fly it in a campaign")
    used = sights or Sights.of_config(config, seed)
    try:
        return _Pass(surroundings(config, seed), used).fly()
    finally:
        if sights is None:
            used.close()


class _Pass:
    """One pass on its way."""

    def __init__(self, scene: Surroundings, sights: Sights) -> None:
        config, deck = scene.config, scene.deck
        self.config, self.scene, self.sights = config, scene, sights
        self.aircraft = aircraft = start_aircraft(scene)
        self.points_m = np.array([scene.run.approach.point_m, *aircraft.wheels_m])  # hook first
        self.gusts = Gusts(config.wind_m_s * config.turbulence, np.random.default_rng([scene.seed, AIR]))
        north, east = deck.landing_direction.tolist()
        self.autopilot = Autopilot(
            aircraft.state,
            aircraft.trim_throttle,
            scene.run.approach.slope,
            ramp_clearance_m=scene.run.approach.slope * deck.touchdown_m,
            rate_hz=DYNAMICS_HZ / AUTOPILOT_EVERY,
            has_limits=config.level_limits,
            fix=Fix(config.start_m + deck.touchdown_m, (north, east), float(deck.velocity_m_s[:2] @ [north, east])),
        )
        self.along: list[float] = [north, east]
        self.ramp_m, self.ship_m_s = deck.centre_line(0.0, steady=True)[0].tolist(), deck.velocity_m_s.tolist()
        self.over_deck_m_s = float((deck.velocity_m_s - scene.wind_m_s)[:2] @ deck.landing_direction)
        self.waiting: deque[tuple[float, Guidance, AircraftState]] = deque()
        self.answers = AnswerCount()
        self.samples: list[Sample] = []
        self.called_for = False
        self.time_s = 0.0

    def fly(self) -> Landing:
        """Step by step to the end."""
        picture_every = max(round(DYNAMICS_HZ / self.config.camera.rate_hz), 1)
        controls = Controls(throttle=self.aircraft.trim_throttle)
        before: NDArray[np.float64] | None = None
        for step in range(round(LONGEST_S * DYNAMICS_HZ)):
            self.time_s = step / DYNAMICS_HZ
            if step % picture_every == 0 and self.autopilot.wave_off is None:
                self._see()
            if step % AUTOPILOT_EVERY == 0:
                controls = self._steer()
            if step % SAMPLE_EVERY == 0:
                self.samples.append(Sample(self.time_s, self.aircraft.state, self.autopilot.flown))
            if self.aircraft.step(controls, self._gust()).has_departed:
                return self._landing(Outcome.DEPARTED, None)
            now = self._contact_points((step + 1) / DYNAMICS_HZ)
            if now is not None and before is not None:
                ended = self._end(before, now, (step + 1) / DYNAMICS_HZ)
                if ended is not None:
                    return self._landing(*ended)
            if self.aircraft.state.position_m[2] > self.scene.deck.layout.sea_z_m:
                break
            before = now
        return self._landing(Outcome.WATER, None)

    def _see(self) -> None:
        """Take a picture, and follow navigation while pictures were of no use."""
        state = self.aircraft.state
        moment = Moment(self.time_s, state.world_from_body, np.array(state.velocity_m_s), np.array(state.rates_rad_s))
        answer = self.sights.picture.see(moment)
        if answer is not None:
            self.waiting.append((self.time_s + self.config.camera.latency_s, answer, state))
            self.answers.add(answer, self._truth(state, self.time_s))
        if self.sights.navigation is not None and not self.autopilot.has_picture(self.time_s):
            known = self.sights.navigation.see(moment)
            if known is not None:
                self.autopilot.hear(known, state, is_of_picture=False)

    def _steer(self) -> Controls:
        while self.waiting and self.waiting[0][0] <= self.time_s:
            _, answer, then = self.waiting.popleft()
            self.autopilot.hear(answer, then, is_of_picture=True)
        was_flown = self.autopilot.wave_off is None
        controls = self.autopilot.fly(self.aircraft.state, self.time_s)
        if was_flown and self.autopilot.wave_off is not None:
            self.called_for = self._is_called_for()
        return controls

    def _is_called_for(self) -> bool:
        """Whether the pass had to be broken off: the deck hidden, a fault, or truly outside the window.

        Hidden: haze hides the ramp from the decision range on; a farther one need not be seen yet. An aircraft that
        saw nothing of a ramp in view failed, also where it strayed out of the window for that reason.
        """
        found, approach = self._truth(self.aircraft.state, self.time_s), self.scene.run.approach
        decided_m = min(found.distance_m, DECISION_M - approach.touchdown_m)
        if decided_m > SEEN_SHARE * self.config.visibility_m or self.config.fault is not None:
            return True
        to_go = found.distance_m + approach.touchdown_m
        is_inside = in_window(found.lateral_m, found.height_m - to_go * approach.slope, to_go)
        return self.autopilot.wave_off is not WaveOff.NOT_SEEN and not is_inside

    def _truth(self, state: AircraftState, time_s: float) -> Deviations:
        """Where the hook truly is relative to the moving deck."""
        return deviations(self.scene, time_s, state.world_from_body, np.array(state.velocity_m_s))

    def _gust(self) -> tuple[float, float, float]:
        """Gusts and wake at the aircraft, world, m/s."""
        state, along = self.aircraft.state, self.along
        behind, above = self._behind_ramp(self.time_s)
        sinking, missing, rough = wake(behind, above, self.over_deck_m_s, self.config.burble)
        height_m = self.scene.deck.layout.sea_z_m - state.position_m[2]
        ahead, side, down = self.gusts.step(height_m, state.airspeed_m_s, rough)
        ahead += missing
        north, east = ahead * along[0] - side * along[1], ahead * along[1] + side * along[0]
        return north, east, down + sinking

    def _behind_ramp(self, time_s: float) -> tuple[float, float]:
        """Distance to the ramp of the steady ship along the landing direction, and height above it, m."""
        place, ramp, ship = self.aircraft.state.position_m, self.ramp_m, self.ship_m_s
        north, east = (ramp[k] + ship[k] * time_s - place[k] for k in (0, 1))
        return north * self.along[0] + east * self.along[1], ramp[2] - place[2]

    def _contact_points(self, time_s: float) -> NDArray[np.float64] | None:
        """Hook and wheels in the ship's frame; None far from the ship."""
        state = self.aircraft.state
        if self._behind_ramp(time_s)[0] > NEAR_M:
            return None
        points = state.position_m + self.points_m @ rotation_matrix(*state.attitude_rad).T
        return self.scene.deck.in_ship_frame(points, time_s)

    def _end(
        self, before: NDArray[np.float64], now: NDArray[np.float64], time_s: float
    ) -> tuple[Outcome, Touchdown | None] | None:
        """How the pass has ended at this step; None: it goes on."""
        deck = self.scene.deck
        if any(strikes_ramp(*places, deck) for places in zip(before, now, strict=True)):
            return Outcome.RAMP_STRIKE, None
        contact = touch(before, now, 1 / DYNAMICS_HZ, time_s, deck)
        if contact is not None:
            return outcome_of(contact, self.aircraft.type.sink_limit_m_s), contact
        is_past = bool(now[0, 0] > deck.layout.length_m)
        if self.autopilot.wave_off is None:
            return (Outcome.WATER, None) if is_past else None
        is_clear = is_past or (-now[0, 2] > CLEAR_M and self.aircraft.state.velocity_m_s[2] < 0)
        return (Outcome.WAVE_OFF, None) if is_clear else None

    def _landing(self, outcome: Outcome, contact: Touchdown | None) -> Landing:
        answers = self.answers
        return Landing(
            outcome,
            contact,
            self.autopilot.wave_off,
            self.called_for,
            answers.first_ok_m,
            answers.ok / answers.count if answers.count else 0.0,
            answers.misleading,
            self.time_s,
            tuple(self.samples),
        )
