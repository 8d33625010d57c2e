"""An aircraft that waits 100 m before the ramp of a runway along x, and lines as a depth camera gives them."""

import numpy as np
from scipy.spatial.transform import RigidTransform

from deckline.geometry import Camera
from deckline.types import DepthMode, Frame, LineVisibility, RunwayEstimate, RunwayLine

CAMERA = Camera(4, 3, 2.0, 2.0, 1.5, 1.0)
OFFSET_M, TURN_RAD, HEIGHT_M = 0.05, 0.002, 0.1  # 1-sigma of one frame's line


def view(time_s: float, aside_m: float = 0.0) -> Frame:
    pose = RigidTransform.from_translation([-100.0, aside_m, -35.0])
    grain = np.random.default_rng(round(time_s * 1e3)).integers(0, 256, (3, 4, 3), np.uint8)
    return Frame(f"{time_s:.2f}.png", time_s, grain, CAMERA, world_from_body=pose)


def seen(rng, z_m=-20.0, spacing_m=15.0, aside_m=0.0, mode=DepthMode.FINE, noise=1.0) -> RunwayEstimate:
    """Both lines 50 m past the ramp, with noise."""
    # An attitude 0.1 degrees wrong is in what localization states, though it does not differ from frame to frame.
    attitude = np.deg2rad(0.1) * np.array([15.0, 0.0, 150.0])
    covariance = np.diag(np.hypot([OFFSET_M, TURN_RAD, HEIGHT_M], attitude)) ** 2
    height, lines = z_m + noise * rng.normal(0, HEIGHT_M), {}
    for side, sign in (("left", -0.5), ("right", 0.5)):
        y = aside_m + sign * spacing_m + noise * rng.normal(0, OFFSET_M)
        point = np.array([50.0, y, height])
        lines[side] = RunwayLine(point, noise * rng.normal(0, TURN_RAD), 4 * covariance, covariance)
    return RunwayEstimate(LineVisibility.BOTH, mode, {}, lines)
