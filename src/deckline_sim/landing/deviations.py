"""Where an aircraft is relative to a centre line of known place: what guidance measures, in plain numbers.

The values are those of `deckline.truth.true_guidance`; a test compares them. Tens of thousands of landings need them
without the cost of frames and lines.
"""

from dataclasses import dataclass
from math import atan2, cos, hypot, pi, sin

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from deckline.config import Approach
from deckline.guide import add_approach
from deckline.types import (
    DepthMode,
    Diagnostics,
    Guidance,
    PoseSource,
    Protection,
    Scale,
    Status,
    TrackState,
    Value,
)
from deckline_sim.flight.viewpoints import PERIODS_S, ShipMotion, middle_m, steady_velocity
from deckline_sim.ship.layout import Layout

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CentreLine:
    """A ship's centre line, and how it moves."""

    points_m: Array
    """(2, 3) ramp and touchdown point in the ship frame, from the point about which the ship turns, m."""
    middle_m: Array
    """(3,) that point in the world at time 0, m."""
    world_from_ship: Array
    """(3, 3) rotation of the ship at rest."""
    velocity_m_s: Array
    """(3,) of the ship under way, world, m/s."""
    amplitudes: tuple[float, float, float]
    """Of roll, rad, pitch, rad, and heave, m; zeros for a ship without motion."""
    phases_rad: tuple[float, float, float]
    """Of roll, pitch and heave at time 0."""

    def swing(self, time_s: float, ahead_rad: float = 0.0) -> tuple[float, float, float]:
        """Roll, rad, pitch, rad, and heave, m, at a time; `ahead_rad`: of every sine's phase."""
        roll, pitch, heave = (
            size * sin(2 * pi * time_s / period + phase + ahead_rad)
            for size, period, phase in zip(self.amplitudes, PERIODS_S, self.phases_rad, strict=True)
        )
        return roll, pitch, heave

    def rise_m_s(self, time_s: float) -> float:
        """Upward speed of the touchdown point, m/s, of a ship that is level at rest; first order in the angles."""
        roll_rate, pitch_rate, heave_rate = (
            2 * pi * value / period for value, period in zip(self.swing(time_s, pi / 2), PERIODS_S, strict=True)
        )
        x, y = float(self.points_m[1, 0]), float(self.points_m[1, 1])
        return heave_rate + pitch_rate * x - roll_rate * y

    def at(self, time_s: float) -> Array:
        """Ramp and touchdown point (2, 3) in the world at a time, m."""
        roll, pitch, heave = self.swing(time_s)
        sr, cr, sp, cp = sin(roll), cos(roll), sin(pitch), cos(pitch)
        swing = np.array([[cp, sp * sr, sp * cr], [0.0, cr, -sr], [-sp, cp * sr, cp * cr]])
        place = self.middle_m + time_s * self.velocity_m_s
        moved: Array = self.points_m @ (self.world_from_ship @ swing).T + place
        moved[:, 2] -= heave
        return moved


def centre_line(layout: Layout, motion: ShipMotion, touchdown_m: float, steady: bool = False) -> CentreLine:
    """The centre line of a ship.

    Args:
        layout: the ship as it lies at time 0.
        motion: of the ship.
        touchdown_m: from the ramp to the touchdown point, m.
        steady: without roll, pitch and heave.
    """
    ramp, far = layout.centre_m
    touchdown = ramp + touchdown_m * (far - ramp) / float(np.hypot(*(far - ramp)))
    middle = middle_m(layout)
    points = np.column_stack([[ramp, touchdown], np.zeros(2)]) - middle
    still = steady or layout.on_land
    return CentreLine(
        points,
        layout.world_from_ship.apply(middle),
        layout.world_from_ship.rotation.as_matrix(),
        steady_velocity(layout, motion),
        (0.0, 0.0, 0.0) if still else (motion.roll_rad, motion.pitch_rad, motion.heave_m),
        motion.phases_rad,
    )


@dataclass(frozen=True, eq=False)
class Deviations:
    """Where an aircraft is relative to a centre line, and how that changes.

    The height's rate has the deck's rise; the other two are relative to the ship under way, without its swing.
    """

    lateral_m: float
    """To the right of the centre line, m."""
    height_m: float
    """Above the touchdown point, m."""
    heading_rad: float
    """Of the nose, to the right of the centre line, rad."""
    distance_m: float
    """To the ramp, along the centre line, m."""
    lateral_rate_m_s: float
    """m/s to the right."""
    height_rate_m_s: float
    """Above the touchdown point, which moves, m/s."""
    closing_m_s: float
    """Towards the ramp, m/s."""


def deviations(
    line: CentreLine, time_s: float, body: RigidTransform, velocity_m_s: Array, approach: Approach
) -> Deviations:
    """Deviations of the aircraft's reference point at a time.

    Args:
        line: where the centre line is.
        time_s: of the pose, s.
        body: pose in the world.
        velocity_m_s: (3,) of the aircraft in the world, m/s.
        approach: the aircraft's reference point.
    """
    ramp, touchdown = line.at(time_s)
    x, y = touchdown[0] - ramp[0], touchdown[1] - ramp[1]
    length = hypot(x, y)
    x, y = x / length, y / length
    matrix = body.as_matrix()
    nose = matrix[:3, 0]
    place = matrix[:3, 3] + matrix[:3, :3] @ np.array(approach.point_m)
    off, moving = place - touchdown, velocity_m_s - line.velocity_m_s
    turn = atan2(nose[1], nose[0]) - atan2(y, x)
    return Deviations(
        float(-y * off[0] + x * off[1]),
        float(-off[2]),
        (turn + pi) % (2 * pi) - pi,
        float(x * (ramp[0] - place[0]) + y * (ramp[1] - place[1])),
        float(-y * moving[0] + x * moving[1]),
        float(-velocity_m_s[2]) - line.rise_m_s(time_s),
        float(x * moving[0] + y * moving[1]),
    )


@dataclass(frozen=True)
class Accuracy:
    """1-sigma of the numbers of `Deviations`, in their units."""

    lateral_m: float
    """m."""
    height_m: float
    """m."""
    heading_rad: float
    """rad."""
    distance_m: float
    """m."""
    lateral_rate_m_s: float
    """m/s."""
    height_rate_m_s: float
    """m/s."""
    closing_m_s: float
    """m/s."""


def stated_guidance(
    time_s: float,
    found: Deviations,
    accuracy: Accuracy,
    status: Status,
    protection: Protection | None,
    approach: Approach,
    diagnostics: Diagnostics = (),
) -> Guidance:
    """Guidance with these deviations, accuracies and levels."""
    values = {name: Value(value, getattr(accuracy, name)) for name, value in vars(found).items()}
    coasting = status in (Status.COASTING, Status.STALE)
    plain = Guidance(
        time_s,
        status,
        DepthMode.COARSE,
        lateral_deviation_m=values["lateral_m"],
        heading_error_rad=values["heading_rad"],
        height_above_deck_m=values["height_m"],
        distance_to_ramp_m=values["distance_m"],
        diagnostics=diagnostics,
        lateral_rate_m_s=values["lateral_rate_m_s"],
        height_rate_m_s=values["height_rate_m_s"],
        closing_m_s=values["closing_m_s"],
        protection=protection,
        track=TrackState.COASTING if coasting else TrackState.TRACKING,
        glideslope_rad=float(np.deg2rad(approach.glideslope_deg)),
        scale_sources=(Scale.WIDTH,),
        pose_source=PoseSource.NAVIGATION,
    )
    return add_approach(plain, approach)
