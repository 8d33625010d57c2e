"""Where in the image a runway is to be expected: from a survey or an earlier estimate, and the aircraft's pose."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deckline.detect.looks import Box
from deckline.geometry import Camera
from deckline.types import ExpectedRunway, Frame

Array = NDArray[np.float64]

MARGIN_SIGMAS = 2.0  # around the expected lines; a runway farther off is the search's to find
NEAREST_M = 1.0  # depth at which an expected line that passes the camera is cut
EDGE_POINTS = 9  # along each edge of a box that goes through a lens


@dataclass(frozen=True)
class RunwaySurvey:
    """A runway whose place in the world is known beforehand. Without a ramp there is no survey."""

    ramp_m: tuple[float, float, float] | None = None  # world: middle between both lines' near ends
    heading_deg: float = 0.0  # direction of landing, from world x (north) towards world y (east)
    width_m: float = 24.0  # between the middles of the two lines
    length_m: float = 240.0
    sigma_m: float = 20.0  # 1-sigma of the runway's place as the aircraft sees it, its own position error included
    heading_sigma_deg: float = 2.0  # 1-sigma of its direction as the aircraft sees it, its own heading error included

    def __post_init__(self) -> None:
        values = [*(self.ramp_m or ()), self.heading_deg, self.width_m, self.length_m, self.sigma_m]
        positive = min(self.width_m, self.length_m) > 0 and min(self.sigma_m, self.heading_sigma_deg) >= 0
        if not (np.isfinite([*values, self.heading_sigma_deg]).all() and positive):
            raise ValueError(f"a survey needs finite numbers, width and length above 0, no sigma below: {self}")


def surveyed(survey: RunwaySurvey) -> ExpectedRunway | None:
    """What a survey lets expect; None without a survey."""
    if survey.ramp_m is None:
        return None
    azimuth = np.deg2rad(survey.heading_deg)
    along = survey.length_m * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    aside = survey.width_m / 2 * np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    left, right = (np.array(survey.ramp_m) + side * aside + np.outer([0.0, 1.0], along) for side in (-1, 1))
    return ExpectedRunway(left, right, survey.sigma_m, float(np.deg2rad(survey.heading_sigma_deg)))


def expected_box(frame: Frame, expected: ExpectedRunway, sigmas: float = MARGIN_SIGMAS) -> Box | None:
    """The part of the image in which the expected lines lie, with a margin of so many sigmas.

    None where no part of them is in view, without a pose, and for an expectation that is not finite.
    """
    pose = frame.world_from_camera
    numbers = [*expected.left_m.ravel(), *expected.right_m.ravel(), expected.sigma_m, expected.azimuth_sigma_rad]
    if pose is None or not np.isfinite(numbers).all():
        return None
    turn = sigmas * expected.azimuth_sigma_rad
    camera_from_world = pose.inv()
    cut = [_ahead(camera_from_world.apply(line)) for angle in (-turn, 0.0, turn) for line in _turned(expected, angle)]
    points = np.concatenate(cut)  # a straight line's picture is straight: its ends bound it, and so do its margins'
    if not len(points):
        return None
    margin = sigmas * expected.sigma_m / points[:, 2:]
    flat = points[:, :2] / points[:, 2:]
    return _through_lens((flat - margin).min(axis=0), (flat + margin).max(axis=0), frame.camera)


def _turned(expected: ExpectedRunway, angle_rad: float) -> list[Array]:
    """Both lines (2, 3), turned about the middle of their near ends."""
    pivot = (expected.left_m[0] + expected.right_m[0]) / 2
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return [pivot + (line - pivot) @ turn for line in (expected.left_m, expected.right_m)]


def _ahead(ends_m: Array) -> Array:
    """Of a line's ends (2, 3) in the optical frame, those of the part ahead of the camera; (0, 3) if there is none."""
    depth = ends_m[:, 2]
    if depth.max() <= NEAREST_M:
        return np.zeros((0, 3))
    if depth.min() >= NEAREST_M:
        return ends_m
    share = (NEAREST_M - depth[0]) / (depth[1] - depth[0])
    cut = ends_m[0] + share * (ends_m[1] - ends_m[0])
    return np.stack([cut, ends_m[int(depth.argmax())]])


def _through_lens(low: Array, high: Array, camera: Camera) -> Box | None:
    """A box in normalised image coordinates without distortion -> the box of what of it is in the image.

    It is cut to what the lens reaches first: distortion coefficients bend what is far outside back into the image.
    """
    reach_low, reach_high = _reach(camera)
    low, high = np.maximum(low, reach_low), np.minimum(high, reach_high)
    if not (low < high).all():
        return None
    share = np.linspace(0.0, 1.0, EDGE_POINTS)
    x, y = (low[axis] + share * (high[axis] - low[axis]) for axis in (0, 1))
    grid = np.stack([*np.meshgrid(x, y), np.ones((EDGE_POINTS, EDGE_POINTS))], axis=-1).reshape(-1, 3)
    pixels = camera.project(grid)
    u0, v0 = np.clip(pixels.min(axis=0), -0.5, [camera.width - 1.5, camera.height - 1.5])
    u1, v1 = np.clip(pixels.max(axis=0), [u0 + 1.0, v0 + 1.0], [camera.width - 0.5, camera.height - 0.5])
    return float(u0), float(v0), float(u1), float(v1)


def _reach(camera: Camera) -> tuple[Array, Array]:
    """Smallest and largest x and y, normalised and without distortion, that are in the image."""
    u, v = np.linspace(0.0, camera.width - 1, EDGE_POINTS), np.linspace(0.0, camera.height - 1, EDGE_POINTS)
    pixels = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    rays = camera.rays(pixels)[:, :2]
    return np.nanmin(rays, axis=0), np.nanmax(rays, axis=0)
