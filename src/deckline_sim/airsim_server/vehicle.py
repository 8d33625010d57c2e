"""Kinematic flight of the server's one vehicle: a point with first-order dynamics that leans as a multirotor does.

The ground velocity follows the wanted one with the time constant VELOCITY_S, within the limits below; so does the yaw
rate. There are no rotors, no battery and no ground effect. The vehicle compensates wind up to its largest airspeed;
body and accelerometer show it. A vehicle that touches deck or water stops at once and rests there.
Vectors (3,) are in the world, North-East-Down, m, m/s, m/s^2. All values are our choice.
"""

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from deckline_sim.airsim_server.kinematics import (
    BRAKING_M_S2,
    LEAN_S,
    NO_TURN,
    VELOCITY_S,
    YAW_RATE_S,
    Collision,
    Ground,
    Vector,
    VehicleMotion,
    Yaw,
    attitude_of,
    lean_of,
    limit,
    towards,
    wrap,
)
from deckline_sim.airsim_server.sim_clock import SimClock

STEP_S = 0.02  # AirSim commands its vehicles as often
FOLLOW_PER_S = -math.expm1(-STEP_S / VELOCITY_S) / STEP_S  # acceleration for each m/s that the velocity is wrong by
MAX_AIRSPEED_M_S = 80.0
MAX_ACCELERATION_M_S2 = 5.0
MAX_YAW_RATE_RAD_S = math.radians(90.0)
YAW_PER_S = 1.0 / (4.0 * YAW_RATE_S)
DRAG_PER_S = 0.02  # acceleration for each m/s of airspeed: 1.2 deg of lean for 10 m/s
GEAR_M = 0.3  # height of the body's origin above the ground it rests on
LIFT_OFF_M_S, SLIDE_M_S = 0.05, 0.5  # wanted speed up, or along the deck, with which a landed vehicle lifts off
MOST_BEHIND_S = 30.0  # longest flight simulated in one update; without a command the vehicle is at rest by then
FARTHEST_M = 1e6  # a position beyond this is a mistake, and more than the renderer's single precision can place
RATE_STEP_S = 0.01  # half the step of a landed vehicle's velocity


@dataclass(eq=False)
class VehicleCommand:
    """A flight command: the velocity it demands, and when it is done."""

    steer: Callable[["Vehicle"], Vector]
    is_done: Callable[["Vehicle"], bool] = lambda body: False
    yaw: Yaw = NO_TURN
    timeout_s: float = math.inf
    timed: bool = False  # lasts as long as its timeout, and has then succeeded
    lands: bool = False  # done when it touches deck or water
    end_s: float = math.inf  # simulated time at which it times out
    result: bool | None = None  # None while it runs


