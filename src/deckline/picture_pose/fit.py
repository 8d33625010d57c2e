"""The pose of the camera in the runway's frame from one picture: closed form, then iterated least squares.

Two lines give four numbers: two of their vanishing point (heading and pitch), and the planes through camera and line.
Their angles about the runway's direction give height and lateral deviation in widths once the roll is known, from a
horizon, or as wide as `picture.roll_sigma_deg` states. What scales with what: `docs/video.md`.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from deckline.config import RunConfig
from deckline.geometry import attitude
from deckline.picture_pose.model import (
    Innovation,
    Mount,
    attitude_innovation,
    gain_of,
    horizon_innovation,
    lines_innovation,
    updated_covariance,
)
from deckline.picture_pose.sights import LevelSight, LineSight
from deckline.picture_pose.states import Belief, States, initial_belief
from deckline.types import SIDES, Diagnostic, Reason

Array = NDArray[np.float64]
STEPS = 8  # of the iteration at most; three or four are usual
CONVERGED = 0.02  # 1-sigma; a smaller step ends it
MIN_AHEAD = 0.2  # share of the vanishing point's direction that must point ahead of the body
MAX_HEADING_SIGMA_RAD = float(np.deg2rad(5.0))  # beyond, the vanishing point is not determined
LOWEST, HIGHEST = 0.02, 30.0  # runway widths of height that are believed
MAX_ROLL_RAD = float(np.deg2rad(60.0))  # of the body, against which the picture counts as upside down
MAX_RESIDUAL = 5.0  # 1-sigma of any part of the picture that the fit leaves, or of any prior that it contradicts


def fit_pose(
    time_s: float,
    sights: dict[str, LineSight],
    level: LevelSight,
    mount: Mount,
    shared_sigma: Array,
    config: RunConfig,
) -> Belief | Diagnostic:
    """The most probable pose and its covariance, or why the picture gives none.

    Args:
        sights: its edge lines, both needed.
        level: horizon of the same picture and a sensor's attitude; without both the roll is as likely as
            `picture.roll_sigma_deg` states.
        shared_sigma: (13,) of `States.SHARED`.
        config: what is stated of the runway and the aircraft.
    """
    if set(sights) != set(SIDES):
        return Diagnostic(Reason.NO_VANISHING_POINT, "one line alone gives no pose: both edge lines are needed")
    roll = level.roll_rad
    start = closed_form(sights, mount, roll, config)
    if isinstance(start, Diagnostic):
        return start
    rotation, place = start
    prior = initial_belief(time_s, rotation, place, shared_sigma, config)
    return check_belief(_iterate(prior, sights, level, mount), prior, sights, level, mount)


def closed_form(
    sights: dict[str, LineSight], mount: Mount, roll_rad: float, config: RunConfig
) -> tuple[Array, Array] | Diagnostic:
    """runway_from_body (3, 3) and distance, lateral deviation and height, m, without noise and slopes.

    Args:
        roll_rad: of the aircraft, as far as it is known.
    """
    normals = {side: mount.rotation @ np.cross(*sight.rays) for side, sight in sights.items()}  # body
    rays = {side: sight.rays @ mount.rotation.T for side, sight in sights.items()}
    meeting = np.cross(normals["left"], normals["right"])
    length = float(np.linalg.norm(meeting))
    scale = float(np.linalg.norm(normals["left"]) * np.linalg.norm(normals["right"]))
    if length < 1e-9 * scale:
        return Diagnostic(Reason.NO_VANISHING_POINT, "the lines are parallel in the picture: they show no direction")
    ahead = meeting / length
    ahead = ahead if ahead[0] > 0 else -ahead
    if ahead[0] < MIN_AHEAD:
        return Diagnostic(Reason.NO_VANISHING_POINT, "the lines do not meet ahead: the runway is seen from beside")
    levelled = np.array(Rotation.from_euler("X", roll_rad).as_matrix() @ ahead)
    pitch = float(np.arctan2(levelled[2], levelled[0]))
    heading = -float(np.arctan2(levelled[1], np.hypot(levelled[0], levelled[2])))
    rotation = attitude(roll_rad, pitch, heading).as_matrix()
    per_height = {}  # of each line's place to the right of the aircraft
    for side in SIDES:
        normal, ray = rotation @ normals[side], rays[side] @ rotation.T
        if abs(normal[1]) < 1e-9 * np.linalg.norm(normal):
            return Diagnostic(Reason.NO_VANISHING_POINT, f"the {side} line lies along the horizon")
        if (ray[:, 2] <= 0).any():
            return Diagnostic(Reason.NO_VANISHING_POINT, f"the {side} line lies above the point where both meet")
        per_height[side] = -float(normal[2] / normal[1])
    spread = per_height["right"] - per_height["left"]
    if spread <= 0:
        return Diagnostic(Reason.CROSSED, "the left line lies right of the right line")
    height = config.deck.expected_width_m / spread
    lateral = -height * (per_height["right"] + per_height["left"]) / 2
    nearest = min(float((ray[:, 0] / ray[:, 2]).min()) for ray in (r @ rotation.T for r in rays.values()))
    return rotation, np.array([nearest * height, lateral, height])


def _iterate(prior: Belief, sights: dict[str, LineSight], level: LevelSight, mount: Mount) -> Belief:
    """Iterated Kalman update: Gauss-Newton; the prior's attitude is level flight along the runway."""
    belief = prior
    for _ in range(STEPS):
        innovation = innovations(belief, sights, level, mount)
        offset = prior.mean - belief.mean
        offset[States.ATTITUDE] = -Rotation.from_matrix(belief.rotation).as_rotvec()
        gain = gain_of(prior.covariance, innovation)
        step = offset + gain @ (innovation.residuals - innovation.design @ offset)
        covariance = updated_covariance(prior.covariance, gain, innovation)
        size = np.abs(step) / np.sqrt(np.diag(covariance))
        belief = belief.move(step, covariance)
        if float(size.max()) < CONVERGED:
            break
    return belief


