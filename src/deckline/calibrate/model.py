"""The state vector of a calibration, its priors, and the residuals of points and horizons.

A point of an edge line lies on the plane through the camera and that line; its residual is the distance from the line
in the picture, px. The line moves sideways with the ship, at a constant speed.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.calibrate.observations import ApproachView
from deckline.config import RunConfig
from deckline.geometry import Camera, attitude, wrap_angle
from deckline.track.states import drift_sigma, width_sigma_m

Array = NDArray[np.float64]
CAMERA_NAMES = ("roll", "pitch", "yaw", "focal length", "cx", "cy", "delay")
RUNWAY_NAMES = ("line offset", "line azimuth", "line drift", "line spacing", "line angle", "deck height")
NAMES = CAMERA_NAMES + RUNWAY_NAMES
ROLL, PITCH, YAW, FOCAL, CX, CY, DELAY, OFFSET, AZIMUTH, DRIFT, SPACING, ANGLE, HEIGHT = range(len(NAMES))
DISTURBANCES = ("attitude x", "attitude y", "attitude z", "x", "y", "z", "heave", "deck pitch", "deck roll", "turn")

# 1-sigma of what is stated of a camera that was never calibrated; our choice, far wider than `config.sensors`.
MOUNT_SIGMA_RAD = float(np.deg2rad(5.0))
FOCAL_SIGMA = 0.1  # share
PRINCIPAL_SIGMA = 0.05  # of the picture's width
DELAY_SIGMA_S = 0.3
WIDE_M, WIDE_RAD = 1000.0, 1.0  # of what nobody states of the lines
UNKNOWN_HEIGHT_SIGMA_M = 20.0  # of a deck whose height nobody states
MIN_HEIGHT_M = 3.0  # of the lowest camera above the trial deck that lines are placed on


@dataclass(frozen=True, eq=False)
class Reference:
    """Where the runway's numbers count from."""

    point_m: Array
    """(3,) world; on the centre line beside the last frame's points, at the deck's stated or assumed height."""
    azimuth_rad: float
    """Direction of landing."""
    time_s: float
    """When the lines are there."""
    deck_z_m: Array
    """(N,) world z of the deck in each frame, as reported or assumed."""


@dataclass(frozen=True, eq=False)
class Prior:
    """Mean and 1-sigma (13,) of the state; radians, metres, seconds, px, share."""

    mean: Array
    sigma: Array


def apply_camera(view: ApproachView, state: Array) -> tuple[Camera, Rotation]:
    """The camera, and body_from_camera, that a state (13,) stands for."""
    scale, camera = float(np.exp(state[FOCAL])), view.camera
    moved = replace(
        camera, fx=camera.fx * scale, fy=camera.fy * scale, cx=camera.cx + state[CX], cy=camera.cy + state[CY]
    )
    return moved, attitude(*state[[ROLL, PITCH, YAW]]) * view.body_from_camera.rotation


def mount_of(view: ApproachView, state: Array) -> RigidTransform:
    """body_from_camera with the state's turn."""
    return RigidTransform.from_components(view.body_from_camera.translation, apply_camera(view, state)[1])


def residuals_px(view: ApproachView, reference: Reference, state: Array, disturbances: Array | None = None) -> Array:
    """Residuals (M + 2 H,), px: points normal to their lines, then the horizons' rows and their slopes over the width.

    Args:
        state: (13,).
        disturbances: (N, 10) of each frame in the order of DISTURBANCES; None: none. Attitude, rad, about world axes;
            position and heave, m; the deck's slopes, and the turn of the lines, rad, about the reference.
    """
    camera, mount = apply_camera(view, state)
    extra = np.zeros((len(view.times_s), len(DISTURBANCES))) if disturbances is None else disturbances
    positions, bodies = view.poses.at(view.times_s + state[DELAY])
    bodies = Rotation.from_rotvec(extra[:, :3]) * bodies
    centres = positions + bodies.apply(view.body_from_camera.translation) + extra[:, 3:6]
    world_from_camera = bodies * mount
    lines = _line_residuals(view, reference, state, extra, camera, centres, world_from_camera)
    return np.concatenate([lines, _horizon_residuals(view, camera, world_from_camera)])


def _line_residuals(
    view: ApproachView,
    reference: Reference,
    state: Array,
    extra: Array,
    camera: Camera,
    centres: Array,
    world_from_camera: Rotation,
) -> Array:
    frame = view.frame
    sign = np.where(view.side == 0, -0.5, 0.5)
    azimuth = reference.azimuth_rad + state[AZIMUTH] + sign * state[ANGLE] + extra[frame, 9]
    middle = reference.azimuth_rad + state[AZIMUTH]
    right = np.array([-np.sin(middle), np.cos(middle), 0.0])
    aside = state[OFFSET] + sign * state[SPACING] + state[DRIFT] * (view.times_s[frame] - reference.time_s)
    points = reference.point_m + aside[:, None] * right
    points[:, 2] = reference.deck_z_m[frame] + state[HEIGHT] + extra[frame, 6] + extra[frame, 8] * sign * state[SPACING]
    along = np.column_stack([np.cos(azimuth), np.sin(azimuth), extra[frame, 7]])
    normals = world_from_camera[frame].inv().apply(np.cross(along, points - centres[frame]))
    rays = camera.rays(view.points_px)
    slopes = np.hypot(normals[:, 0] / camera.fx, normals[:, 1] / camera.fy)
    return np.asarray((normals * rays).sum(axis=1) / slopes)