class Vehicle:
    """The vehicle; each public method first simulates it up to the clock's time. Its public methods are thread-safe.

    Args:
        start: world_from_body.
        ground: what lies below a position at a time.
        ship_pose: world_from_ship at a time.
    """

    def __init__(
        self,
        start: RigidTransform,
        clock: SimClock,
        ground: Callable[[Vector, float], Ground],
        ship_pose: Callable[[float], RigidTransform],
    ) -> None:
        self._clock, self._ground, self._ship_pose = clock, ground, ship_pose
        self._lock = threading.Lock()
        self._start = start
        self._frozen = True  # stays exactly as put until it flies
        self.reset()

    def reset(self) -> None:
        """To the start, without wind or command."""
        with self._lock:
            self.wind = np.zeros(3)
            self._command: VehicleCommand | None = None
            self._collision: Collision | None = None
            self._place(self._start)

    def place(self, pose: RigidTransform) -> None:
        """Set world_from_body, held exactly until the next command; a running command is cancelled."""
        with self._lock:
            self._finish(False)
            self._place(pose)
            if self.ground.height_m <= 0.0:
                self._collide(self.ground.name, np.array([0.0, 0.0, -1.0]))

    def start(self, make: Callable[["Vehicle"], VehicleCommand]) -> VehicleCommand:
        """Start the command that `make` creates from the present state; a running command is cancelled."""
        with self._lock:
            self._advance(self._clock.seconds())
            self._ride()
            self._finish(False)
            if self._frozen:  # from now on it flies
                self._frozen, self._height_m = False, math.inf
            command = make(self)
            if command.timeout_s <= 0.0:
                command.result = command.timed
            else:
                command.end_s = self.time_s + command.timeout_s
                self._command = command
            return command

    def cancel(self) -> None:
        """End the running command as failed; the vehicle brakes and hovers."""
        with self._lock:
            self._advance(self._clock.seconds())
            self._finish(False)

    def set_wind(self, wind: Vector) -> None:
        """Set the air's velocity (3,), world, m/s."""
        with self._lock:
            self._advance(self._clock.seconds())
            self.wind = wind

    def update(self) -> None:
        """Simulate up to now."""
        with self._lock:
            self._advance(self._clock.seconds())

    def read(self) -> VehicleMotion:
        """The motion now."""
        with self._lock:
            time_s = self._clock.seconds()
            self._advance(time_s)
            return self._motion(time_s)

    def take_collision(self) -> Collision | None:
        """The last contact since the previous call."""
        with self._lock:
            self._advance(self._clock.seconds())
            last, self._collision = self._collision, None
            return last

    @property
    def landed(self) -> bool:
        return self._rest is not None

    def _place(self, pose: RigidTransform) -> None:
        self.time_s = self._clock.seconds()
        self.position: Vector = np.array(pose.translation)
        self.velocity, self._acceleration = np.zeros(3), np.zeros(3)
        self._turn_to(pose.rotation)
        self._put, self._frozen = pose, True
        self._rest: RigidTransform | None = None  # ship_from_body, or world_from_body on water, while landed
        self._hold: Vector = self.position
        self.ground = self._ground(self.position, self.time_s)
        self._height_m = self.ground.height_m  # a step ago

    def _turn_to(self, attitude: Rotation) -> None:
        """Heading and lean of an attitude, at rest."""
        nose = attitude.apply([1.0, 0.0, 0.0])
        self.yaw, self.yaw_rate = math.atan2(nose[1], nose[0]), 0.0
        self._lean = lean_of(attitude)
        self._before = (self.yaw, self._lean)  # a step ago

    def _finish(self, result: bool) -> None:
        """End the command; the vehicle holds the place where braking brings it."""
        if self._command is not None:
            self._command.result, self._command = result, None
        speed = float(np.linalg.norm(self.velocity))
        self._hold = self.position + self.velocity * (VELOCITY_S + speed / (2.0 * BRAKING_M_S2))

    def _advance(self, time_s: float) -> None:
        if time_s > self.time_s + MOST_BEHIND_S:
            self.time_s = time_s - MOST_BEHIND_S
        if self._frozen or (self._rest is not None and self._command is None):
            self.time_s = max(self.time_s, time_s)
        while self.time_s + STEP_S <= time_s:
            self.time_s += STEP_S
            self._step()

    def _step(self) -> None:
        command = self._command
        self._ride()
        wanted = towards(self._hold - self.position, MAX_AIRSPEED_M_S) if command is None else command.steer(self)
        if self._rest is not None and not self._lift_off(wanted):
            if command is not None:
                self._check_command(command, down=bool(wanted[2] > LIFT_OFF_M_S))
            return
        self._fly(wanted, NO_TURN if command is None else command.yaw)
        self._touch()
        if command is not None and self._command is command:
            self._check_command(command)

    def _fly(self, wanted: Vector, yaw: Yaw) -> None:
        air = limit(wanted - self.wind, MAX_AIRSPEED_M_S)
        follow = (air + self.wind - self.velocity) * FOLLOW_PER_S
        self._acceleration = limit(follow, MAX_ACCELERATION_M_S2)
        self._before = (self.yaw, self._lean)
        self.position = self.position + self.velocity * STEP_S + self._acceleration * (STEP_S**2 / 2)
        self.velocity = self.velocity + self._acceleration * STEP_S
        thrust = self._acceleration + DRAG_PER_S * (self.velocity - self.wind)
        self._lean = self._lean - (thrust[:2] - self._lean) * math.expm1(-STEP_S / LEAN_S)
        rate = max(-MAX_YAW_RATE_RAD_S, min(MAX_YAW_RATE_RAD_S, self._wanted_yaw_rate(yaw, wanted)))
        self.yaw_rate -= (rate - self.yaw_rate) * math.expm1(-STEP_S / YAW_RATE_S)
        self.yaw = wrap(self.yaw + self.yaw_rate * STEP_S)

    def _wanted_yaw_rate(self, yaw: Yaw, wanted: Vector) -> float:
        if yaw.is_rate:
            return yaw.value
        course = math.atan2(wanted[1], wanted[0]) if yaw.along else 0.0
        if yaw.along and math.hypot(wanted[0], wanted[1]) < SLIDE_M_S:
            return 0.0  # too slow for a direction
        return YAW_PER_S * wrap(yaw.value + course - self.yaw)

    def _touch(self) -> None:
        """Land, or run into the hull; stay inside the world."""
        before, self.ground = self._height_m, self._ground(self.position, self.time_s)
        self._height_m = self.ground.height_m
        if self._height_m < -GEAR_M - abs(self.velocity[2]) * STEP_S:  # from the side
            self._collide("Carrier", -self.velocity / max(float(np.linalg.norm(self.velocity)), 1e-9))
            self.position = self.position - self.velocity * (2.0 * STEP_S)
        elif np.abs(self.position).max() > FARTHEST_M:
            self.position = np.clip(self.position, -FARTHEST_M, FARTHEST_M)
        elif self._height_m > GEAR_M or self._height_m > before:
            return
        else:
            self._settle()
            return
        self.velocity = np.zeros(3)
        self._finish(False)

    def _settle(self) -> None:
        """Rest upright on what lies below."""
        on_deck = self.ground.name == "Deck"
        base = self._ship_pose(self.time_s) if on_deck else RigidTransform.identity()
        up = base.rotation.apply([0.0, 0.0, self._height_m - GEAR_M])
        nose = base.rotation.inv().apply([math.cos(self.yaw), math.sin(self.yaw), 0.0])
        turn = Rotation.from_euler("z", math.atan2(nose[1], nose[0]))
        place = base.inv().apply(self.position + up)
        self._rest = RigidTransform.from_components(place, turn)
        self._collide(self.ground.name, base.rotation.apply([0.0, 0.0, -1.0]))
        self.ground = self.ground._replace(height_m=GEAR_M)
        self.velocity, self._acceleration = np.zeros(3), np.zeros(3)
        if self._command is not None and self._command.lands:
            self._finish(True)

    def _lift_off(self, wanted: Vector) -> bool:
        """Leave the ground where the wanted velocity leads away from it; whether the vehicle flies."""
        sliding = math.hypot(wanted[0], wanted[1]) > SLIDE_M_S and wanted[2] <= LIFT_OFF_M_S
        if self._command is None or not (sliding or wanted[2] < -LIFT_OFF_M_S):
            return False
        self.velocity = self._resting_motion(self.time_s)[0]
        self._rest, self._height_m = None, GEAR_M
        return True

    def _check_command(self, command: VehicleCommand, down: bool = False) -> None:
        if command.is_done(self):
            self._finish(True)
        elif self.time_s >= command.end_s - 1e-9:
            self._finish(command.timed)
        elif down and not command.timed:
            self._finish(command.lands)  # the way down ends here

    def _collide(self, name: str, normal: Vector) -> None:
        self._collision = Collision(name, self.time_s, self.position, normal)

    def _ride(self) -> None:
        """Move a landed vehicle with the deck."""
        if self._rest is not None:
            pose = self._resting(self.time_s)
            self.position = np.array(pose.translation)
            self._turn_to(pose.rotation)

    def _resting(self, time_s: float) -> RigidTransform:
        """world_from_body of a landed vehicle."""
        rest = RigidTransform.identity() if self._rest is None else self._rest
        return self._ship_pose(time_s) * rest if self.ground.name == "Deck" else rest

    def _resting_motion(self, time_s: float) -> tuple[Vector, Vector, Vector]:
        """Velocity, acceleration and rates of a landed vehicle."""
        first, middle, last = (self._resting(time_s + offset) for offset in (-RATE_STEP_S, 0.0, RATE_STEP_S))
        a, b, c = first.translation, middle.translation, last.translation
        rates = (first.rotation.inv() * last.rotation).as_rotvec() / (2 * RATE_STEP_S)
        return (c - a) / (2 * RATE_STEP_S), (a - 2 * b + c) / RATE_STEP_S**2, rates

    def _motion(self, time_s: float) -> VehicleMotion:
        still = np.zeros(3)
        if self._frozen:
            landed = self._height_m <= GEAR_M
            return VehicleMotion(time_s, self._put, still, still, still, landed, self.ground)
        if self._rest is not None:
            return VehicleMotion(time_s, self._resting(time_s), *self._resting_motion(time_s), True, self.ground)
        attitude = attitude_of(self.yaw, self._lean)
        rates = (attitude_of(*self._before).inv() * attitude).as_rotvec() / STEP_S
        position = self.position + self.velocity * (time_s - self.time_s)
        pose = RigidTransform.from_components(position, attitude * Rotation.from_rotvec(rates * (time_s - self.time_s)))
        return VehicleMotion(time_s, pose, self.velocity, self._acceleration, rates, False, self.ground)
