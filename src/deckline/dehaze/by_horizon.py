"""Dehazing without a pose: the horizon of the picture stands for the pose.

The picture of a sea in haze depends on extinction times the camera's height, so that the fit of `haze_fit` from any
height gives the visibility in heights. Where no horizon is found, or the sea below it does not fade as a sea does, and
as far as the air is clear, another dehazer takes the picture.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.checks import check_image
from deckline.dehaze.base import Dehazer, Restored, mix, ramp, restore
from deckline.dehaze.geometry import GeometryDehazer, downscale_frame
from deckline.dehaze.haze_fit import NotFitted
from deckline.dehaze.horizon import Horizon, NoHorizon, find_horizon
from deckline.dehaze.veil import VeilDehazer
from deckline.geometry import Camera
from deckline.types import Frame

USUAL_HEIGHT_M = 50.0  # of a camera above the water, where it is not known; the limits of `haze_fit` are metres
MAX_SIGMA = 0.02  # of the image's height: a vaguer horizon dehazes nothing
CLEAR_HEIGHTS = (110.0, 160.0)  # visibility: from here on less is removed, and from here on nothing
VISIBILITY_PX = 320  # longer side of the image that the visibility is measured in
USUAL_FOV_RAD = np.radians(60)  # of a camera that is not known


def pose_from_horizon(camera: Camera, horizon: Horizon, height_m: float) -> RigidTransform:
    """World_from_camera (z down, the sea at 0, heading 0) of a camera that sees this horizon from this height.

    The lens' distortion is left out.
    """
    offset = horizon.middle_px - camera.cy + horizon.slope * (camera.cx - (horizon.width_px - 1) / 2)
    down = np.array([-horizon.slope * camera.fx, camera.fy, -offset])
    down /= np.linalg.norm(down)
    ahead = np.array([0.0, 0.0, 1.0]) - down[2] * down
    ahead /= np.linalg.norm(ahead)
    rotation = Rotation.from_matrix(np.stack([ahead, np.cross(down, ahead), down]))
    return RigidTransform.from_components([0.0, 0.0, -height_m], rotation)


def with_horizon_pose(frame: Frame, horizon: Horizon, height_m: float = USUAL_HEIGHT_M) -> Frame:
    """A frame without a pose with one that its horizon allows, above a sea at z = 0."""
    camera = frame.camera
    if not camera.known:
        camera = Camera.from_fov(camera.width, camera.height, USUAL_FOV_RAD)
    pose = pose_from_horizon(camera, horizon, height_m) * frame.body_from_camera.inv()
    return replace(frame, camera=camera, world_from_body=pose, sea_z_m=0.0, deck_z_m=None)


@dataclass(frozen=True)
class VisibilityInHeights:
    """What a picture tells of the visibility, in heights of the camera above the water."""

    heights: float
    sigma: float  # 1-sigma, of the horizon and of the fit; the law itself may be wrong


class HorizonDehazer:
    """Dehazes pictures without a pose by the geometry of the horizon in them; a lens with distortion is not served.

    Args:
        otherwise: takes the pictures that tell no horizon or no haze.
    """

    name = "horizon"

    def __init__(self, otherwise: Dehazer | None = None) -> None:
        self.otherwise = otherwise or VeilDehazer()
        self.geometry = GeometryDehazer()

    def __call__(self, image_rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        check_image(image_rgb)
        height, width = image_rgb.shape[:2]
        return self.restore(Frame("", 0.0, image_rgb, Camera.unknown(width, height))).image_rgb

    def restore(self, frame: Frame) -> Restored:
        horizon = find_horizon_of(frame)
        if isinstance(horizon, NoHorizon) or horizon.middle_sigma_px > MAX_SIGMA * len(frame.image_rgb):
            return restore(self.otherwise, frame)
        solution = self.geometry.solve(with_horizon_pose(frame, horizon))
        if isinstance(solution, NotFitted):
            return restore(self.otherwise, frame)
        heights = solution.haze.visibility_m / USUAL_HEIGHT_M
        clear = ramp(float(np.log(heights)), *np.log(CLEAR_HEIGHTS))
        if clear == 0:
            return Restored(solution.remove(frame.image_rgb))
        other = restore(self.otherwise, frame)
        if clear == 1:
            return other
        return Restored(mix(solution.remove(frame.image_rgb), other.image_rgb, clear))


def find_horizon_of(frame: Frame) -> Horizon | NoHorizon:
    """The horizon of a frame whose lens keeps lines straight."""
    if frame.camera.known and frame.camera.has_distortion:
        return NoHorizon("the lens bends lines")
    return find_horizon(frame.image_rgb)


def measure_visibility(frame: Frame) -> VisibilityInHeights | NoHorizon | NotFitted:
    """The visibility that a frame tells without its pose, or why it tells none.

    Its sigma joins the fit's with how the fit changes where the horizon is one sigma higher and lower.
    """
    horizon = find_horizon_of(frame)
    if isinstance(horizon, NoHorizon):
        return horizon
    small, geometry = downscale_frame(frame, VISIBILITY_PX), GeometryDehazer()
    scale = small.camera.width / frame.camera.width
    logs = []
    for sigmas in (0.0, -1.0, 1.0):
        middle = (horizon.middle_px + sigmas * horizon.middle_sigma_px + 0.5) * scale - 0.5
        moved = replace(horizon, width_px=small.camera.width, middle_px=middle)
        solution = geometry.solve(with_horizon_pose(small, moved))
        if isinstance(solution, NotFitted):
            if sigmas == 0:
                return solution
            continue
        logs.append((np.log(solution.haze.visibility_m), solution.haze.beta_sigma_per_m / solution.haze.beta_per_m))
    best, fit_sigma = logs[0]
    moved_by = max((abs(log - best) for log, _ in logs[1:]), default=1.0)
    heights = float(np.exp(best)) / USUAL_HEIGHT_M
    return VisibilityInHeights(heights, heights * float(np.hypot(moved_by, fit_sigma)))