def _horizon_residuals(view: ApproachView, camera: Camera, world_from_camera: Rotation) -> Array:
    frame = view.horizon_frame
    if not len(frame):
        return np.zeros(0)
    down = world_from_camera[frame].inv().apply([0.0, 0.0, 1.0])
    aside = ((camera.width - 1) / 2 - camera.cx) / camera.fx
    tilt = -(down[:, 2] + down[:, 0] * aside - np.tan(view.dip_rad[frame])) / down[:, 1]
    rows = view.horizons[:, 0] - (camera.cy + camera.fy * tilt)
    slopes = view.horizons[:, 2] + down[:, 0] / down[:, 1] * (camera.fy / camera.fx)
    return np.concatenate([rows, slopes * camera.width])


def start_state(view: ApproachView, config: RunConfig) -> tuple[Reference, Prior, Array]:
    """Reference, priors, and a state (13,) to start the fit from, in closed form.

    The direction of the lines is the one that is normal to all planes through a camera and its line; its slope is the
    start of the mount's pitch. Each plane then gives the line's offset at the deck's height.

    Raises:
        ValueError: not both lines are seen.
    """
    if len(np.unique(view.side)) < 2:
        raise ValueError(
            "calibrate needs both edge lines; the recording shows " + ("one" if len(view.side) else "none")
        )
    positions, bodies = view.poses.at(view.times_s)
    centres = (positions + bodies.apply(view.body_from_camera.translation))[view.frame]
    to_world = bodies * view.body_from_camera.rotation
    rays = to_world[view.frame].apply(view.camera.rays(view.points_px))
    planes = np.cross(rays[0::2], rays[1::2])
    planes /= np.linalg.norm(planes, axis=1, keepdims=True)
    along = np.linalg.eigh(planes.T @ planes)[1][:, 0]
    along *= np.sign(along @ rays.mean(axis=0)) or 1.0
    azimuth = float(np.arctan2(along[1], along[0]))
    pitch = float(np.arcsin(np.clip(along[2], -1.0, 1.0)))
    level, right = (np.array([np.cos(angle), np.sin(angle), 0.0]) for angle in (azimuth, azimuth + np.pi / 2))
    planes = Rotation.from_rotvec(pitch * right).apply(planes)
    slopes = -planes[:, 2] / (planes @ right)  # sideways for each metre down
    side, frame, centre = view.side[0::2], view.frame[0::2], centres[0::2]
    deck_z = _fill_height(view, config, slopes, centre)
    aside = centre @ right + slopes * (deck_z[frame] - centre[:, 2])
    late = centre @ level >= np.median(centre @ level)
    left, righter = (float(np.median(aside[late & (side == number)])) for number in (0, 1))
    place = float((centre @ level).max())
    point = place * level + (left + righter) / 2 * right
    reference = Reference(np.array([point[0], point[1], deck_z[-1]]), azimuth, float(view.times_s[frame[-1]]), deck_z)
    prior = make_prior(view, reference, config)
    state = prior.mean.copy()
    state[PITCH] = pitch
    state[SPACING] = righter - left
    state[OFFSET] = state[AZIMUTH] = 0.0
    return reference, prior, state


def _fill_height(view: ApproachView, config: RunConfig, slopes: Array, centre: Array) -> Array:
    """Reported world z of the deck (N,); where there is none, the height at which the lines have their width."""
    if np.isfinite(view.deck_z_m).any():
        known = np.isfinite(view.deck_z_m)
        return np.interp(np.arange(len(known)), np.flatnonzero(known), view.deck_z_m[known])
    frames, side = view.frame[0::2], view.side[0::2]
    both = [number for number in np.unique(frames) if (frames == number).sum() == 2]
    lowest = float(centre[:, 2].max()) + MIN_HEIGHT_M
    heights = []
    for number in both:
        rows = np.flatnonzero(frames == number)
        step = float(slopes[rows[side[rows] == 1][0]] - slopes[rows[side[rows] == 0][0]])
        heights.append(float(centre[rows[0], 2]) + config.deck.expected_width_m / max(step, 1e-3))
    return np.full(len(view.times_s), max(float(np.median(heights)) if heights else lowest, lowest))


def make_prior(view: ApproachView, reference: Reference, config: RunConfig) -> Prior:
    """Wide priors of the camera; what the configuration states of the runway."""
    mean, sigma = np.zeros(len(NAMES)), np.empty(len(NAMES))
    principal = PRINCIPAL_SIGMA * view.camera.width
    sigma[: DELAY + 1] = [*[MOUNT_SIGMA_RAD] * 3, FOCAL_SIGMA, principal, principal, DELAY_SIGMA_S]
    sigma[[OFFSET, AZIMUTH]] = WIDE_M, WIDE_RAD
    deck, survey = config.deck, config.survey
    if survey.ramp_m is not None:
        mean[AZIMUTH] = float(wrap_angle(np.deg2rad(survey.heading_deg) - reference.azimuth_rad))
        sigma[AZIMUTH] = max(float(np.deg2rad(survey.heading_sigma_deg)), 1e-6)
    if deck.ship_velocity_m_s is not None:
        across = np.array([-np.sin(reference.azimuth_rad), np.cos(reference.azimuth_rad)])
        mean[DRIFT] = float(across @ deck.ship_velocity_m_s)
    sigma[DRIFT] = drift_sigma(config)
    mean[SPACING], sigma[SPACING] = deck.expected_width_m, width_sigma_m(config)
    mean[ANGLE], sigma[ANGLE] = deck.angle_rad, deck.angle_sigma_rad
    is_stated = bool(np.isfinite(view.deck_z_m).any())
    sigma[HEIGHT] = max(config.deck_rest_sigma_m, 1e-3) if is_stated else UNKNOWN_HEIGHT_SIGMA_M
    return Prior(mean, sigma)
