"""What sensors measure: a depth camera of the true depth, a navigation unit of the true pose; what calibration errs."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.config import Sensors
from deckline.types import Frame
from deckline_sim.config import DepthConfig, NavigationConfig

HALF_FAR_M = 65504.0  # largest half-precision number, AirSim's "nothing seen"
EDGE_RATIO = 1.05  # of neighbouring depths, from which there is an edge between them
STEP_SHARE = 0.1  # of the time constant between two drawn values of a bias; linear between them
POSITION, ATTITUDE, WHITE, CALIBRATION = 11, 12, 13, 21  # random streams


def measure_depth(depth_m: NDArray[np.float32], config: DepthConfig, rng: np.random.Generator) -> NDArray[np.float32]:
    """Measured depth (H, W), m along the optical axis, NaN where nothing is seen, of the true one."""
    with np.errstate(invalid="ignore"):
        measured = np.where(depth_m <= config.range_m, depth_m, np.float32(np.nan))
    if config.edge_dropout > 0:
        measured[find_edges(depth_m) & (rng.random(depth_m.shape, np.float32) < config.edge_dropout)] = np.nan
    if config.dropout > 0:
        measured[rng.random(depth_m.shape, np.float32) < config.dropout] = np.nan
    if config.noise_m > 0 or config.noise_per_m > 0:
        sigma = np.float32(config.noise_m) + np.float32(config.noise_per_m) * measured**2
        measured = measured + sigma * rng.standard_normal(depth_m.shape, np.float32)
    if config.step_m > 0:
        measured = np.rint(measured / np.float32(config.step_m)) * np.float32(config.step_m)
    if config.half_precision:
        measured = np.minimum(measured, np.float32(HALF_FAR_M)).astype(np.float16).astype(np.float32)
        measured[measured >= HALF_FAR_M] = np.nan
    with np.errstate(invalid="ignore"):
        return np.where(measured > 0, measured, np.float32(np.nan)).astype(np.float32)


def find_edges(depth_m: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Which pixels (H, W) have a neighbour above, below, left or right on another thing or in the sky."""
    near = 1.0 / np.where(np.isnan(depth_m), np.float32(np.inf), depth_m)
    edges = np.zeros(depth_m.shape, dtype=bool)
    for axis in (0, 1):
        a, b = np.moveaxis(near, axis, 0)[:-1], np.moveaxis(near, axis, 0)[1:]
        apart = np.maximum(a, b) > np.float32(EDGE_RATIO) * np.minimum(a, b)
        swapped = np.moveaxis(edges, axis, 0)
        swapped[:-1] |= apart
        swapped[1:] |= apart
    return edges


def navigation_unit(sensors: Sensors) -> NavigationConfig:
    """The simulated unit whose errors are those that the sensors state."""
    return NavigationConfig(
        position_sigma_m=sensors.position_white_m,
        attitude_sigma_deg=sensors.attitude_white_deg,
        position_bias_m=sensors.position_drift_m,
        attitude_bias_deg=sensors.attitude_drift_deg,
        drift_s=sensors.drift_s,
    )


def measure_pose(world_from_body: RigidTransform, time_s: float, config: NavigationConfig, seed: int) -> RigidTransform:
    """The pose as the unit measures it; its error follows from the time and the seed alone.

    Raises:
        ValueError: a negative time.
    """
    if config.exact:
        return world_from_body
    white = np.random.default_rng([seed, WHITE, round(time_s * 1e6)]).standard_normal((2, 3))
    shift = (
        config.position_bias_m * drift(time_s, config.drift_s, [seed, POSITION]) + config.position_sigma_m * white[0]
    )
    turn = config.attitude_bias_deg * drift(time_s, config.drift_s, [seed, ATTITUDE])
    turn = np.deg2rad(turn + config.attitude_sigma_deg * white[1])
    return RigidTransform.from_components(
        world_from_body.translation + shift, world_from_body.rotation * Rotation.from_rotvec(turn)
    )


def drift(time_s: float, constant_s: float, seed: list[int]) -> NDArray[np.float64]:
    """Three independent first-order Gauss-Markov processes (3,) of unit variance at a time from their start on.

    Raises:
        ValueError: a negative time.
    """
    if not 0 <= time_s < np.inf:
        raise ValueError(f"time must not be negative, got {time_s} s")
    step_s = STEP_SHARE * constant_s
    last = int(time_s // step_s) + 1
    decay = np.exp(-STEP_SHARE)
    noise = np.random.default_rng(seed).standard_normal((last + 1, 3))
    noise[1:] *= np.sqrt(1.0 - decay**2)
    values = noise[0]
    for fresh in noise[1:]:
        before, values = values, decay * values + fresh
    share = time_s / step_s - (last - 1)
    mixed = (1 - share) * before + share * values
    return np.asarray(mixed / np.sqrt(1 - 2 * share * (1 - share) * (1 - decay)))  # restores the variance


def miscalibrate(frame: Frame, sensors: Sensors, seed: int) -> Frame:
    """A frame with the errors that a whole approach has in common: reported deck height, focal length, depth scale."""
    deck, focal, scale = np.random.default_rng([seed, CALIBRATION]).standard_normal(3)
    zoom = 1.0 + sensors.focal_fraction * float(focal)
    camera = replace(frame.camera, fx=zoom * frame.camera.fx, fy=zoom * frame.camera.fy)
    depth = None if frame.depth_m is None else frame.depth_m * np.float32(1.0 + sensors.depth_scale * scale)
    deck_z = None if frame.deck_z_m is None else frame.deck_z_m + sensors.deck_z_m * float(deck)
    return replace(frame, camera=camera, depth_m=depth, deck_z_m=deck_z)
