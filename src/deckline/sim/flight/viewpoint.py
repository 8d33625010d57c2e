"""Where a camera is at one instant, and how it moves."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from deckline.geometry import Camera, attitude, camera_mount
from deckline.sim.ship.layout import Layout, world_points
from deckline.sim.ship.paint import axes


@dataclass(frozen=True, eq=False)
class Viewpoint:
    """Pose, camera, time and motion of one frame."""

    world_from_body: RigidTransform
    camera: Camera
    time_s: float
    body_from_camera: RigidTransform = field(default_factory=camera_mount)
    velocity_m_s: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))  # (3,) over the water, world
    # (3,) of the camera against the world, about the body's axes
    angular_rate_rad_s: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))

    @property
    def world_from_camera(self) -> RigidTransform:
        return self.world_from_body * self.body_from_camera


def looking(
    position_m: NDArray[np.float64], target_m: NDArray[np.float64], nudge_rad: NDArray[np.float64]
) -> RigidTransform:
    """world_from_body at a position whose nose points at a target, then turned by (roll, pitch, yaw)."""
    delta = target_m - position_m
    yaw, pitch = np.arctan2(delta[1], delta[0]), np.arctan2(-delta[2], np.hypot(delta[0], delta[1]))
    return RigidTransform.from_components(position_m, attitude(nudge_rad[0], pitch + nudge_rad[1], yaw + nudge_rad[2]))


def runway_in_view(view: Viewpoint, layout: Layout) -> float:
    """Part of the two edge lines, measured along the deck, that lies inside the image, 0..1."""
    steps = np.linspace(0.0, 1.0, 12)[:, None]
    points = np.concatenate([line[0] + steps * (line[1] - line[0]) for line in (layout.left_m, layout.right_m)])
    pixels = view.camera.project(view.world_from_camera.inv().apply(world_points(layout, points)))
    with np.errstate(invalid="ignore"):
        inside = np.all((pixels >= 0) & (pixels <= [view.camera.width - 1, view.camera.height - 1]), axis=1)
    return float(inside.mean())


def runway_point(layout: Layout, along_m: float, right_m: float = 0.0, up_m: float = 0.0) -> NDArray[np.float64]:
    """A point (3,) in the world: so far past the ramp along the centre line, to its right, above the deck."""
    along, right, _ = axes(*layout.centre_m)
    return world_points(layout, (layout.centre_m[0] + along_m * along + right_m * right)[None], up_m)[0]
