"""Covariance of the residuals of one approach.

What errs alike in many frames must not average out: slow errors of the pose, the deck's motion and turn, and points of
frames close in time enter as correlated noise, so that the fit needs no state of each frame for them.
"""

import numpy as np
from numpy.typing import NDArray

from deckline.calibrate.model import DISTURBANCES, Reference, residuals_px
from deckline.calibrate.observations import ApproachView
from deckline.config import RunConfig
from deckline.track.motion import PITCH_PERIOD_S, ROLL_PERIOD_S, oscillate
from deckline.track.states import TURN_RAD_S05
from deckline.trackers import CORRELATION_TIME_S

Array = NDArray[np.float64]
HORIZON_CORRELATION_S = 30.0  # haze and waves raise or lower the horizon of one approach alike; our choice
HORIZON_COMMON = 0.5  # share of the horizon's variance that is so; our choice
STEPS = np.array([1e-5] * 3 + [1e-3] * 4 + [1e-5] * 3)  # of the disturbances, rad and m, for numeric derivatives
GRID = 300  # times at which an oscillation is evaluated
FLOOR_RAD, FLOOR_M = 1e-6, 1e-4  # of sensors stated as exact


def own_covariance(view: ApproachView, point_scale: float, horizon_scale: float) -> Array:
    """Covariance (R, R) of detector and horizon finder alone, px.

    Args:
        view: R = M + 2 H residuals, as `residuals_px`.
        point_scale, horizon_scale: factors on the stated 1-sigmas.
    """
    times = view.times_s[np.concatenate([view.frame, view.horizon_frame, view.horizon_frame])]
    count, searched = len(view.frame), len(view.horizon_frame)
    row_sigma, slope_sigma = view.horizons[:, 1], view.horizons[:, 3] * view.camera.width
    sigma = np.concatenate([view.sigma_px * point_scale, row_sigma * horizon_scale, slope_sigma * horizon_scale])
    kind = np.concatenate([2 * view.side + view.end, np.full(searched, 4), np.full(searched, 5)])
    is_point = np.arange(len(kind)) < count
    correlation_s, common = (
        np.where(is_point, CORRELATION_TIME_S, HORIZON_CORRELATION_S),
        np.where(is_point, 1.0, HORIZON_COMMON),
    )
    apart = np.abs(times[:, None] - times)
    alike = common[:, None] * np.exp(-apart / correlation_s[:, None]) * (kind[:, None] == kind)
    return np.outer(sigma, sigma) * (alike + np.diag(1 - common))


def shared_covariance(view: ApproachView, reference: Reference, state: Array, kernels: Array) -> Array:
    """Covariance (R, R) by errors of the poses and by motion of the deck, px, linearized at a state (13,)."""
    count = len(DISTURBANCES)
    steps = np.repeat((np.eye(count) * STEPS)[:, None], len(view.times_s), axis=1)
    states = np.tile(state, (2 * count, 1))
    upper, lower = np.split(residuals_px(view, reference, states, np.concatenate([steps, -steps])), 2)
    effects = (upper - lower) / (2 * STEPS[:, None])
    return np.asarray(np.einsum("ki,kij,kj->ij", effects, kernels, effects))


def disturbance_kernels(view: ApproachView, config: RunConfig) -> Array:
    """Covariances (10, R, R) of each disturbance between the residuals' frames, in the order of DISTURBANCES."""
    rows = np.concatenate([view.frame, view.horizon_frame, view.horizon_frame])
    times = view.times_s
    apart = np.abs(times[:, None] - times)
    sensors, motion = config.sensors, config.deck.motion
    same = np.eye(len(times))
    drifting = np.exp(-apart / sensors.drift_s)
    drift_rad, white_rad = np.deg2rad(sensors.attitude_drift_deg), max(sensors.attitude_white_rad, FLOOR_RAD)
    angle = drift_rad**2 * drifting + white_rad**2 * same
    place = sensors.position_drift_m**2 * drifting + max(sensors.position_white_m, FLOOR_M) ** 2 * same
    swing = _autocorrelation(apart, PITCH_PERIOD_S), _autocorrelation(apart, ROLL_PERIOD_S)
    since = times - times.min()
    turn = TURN_RAD_S05**2 * np.minimum(since[:, None], since)
    deck = [motion.heave_m**2 * swing[0], motion.pitch_rad**2 * swing[0], motion.roll_rad**2 * swing[1]]
    kernels = np.array([angle, angle, angle, place, place, place, *deck, turn])
    return np.asarray(kernels[:, rows[:, None], rows])


def _autocorrelation(apart_s: Array, period_s: float) -> Array:
    """Of a deck's damped oscillation over times apart."""
    grid = np.linspace(0.0, float(apart_s.max()), GRID)
    values = [oscillate(float(time_s), period_s)[0][0, 0] for time_s in grid]
    return np.interp(apart_s, grid, values)
