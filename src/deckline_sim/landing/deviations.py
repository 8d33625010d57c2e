"""Where an aircraft is relative to a centre line of known place: what guidance measures, in plain numbers.

The values are those of `deckline.truth.true_guidance`; a test compares them. Tens of thousands of landings need them
without the cost of frames and lines.
"""

from dataclasses import dataclass
from math import atan2, hypot, pi

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from deckline.config import Approach
from deckline.guide import add_approach
from deckline.types import (
    DepthMode,
    Guidance,
    PoseSource,
    Protection,
    Scale,
    Status,
    TrackState,
    Value,
)
from deckline_sim.landing.surroundings import Surroundings

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Deviations:
    """Where an aircraft is relative to a centre line, and how that changes; or the 1-sigma of each number.

    The height's rate has the deck's rise; the other two rates are relative to the ship under way, without its swing.
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
    deck_acceleration_m_s2: float
    """Upward, of the touchdown point that moves, m/s2."""


def deviations(
    scene: Surroundings, time_s: float, body: RigidTransform, velocity_m_s: Array, steady: bool = False
) -> Deviations:
    """Deviations of the aircraft's reference point at a time.

    Args:
        scene: the landing's ship, and the aircraft's reference point.
        time_s: of the pose, s.
        body: pose in the world.
        velocity_m_s: (3,) of the aircraft in the world, m/s.
        steady: of the ship without roll, pitch and heave.
    """
    deck = scene.deck
    ramp, touchdown = deck.centre_line(time_s, steady)
    x, y = touchdown[0] - ramp[0], touchdown[1] - ramp[1]
    length = hypot(x, y)
    x, y = x / length, y / length
    matrix = body.as_matrix()
    nose = matrix[:3, 0]
    place = matrix[:3, 3] + matrix[:3, :3] @ np.array(scene.run.approach.point_m)
    off, moving = place - touchdown, velocity_m_s - deck.velocity_m_s
    turn = atan2(nose[1], nose[0]) - atan2(y, x)
    return Deviations(
        float(-y * off[0] + x * off[1]),
        float(-off[2]),
        (turn + pi) % (2 * pi) - pi,
        float(x * (ramp[0] - place[0]) + y * (ramp[1] - place[1])),
        float(-y * moving[0] + x * moving[1]),
        float(-velocity_m_s[2]) - (0.0 if steady else deck.rise_m_s(time_s)),
        float(x * moving[0] + y * moving[1]),
        0.0 if steady else deck.acceleration_m_s2(time_s),
    )


def stated_guidance(
    time_s: float,
    found: Deviations,
    sigma: Deviations,
    status: Status,
    protection: Protection | None,
    approach: Approach,
) -> Guidance:
    """Guidance with these deviations, their 1-sigma and protection levels."""
    values = {name: Value(value, getattr(sigma, name)) for name, value in vars(found).items()}
    coasting = status in (Status.COASTING, Status.STALE)
    plain = Guidance(
        time_s,
        status,
        DepthMode.COARSE,
        lateral_deviation_m=values["lateral_m"],
        heading_error_rad=values["heading_rad"],
        height_above_deck_m=values["height_m"],
        distance_to_ramp_m=values["distance_m"],
        lateral_rate_m_s=values["lateral_rate_m_s"],
        height_rate_m_s=values["height_rate_m_s"],
        deck_acceleration_m_s2=values["deck_acceleration_m_s2"],
        closing_m_s=values["closing_m_s"],
        protection=protection,
        track=TrackState.COASTING if coasting else TrackState.TRACKING,
        glideslope_rad=float(np.deg2rad(approach.glideslope_deg)),
        scale_sources=(Scale.WIDTH,),
        pose_source=PoseSource.NAVIGATION,
    )
    return add_approach(plain, approach)
