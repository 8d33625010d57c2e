"""The autopilot: from guidance to stick and throttle, and the decision to break off.

Path: the height error of the hook asks for a climb rate relative to the moving deck, an error of that rate for a pitch
attitude, and an error of the attitude for elevator. What a gust lifts, the accelerometer measures at once, and pitch
takes it back. The path follows late, so the rate is that which the deck will have then, by its expected acceleration.
The throttle holds the airspeed. Lateral: the deviation and its rate ask for a bank angle.

Between two answers, and for their latency, the deviations move on with the aircraft's own velocity. The deck's is what
the track measures: `height_rate_m_s` is relative to the moving deck.
"""

import math
from dataclasses import dataclass
from enum import StrEnum

from deckline.types import Guidance, Status, Value
from deckline_sim.landing.aircraft import AircraftState, Controls

GRAVITY_M_S2 = 9.81
HEIGHT_RAD_S = 0.8  # closing rate of a height error
MOST_CLIMB_M_S = 2.5  # beside the glideslope, to close a height error
PATH_GAIN, PATH_RAD_S = 5.0, 1.0  # pitch per error of the path angle, and its integral's rate
LEAD_S = 0.6  # by which the path follows late; of 0.6 and 0.8 s: docs/experiments/2026-11-landings.md
LIFT_S = 1.0  # pitch per rate of the path angle: what a gust lifts is taken back before it has moved the aircraft
MOST_PITCH_RAD = math.radians(6.0)  # from trim
PITCH_RAD_S, PITCH_DAMPING = 4.0, 3.0  # rate per error of pitch, elevator per error of the rate
SPEED_GAIN, SPEED_RAD_S = 0.04, 0.25  # throttle per m/s, and its integral's rate
THRUST_PER_RAD = 1.2  # throttle that a change of the path angle needs
LATERAL_RAD_S, LATERAL_DAMPING = 0.7, 1.0
MOST_BANK_RAD = math.radians(25.0)
BANK_RAD_S, ROLL_GAIN = 3.0, 1.0  # roll rate per error of bank, aileron per error of the rate
IDLE = 0.05  # least throttle
# A pass is broken off between these distances to the touchdown point: where deviations are too large, and from the
# decision on where the picture has not been `ok` for too long or protection levels are too large.
WINDOW_M, DECISION_M = 350.0, 200.0
PATIENCE_S = 0.8
COMMITTED_M = 90.0  # to the touchdown point: nearer, breaking off comes too late
WINDOW = (3.0, math.radians(2.0)), (1.5, math.radians(1.0))  # lateral and vertical deviation: at least m, and rad
# The same of the lateral protection level. The vertical one's limit is the hook's clearance of the ramp where the pass
# is committed, and grows with the distance: what exceeds it farther out can still shrink.
LATERAL_LEVEL = (4.0, math.radians(2.0))
GO_AROUND_PITCH_RAD = math.radians(6.0)  # above trim
USABLE = (Status.OK, Status.UNVERIFIED)


class WaveOff(StrEnum):
    """Why a pass was broken off."""

    NOT_SEEN = "guidance not ok at the decision range"
    LOST = "guidance not ok for too long"
    LEVEL = "protection level too large"
    WINDOW = "outside the window"


@dataclass(frozen=True)
class Reckoning:
    """What guidance says of one moment, moved on to now."""

    lateral_m: float
    """Right of the centre line, m."""
    lateral_rate_m_s: float
    """Its rate, m/s."""
    height_m: float
    """Above the glideslope, m."""
    height_rate_m_s: float
    """Rate of the height above the deck, m/s."""
    deck_m_s2: float
    """Upward acceleration of the deck, m/s2."""
    to_go_m: float
    """To the touchdown point, m."""
    closing_m_s: float
    """Closing speed, m/s."""


@dataclass(frozen=True)
class Fix:
    """What an aircraft knows of the deck at the start: it reckons its distance from there while it hears nothing."""

    to_go_m: float
    """To the touchdown point, m."""
    along: tuple[float, float]
    """(2,) unit vector of the landing direction, world."""
    ship_m_s: float
    """Speed of the ship along it, m/s."""


