"""Dehazing without a pose: the horizon in the image gives pitch and roll.

The image of a sea in haze depends on extinction times the camera's height, so that the fit of `haze_fit` from any
height gives the visibility in heights of the camera. Another dehazer takes images without a horizon, or whose lower
part does not fade as a sea does; the clearer the air, the more of its result is used.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from deckline.checks import check_image
from deckline.dehaze.base import Dehazer, DehazeResult, linear_step, mix, restore
from deckline.dehaze.by_pose import USUAL_HEIGHT_M, GeometryDehazer, at_usual_height, downscale_frame
from deckline.dehaze.haze_fit import HazeFit, NotFitted
from deckline.dehaze.horizon import Horizon, NoHorizon, find_horizon
from deckline.dehaze.veil import VeilDehazer
from deckline.geometry import Camera
from deckline.types import Frame, Value

MAX_SIGMA_UNKNOWN = 0.02  # of the image's height: with an unknown camera the line must be surer
CLEAR_HEIGHTS = (110.0, 160.0)  # visibility: from here on less is removed, and from here on nothing
ANALYSIS_PX = 640  # longer side of the image that air and objects are estimated in
VISIBILITY_PX = 320  # longer side of the image that the visibility is measured in
USUAL_FOV_RAD = np.radians(60)  # of a camera that is not known


def attitude_from_horizon(camera: Camera, horizon: Horizon) -> Rotation:
    """world_from_camera (z down, heading 0) of a camera that sees this horizon; lens distortion is ignored."""
    offset = horizon.middle_px - camera.cy + horizon.slope * (camera.cx - (horizon.width_px - 1) / 2)
    down = np.array([-horizon.slope * camera.fx, camera.fy, -offset])
    down /= np.linalg.norm(down)
    ahead = np.array([0.0, 0.0, 1.0]) - down[2] * down
    ahead /= np.linalg.norm(ahead)
    return Rotation.from_matrix(np.stack([ahead, np.cross(down, ahead), down]))


def with_horizon_pose(frame: Frame, horizon: Horizon) -> Frame:
    """A frame without a pose with one that its horizon allows, from the usual height above a sea at z = 0."""
    camera = frame.camera
    if not camera.known:
        camera = Camera.from_fov(camera.width, camera.height, USUAL_FOV_RAD)
    return at_usual_height(replace(frame, camera=camera), attitude_from_horizon(camera, horizon))


class HorizonDehazer:
    """Dehazes images without a pose by their horizon, of lenses without distortion.

    Args:
        otherwise: dehazes images without a horizon, or whose haze cannot be fitted.
    """

    name = "horizon"

    def __init__(self, otherwise: Dehazer | None = None) -> None:
        self.otherwise = otherwise or VeilDehazer()
        self.geometry = GeometryDehazer(analysis_px=ANALYSIS_PX)

    def __call__(self, image_rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        check_image(image_rgb)
        return self.restore(Frame("", 0.0, image_rgb)).image_rgb

    def restore(self, frame: Frame) -> DehazeResult:
        horizon = find_horizon_of(frame)
        if isinstance(horizon, NoHorizon):
            return restore(self.otherwise, frame)
        if not frame.camera.known and horizon.middle_sigma_px > MAX_SIGMA_UNKNOWN * len(frame.image_rgb):
            return restore(self.otherwise, frame)
        solution = self.geometry.solve(with_horizon_pose(frame, horizon))
        if isinstance(solution, NotFitted):
            return restore(self.otherwise, frame)
        heights = solution.haze.visibility_m / USUAL_HEIGHT_M
        visibility = visibility_in_heights(frame, horizon, solution.haze)
        clear = linear_step(float(np.log(heights)), *np.log(CLEAR_HEIGHTS))
        if clear == 0:
            return DehazeResult(solution.remove(frame.image_rgb), visibility_heights=visibility)
        other = restore(self.otherwise, frame)
        if clear == 1:
            return replace(other, visibility_heights=visibility)
        return DehazeResult(
            mix(solution.remove(frame.image_rgb), other.image_rgb, clear), visibility_heights=visibility
        )


def find_horizon_of(frame: Frame) -> Horizon | NoHorizon:
    """The horizon of a frame; none where the lens has distortion."""
    if frame.camera.known and frame.camera.has_distortion:
        return NoHorizon("the lens bends lines")
    return find_horizon(frame.image_rgb)


def visibility_in_heights(frame: Frame, horizon: Horizon, haze: HazeFit) -> Value:
    """The visibility in heights of the camera above the water, of a fit to a frame by its horizon.

    Its 1-sigma joins the fit's with how the fit changes where the horizon is one sigma higher and lower.
    """
    small, geometry = downscale_frame(frame, VISIBILITY_PX), GeometryDehazer()
    scale = small.camera.width / frame.camera.width
    changes = []
    for sigma_px in (-horizon.middle_sigma_px, horizon.middle_sigma_px):
        middle = (horizon.middle_px + sigma_px + 0.5) * scale - 0.5
        moved = geometry.solve(with_horizon_pose(small, Horizon(small.camera.width, middle, 0, horizon.slope, 0)))
        if not isinstance(moved, NotFitted):
            changes.append(abs(float(np.log(moved.haze.visibility_m / haze.visibility_m))))
    heights = haze.visibility_m / USUAL_HEIGHT_M
    return Value(heights, heights * float(np.hypot(max(changes, default=1.0), haze.beta_sigma_per_m / haze.beta_per_m)))
