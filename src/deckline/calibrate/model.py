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
# Typical sizes (13,) that make the unknowns alike: rad, share, px, s, m, rad, m/s, m, rad, m.
SCALES = np.array([0.01, 0.01, 0.01, 0.01, 10.0, 10.0, 0.01, 1.0, 0.01, 1.0, 1.0, 0.01, 1.0])
STEP_SHARE = 1e-4  # of them, for numeric derivatives
OPTICS = [FOCAL, CX, CY]
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


def camera_of(view: ApproachView, state: Array) -> Camera:
    """The camera that a state (13,) stands for."""
    scale, camera = float(np.exp(state[FOCAL])), view.camera
    return replace(
        camera, fx=camera.fx * scale, fy=camera.fy * scale, cx=camera.cx + state[CX], cy=camera.cy + state[CY]
    )


def mount_of(view: ApproachView, state: Array) -> RigidTransform:
    """body_from_camera with the state's turn."""
    turned = attitude(*state[[ROLL, PITCH, YAW]]) * view.body_from_camera.rotation
    return RigidTransform.from_components(view.body_from_camera.translation, turned)


def residuals_px(view: ApproachView, reference: Reference, states: Array, disturbances: Array | None = None) -> Array:
    """Residuals (K, M + 2 H), px: of points normal to their lines, then of the horizons' rows, and slopes times width.

    Args:
        states: (K, 13).
        disturbances: (K, N, 10) of each frame in the order of DISTURBANCES; None: none. Attitude, rad, about world
            axes; position and heave, m; the deck's slopes, and the turn of the lines, rad, about the reference.
    """
    shape = (len(states), len(view.times_s))
    extra = np.zeros((*shape, len(DISTURBANCES))) if disturbances is None else disturbances
    delays, which = np.unique(states[:, DELAY], return_inverse=True)
    positions, attitudes = view.poses.at((view.times_s + delays[:, None]).ravel())
    world_from_body = attitudes.as_matrix().reshape(len(delays), -1, 3, 3)[which]
    if disturbances is not None:
        turns = Rotation.from_rotvec(disturbances[..., :3].reshape(-1, 3))
        world_from_body = turns.as_matrix().reshape(*shape, 3, 3) @ world_from_body
    centres = world_from_body @ view.body_from_camera.translation
    centres += positions.reshape(len(delays), -1, 3)[which] + extra[..., 3:6]
    mounts = attitude(*states[:, [ROLL, PITCH, YAW]].T) * view.body_from_camera.rotation
    world_from_camera = world_from_body @ mounts.as_matrix()[:, None]
    lines = _line_residuals(view, reference, states, extra, centres, world_from_camera)
    return np.concatenate([lines, _horizon_residuals(view, states, world_from_camera)], axis=1)


def jacobian_px(view: ApproachView, reference: Reference, state: Array) -> Array:
    """Derivatives (R, 13) of the residuals at a state (13,), by central differences."""
    steps = np.diag(STEP_SHARE * SCALES)
    upper, lower = np.split(residuals_px(view, reference, np.concatenate([state + steps, state - steps])), 2)
    return np.asarray((upper - lower).T / (2 * STEP_SHARE * SCALES))


def _line_residuals(
    view: ApproachView, reference: Reference, states: Array, extra: Array, centres: Array, world_from_camera: Array
) -> Array:
    frame = view.frame
    sign = np.where(view.side == 0, -0.5, 0.5)
    middle = reference.azimuth_rad + states[:, [AZIMUTH]]
    azimuth = middle + sign * states[:, [ANGLE]] + extra[:, frame, 9]
    apart = sign * states[:, [SPACING]]
    aside = states[:, [OFFSET]] + apart + states[:, [DRIFT]] * (view.times_s[frame] - reference.time_s)
    down = reference.deck_z_m[frame] + states[:, [HEIGHT]] + extra[:, frame, 6] + extra[:, frame, 8] * apart
    x, y = reference.point_m[0] - np.sin(middle) * aside, reference.point_m[1] + np.cos(middle) * aside
    along = np.stack([np.cos(azimuth), np.sin(azimuth), extra[:, frame, 7]], axis=-1)
    planes = np.cross(along, np.stack([x, y, down], axis=-1) - centres[:, frame])
    normals = np.einsum("kmji,kmj->kmi", world_from_camera[:, frame], planes)
    optics, which = np.unique(states[:, OPTICS], axis=0, return_inverse=True)
    cameras = [camera_of(view, states[np.argmax(which == number)]) for number in range(len(optics))]
    rays = np.array([camera.rays(view.points_px) for camera in cameras])[which]
    scale = np.exp(states[:, [FOCAL]])
    slopes = np.hypot(normals[..., 0] / (view.camera.fx * scale), normals[..., 1] / (view.camera.fy * scale))
    return np.asarray((normals * rays).sum(axis=-1) / slopes)


def _horizon_residuals(view: ApproachView, states: Array, world_from_camera: Array) -> Array:
    frame, camera = view.horizon_frame, view.camera
    scale = np.exp(states[:, [FOCAL]])
    down = world_from_camera[:, frame, 2]  # the world's z axis in the camera
    aside = ((camera.width - 1) / 2 - camera.cx - states[:, [CX]]) / (camera.fx * scale)
    tilt = -(down[..., 2] + down[..., 0] * aside - np.tan(view.dip_rad[frame])) / down[..., 1]
    rows = view.horizons[:, 0] - (camera.cy + states[:, [CY]] + camera.fy * scale * tilt)
    slopes = view.horizons[:, 2] + down[..., 0] / down[..., 1] * (camera.fy / camera.fx)
    return np.concatenate([rows, slopes * camera.width], axis=1)


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