class Autopilot:
    """Flies one pass. `hear` takes guidance, `fly` returns controls, at `rate_hz`.

    Args:
        trim: the aircraft's state, throttle and airspeed at the start, trimmed on the path.
        slope: height per distance of the glideslope.
        ramp_clearance_m: height of the glideslope at the ramp, m.
        rate_hz: of `fly`.
        fix: where the deck is at the start.
        has_limits: whether too large protection levels break the pass off.
    """

    def __init__(
        self,
        trim: AircraftState,
        trim_throttle: float,
        slope: float,
        ramp_clearance_m: float,
        rate_hz: float,
        fix: Fix,
        has_limits: bool = True,
    ) -> None:
        self.wave_off: WaveOff | None = None
        self.flown: Guidance | None = None  # the guidance that is followed
        self._trim, self._throttle, self._slope = trim, trim_throttle, slope
        self._step_s, self._fix, self._has_limits = 1 / rate_hz, fix, has_limits
        self._path_integral = self._speed_integral = 0.0
        self._levels = LATERAL_LEVEL, (ramp_clearance_m, math.atan(ramp_clearance_m / COMMITTED_M))
        self._at_exposure: AircraftState | None = None
        self._ok: Guidance | None = None  # the last `ok` answer of the picture

    def hear(self, guidance: Guidance, at_exposure: AircraftState, is_of_picture: bool) -> None:
        """Take guidance of a moment at which the aircraft was in this state; flagged guidance is not followed.

        Args:
            is_of_picture: of the picture, not of the approach's navigation; only that is landed with.
        """
        usable = guidance.status in USABLE and not guidance.flags and _is_complete(guidance)
        if usable:
            self.flown, self._at_exposure = guidance, at_exposure
        if is_of_picture and usable and guidance.status is Status.OK:
            self._ok = guidance

    def has_picture(self, time_s: float) -> bool:
        """Whether an answer of the picture was `ok` a short time ago."""
        return self._ok is not None and time_s - self._ok.time_s <= PATIENCE_S

    def reckon(self, state: AircraftState, time_s: float) -> Reckoning | None:
        """Where the aircraft is now; None before any guidance."""
        guidance, then = self.flown, self._at_exposure
        if guidance is None or then is None:
            return None
        late = time_s - guidance.time_s
        faster = [now - before for now, before in zip(state.velocity_m_s, then.velocity_m_s, strict=True)]
        heading = then.attitude_rad[2] - _number(guidance.heading_error_rad)  # of the centre line
        to_right = faster[1] * math.cos(heading) - faster[0] * math.sin(heading)
        side, climb = _number(guidance.lateral_rate_m_s), _number(guidance.height_rate_m_s)
        closing = _number(guidance.closing_m_s)
        lateral = _number(guidance.lateral_deviation_m) + (side + to_right / 2) * late
        sinking = climb + closing * self._slope  # relative to the glideslope
        deck = _number(guidance.deck_acceleration_m_s2)
        gained = -faster[2] - deck * late
        height = _number(guidance.vertical_deviation_m) + (sinking + gained / 2) * late
        to_go = _number(guidance.distance_to_touchdown_m) - closing * late
        return Reckoning(lateral, side + to_right, height, climb + gained, deck, to_go, closing)

    def fly(self, state: AircraftState, time_s: float) -> Controls:
        """Controls for the next step."""
        found = self.reckon(state, time_s)
        if self.wave_off is None:
            self.wave_off = self._find_reason(found, state, time_s)
        if self.wave_off is not None:
            return self._go_around(state)
        speed = max(state.airspeed_m_s, 1.0)
        if found is None:  # hold the first path
            return self._control(state, (state.velocity_m_s[2] - self._trim.velocity_m_s[2]) / speed, 0.0)
        wanted = -found.closing_m_s * self._slope + _limit(-HEIGHT_RAD_S * found.height_m, MOST_CLIMB_M_S)
        coming = found.height_rate_m_s - LEAD_S * found.deck_m_s2
        return self._control(state, (wanted - coming) / speed, _bank(found))

    def _find_reason(self, found: Reckoning | None, state: AircraftState, time_s: float) -> WaveOff | None:
        """Why the pass must be broken off now; None: it need not."""
        if found is None:
            return WaveOff.NOT_SEEN if self._reckon_to_go(state, time_s) < DECISION_M else None
        if not COMMITTED_M < found.to_go_m < WINDOW_M:
            return None
        if not in_window(found.lateral_m, found.height_m, found.to_go_m):
            return WaveOff.WINDOW
        return self._find_doubt(found.to_go_m, time_s) if found.to_go_m < DECISION_M else None

    def _reckon_to_go(self, state: AircraftState, time_s: float) -> float:
        """Distance to the touchdown point by dead reckoning with the velocities of aircraft and ship, m."""
        (north, east), start, now = self._fix.along, self._trim.position_m, state.position_m
        flown_m = (now[0] - start[0]) * north + (now[1] - start[1]) * east
        return self._fix.to_go_m - flown_m + self._fix.ship_m_s * time_s

    def _find_doubt(self, to_go_m: float, time_s: float) -> WaveOff | None:
        """Why the picture is not to be landed with; None: it is."""
        ok = self._ok
        if ok is None:
            return WaveOff.NOT_SEEN
        if time_s - ok.time_s > PATIENCE_S:
            return WaveOff.LOST
        level = ok.protection
        if not self._has_limits:
            return None
        is_safe = level is not None and _is_within(self._levels, level.lateral_m, level.vertical_m, to_go_m)
        return None if is_safe else WaveOff.LEVEL

    def _control(self, state: AircraftState, path_error_rad: float, bank_rad: float) -> Controls:
        """Controls for a wanted change of the path angle, upwards positive, and a wanted bank."""
        self._path_integral = _limit(self._path_integral + PATH_RAD_S * path_error_rad * self._step_s, MOST_PITCH_RAD)
        turning = (
            GRAVITY_M_S2 / max(state.airspeed_m_s, 1.0) * (state.load_factor * math.cos(state.attitude_rad[0]) - 1.0)
        )
        change = _limit(PATH_GAIN * path_error_rad - LIFT_S * turning + self._path_integral, MOST_PITCH_RAD)
        slower = self._trim.airspeed_m_s - state.airspeed_m_s
        self._speed_integral = _limit(self._speed_integral + SPEED_RAD_S * SPEED_GAIN * slower * self._step_s, 0.5)
        throttle = self._throttle + SPEED_GAIN * slower + self._speed_integral + THRUST_PER_RAD * change
        return self._attitude(state, self._trim.attitude_rad[1] + change, bank_rad, throttle)

    def _go_around(self, state: AircraftState) -> Controls:
        """Military power, nose up, wings level."""
        return self._attitude(state, self._trim.attitude_rad[1] + GO_AROUND_PITCH_RAD, 0.0, 1.0)

    def _attitude(self, state: AircraftState, pitch_rad: float, bank_rad: float, throttle: float) -> Controls:
        roll, pitch, _ = state.attitude_rad
        p, q, _ = state.rates_rad_s
        elevator = -PITCH_DAMPING * (PITCH_RAD_S * (pitch_rad - pitch) - q)
        aileron = ROLL_GAIN * (BANK_RAD_S * (bank_rad - roll) - p)
        return Controls(_limit(elevator, 1.0), _limit(aileron, 1.0), 0.0, min(max(throttle, IDLE), 1.0))