def innovations(belief: Belief, sights: dict[str, LineSight], level: LevelSight, mount: Mount) -> Innovation:
    """Of all that one picture shows."""
    total = lines_innovation(belief, sights, mount)
    if level.horizon is not None:
        total = total + horizon_innovation(belief, level.horizon, mount)
    if level.attitude is not None:
        total = total + attitude_innovation(belief, level.attitude, level.white_rad)
    return total


def check_height(belief: Belief) -> Diagnostic | None:
    """Why nobody flies there; None: it can be. In the deck's plane itself any picture of lines would fit."""
    widths = belief.mean[States.HEIGHT] / belief.width_m
    if np.isfinite(belief.mean).all() and LOWEST <= widths <= HIGHEST:
        return None
    return Diagnostic(Reason.NO_VANISHING_POINT, f"the lines would be those of a runway {widths:.2g} widths below")


def check_belief(
    belief: Belief, prior: Belief, sights: dict[str, LineSight], level: LevelSight, mount: Mount
) -> Belief | Diagnostic:
    """The belief, or why it is none."""
    rotation = Rotation.from_matrix(belief.rotation)
    if contradiction := check_height(belief):
        return contradiction
    if belief.sigma(States.ATTITUDE.start + 2) > MAX_HEADING_SIGMA_RAD:
        return Diagnostic(Reason.NO_VANISHING_POINT, "the lines are too short to show where they meet")
    if abs(rotation.as_euler("ZYX")[2]) > MAX_ROLL_RAD:
        return Diagnostic(Reason.NO_VANISHING_POINT, "the picture is upside down or on its side")
    left = innovations(belief, sights, level, mount)
    sigma = np.sqrt(np.concatenate([left.variance, np.diag(prior.covariance)[States.SHARED]]))
    shifts = (belief.mean - prior.mean)[States.SHARED]
    if (np.abs(np.concatenate([left.residuals, shifts])) > MAX_RESIDUAL * sigma).any():
        return Diagnostic(Reason.ATTITUDE, "lines and horizon of the picture, or the attitude, contradict each other")
    return belief
