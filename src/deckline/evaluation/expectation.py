"""What a chain is told of a frame's runway before it looks, with drawn errors."""

import zlib

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.types import Frame, RunwayPrior

AZIMUTH_SIGMA_RAD = np.deg2rad(2.0)  # of what is told
FALSE_RANGE_M = (300.0, 2000.0)  # at which a runway is told of in frames that have none
FALSE_WIDTH_M, FALSE_LENGTH_M = 24.0, 240.0  # of such a runway
FALSE_HEADING_RAD = np.deg2rad(10.0)  # 1-sigma of its direction about the line of sight
FALSE_BELOW_M = 50.0  # of it below the camera, where the frame knows no deck

Array = NDArray[np.float64]


def drawn_expectation(frame: Frame, sigma_m: float, seed: int = 0) -> RunwayPrior | None:
    """The true runway, moved and turned by errors of the sigmas that it states; elsewhere one that is not there.

    In a frame without a runway one is told of at a random place in view. A frame draws the same whatever others do.
    None without truth or pose.

    Args:
        frame: with truth.
        sigma_m: 1-sigma of the place along world x and y; a quarter of it in height.
        seed: of the draws.
    """
    pose = frame.true_world_from_camera
    if frame.truth is None or pose is None:
        return None
    rng = np.random.default_rng([seed, zlib.crc32(frame.file.encode())])
    if frame.truth.left is None or frame.truth.right is None:
        left, right = _false_runway(pose, frame, rng)
    else:
        left, right = (np.stack([line.p0_m, line.p1_m]) for line in (frame.truth.left, frame.truth.right))
    shift = rng.normal(0.0, sigma_m, 3) * [1.0, 1.0, 0.25]
    turn = Rotation.from_euler("z", rng.normal(0.0, AZIMUTH_SIGMA_RAD))
    pivot = (left[0] + right[0]) / 2
    moved = [pivot + turn.apply(line - pivot) + shift for line in (left, right)]
    return RunwayPrior(moved[0], moved[1], sigma_m, AZIMUTH_SIGMA_RAD)


def _false_runway(pose: RigidTransform, frame: Frame, rng: np.random.Generator) -> tuple[Array, Array]:
    """Both lines (2, 3), near end first, of a runway somewhere in the camera's field that leads away from it."""
    u = rng.uniform(0.2, 0.8) * frame.camera.width
    ray = pose.rotation.apply(frame.camera.rays([[u, frame.camera.cy]])[0])
    bearing = np.arctan2(ray[1], ray[0])
    heading = bearing + rng.normal(0.0, FALSE_HEADING_RAD)
    range_m = np.exp(rng.uniform(*np.log(FALSE_RANGE_M)))
    ramp = pose.translation + range_m * np.array([np.cos(bearing), np.sin(bearing), 0.0])
    ramp[2] = pose.translation[2] + FALSE_BELOW_M if frame.deck_z_m is None else frame.deck_z_m
    along, right = np.array([np.cos(heading), np.sin(heading), 0.0]), np.array([-np.sin(heading), np.cos(heading), 0.0])
    line = ramp + np.outer([0.0, FALSE_LENGTH_M], along)
    return line - FALSE_WIDTH_M / 2 * right, line + FALSE_WIDTH_M / 2 * right