def in_window(lateral_m: float, height_m: float, to_go_m: float) -> bool:
    """Whether an aircraft so far right of the centre line and above the glideslope may go on."""
    return _is_within(WINDOW, lateral_m, height_m, to_go_m)


def _is_within(
    limits: tuple[tuple[float, float], tuple[float, float]], lateral_m: float, height_m: float, to_go_m: float
) -> bool:
    largest = (max(least, math.tan(angle) * to_go_m) for least, angle in limits)
    return all(abs(off) <= limit for off, limit in zip((lateral_m, height_m), largest, strict=True))


def _bank(found: Reckoning) -> float:
    """Bank that closes the lateral deviation, rad."""
    wanted = -(LATERAL_RAD_S**2) * found.lateral_m - 2 * LATERAL_DAMPING * LATERAL_RAD_S * found.lateral_rate_m_s
    return _limit(math.atan(wanted / GRAVITY_M_S2), MOST_BANK_RAD)


def _is_complete(guidance: Guidance) -> bool:
    parts = (guidance.lateral_deviation_m, guidance.vertical_deviation_m, guidance.distance_to_touchdown_m)
    rates = (guidance.lateral_rate_m_s, guidance.height_rate_m_s, guidance.closing_m_s)
    return None not in parts + rates


def _number(value: Value | None) -> float:
    return 0.0 if value is None else value.value


def _limit(value: float, most: float) -> float:
    return min(max(value, -most), most)
