"""What a camera gives and what a detector finds in it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.checks import check_shapes
from deckline.geometry import Camera, camera_mount
from deckline.types.diagnostics import CAMERA_REMEDY, NO_CAMERA, NO_POSE, Diagnostic, PoseSource

SIDES = ("left", "right")  # line 0 and line 1, seen in the landing direction


class EdgeKind(StrEnum):
    """What an edge line of a runway is."""

    PAINT = "paint"
    """The middle of the painted edge marking."""
    PAVEMENT = "pavement"
    """The edge of the surface, where no stripe is painted."""
    LIGHTS = "lights"
    """The row of edge lights, at night."""


@dataclass(frozen=True, eq=False)
class Segment:
    """A true line: the middle of one runway marking, world frame."""

    p0_m: NDArray[np.float64]
    """(3,) its end at the ramp, world, m."""
    p1_m: NDArray[np.float64]
    """(3,) its far end, world, m."""

    def __post_init__(self) -> None:
        check_shapes(self, p0_m=(3,), p1_m=(3,))


@dataclass(frozen=True, eq=False)
class Truth:
    """What a simulator or a survey knows about a frame. The pipeline never reads it."""

    left: Segment | None = None
    """The left edge line; None with `right` None: the scene has no runway."""
    right: Segment | None = None
    """The right edge line."""
    visibility_m: float | None = None
    """Range at which 2 % of a contrast is left, m; inf: clear air."""
    airlight_rgb: tuple[float, float, float] | None = None
    """Red, green, blue of the airlight, 0..255."""
    clear_rgb: NDArray[np.uint8] | None = None
    """(H, W, 3) RGB, the same view without haze."""
    world_from_body: RigidTransform | None = None
    """The aircraft's true pose, where the frame's is a measured one."""
    world_from_ship: RigidTransform | None = None
    """The ship's pose: x forward, y starboard, z down, origin at the stern end of the deck."""
    conditions: Mapping[str, Any] = field(default_factory=dict)
    """Plain values: air, light and camera of the scene."""
    centre_painted: bool | None = None
    """Whether a line is painted midway between left and right; None: not known."""


@dataclass(frozen=True, eq=False)
class Frame:
    """One instant of an approach."""

    file: str
    """Name of the image, or `<video>#<frame number>`."""
    time_s: float
    """Time of exposure, on the source's clock, s."""
    image_rgb: NDArray[np.uint8]
    """(H, W, 3) RGB."""
    camera: Camera = None  # type: ignore[assignment]
    """Intrinsics of the picture. None becomes `Camera.unknown` of the image's size: lines in pixels, no metres."""
    body_from_camera: RigidTransform = field(default_factory=camera_mount)
    """The camera's mounting: optical frame to body (forward, right, down)."""
    depth_m: NDArray[np.float32] | None = None
    """(H, W) along the optical axis, m; NaN where unknown."""
    world_from_body: RigidTransform | None = None
    """Pose, North-East-Down; None: not known. Needs a known camera."""
    deck_z_m: float | None = None
    """World z (down) of the deck plane as the ship reports it, m; None: not known."""
    sea_z_m: float | None = None
    """World z (down) of the water, m; None: not known."""
    truth: Truth | None = None
    """What a simulator or survey knows; the chain never reads it."""
    level_from_body: Rotation | None = None
    """Roll and pitch of a sensor that knows no position; its heading is not used. For frames without a pose."""
    pose_source: PoseSource = PoseSource.NAVIGATION
    """Where `world_from_body` comes from; of the picture, the world is the runway's frame: x along the landing from the
    ramp, y to the right, z down from the deck."""
    in_widths: bool = False
    """Lengths of the world are runway widths, not metres: a picture's pose without a stated width."""

    def __post_init__(self) -> None:
        size, dtype = self.image_rgb.shape, self.image_rgb.dtype
        if dtype != np.uint8 or len(size) != 3 or size[2] != 3:
            raise ValueError(f"{self.file}: image_rgb must be (H, W, 3) of uint8, got {size} of {dtype}")
        if self.camera is None:
            object.__setattr__(self, "camera", Camera.unknown(size[1], size[0]))
        shape = (self.camera.height, self.camera.width)
        if size[:2] != shape:
            raise ValueError(
                f"{self.file}: the camera is {shape[1]}x{shape[0]} px but the image is {size[1]}x{size[0]} px"
            )
        if self.depth_m is not None and self.depth_m.shape != shape:
            raise ValueError(
                f"{self.file}: depth is {self.depth_m.shape[1]}x{self.depth_m.shape[0]} px "
                f"but the image is {shape[1]}x{shape[0]} px"
            )
        if self.world_from_body is not None and not self.camera.known:
            raise ValueError(f"{self.file}: world_from_body needs a known camera; {CAMERA_REMEDY}")

    @property
    def missing(self) -> Diagnostic | None:
        """What it lacks to place lines in the world; None with camera and pose."""
        if not self.camera.known:
            return NO_CAMERA
        return NO_POSE if self.world_from_body is None else None

    @cached_property
    def world_from_camera(self) -> RigidTransform | None:
        """Pose of the optical frame; None without a pose."""
        return None if self.world_from_body is None else self.world_from_body * self.body_from_camera

    @property
    def true_world_from_body(self) -> RigidTransform | None:
        """The aircraft's true pose in truth's world where truth knows it, else the frame's.

        A pose of the picture is none: its world is the runway's own frame.
        """
        known = None if self.truth is None else self.truth.world_from_body
        if known is None and self.pose_source is PoseSource.PICTURE:
            return None
        return self.world_from_body if known is None else known

    @property
    def true_world_from_camera(self) -> RigidTransform | None:
        return None if self.true_world_from_body is None else self.true_world_from_body * self.body_from_camera


@dataclass(frozen=True, eq=False)
class LinePoints:
    """Detected points on the middle of one runway line, near (large v) or far, in no promised order."""

    points_px: NDArray[np.float64]
    """(N, 2) u, v in the full image, px; N may be 0."""
    confidence: NDArray[np.float64]
    """(N,) of each point, 0..1."""
    sigma_px: NDArray[np.float64]
    """(N,) 1-sigma of u, px."""

    def __post_init__(self) -> None:
        n = len(self.points_px)
        check_shapes(self, points_px=(n, 2), confidence=(n,), sigma_px=(n,))

    def __len__(self) -> int:
        return len(self.points_px)

    @classmethod
    def empty(cls) -> "LinePoints":
        return cls(np.zeros((0, 2)), np.zeros(0), np.zeros(0))


@dataclass(frozen=True, eq=False)
class Detection:
    """Points of the lines in one image. A line that was not seen has no points."""

    left: LinePoints
    """Points of the left edge line."""
    right: LinePoints
    """Points of the right edge line."""
    region_px: tuple[float, float, float, float] | None = None
    """u0, v0, u1, v1 of the part that the network saw at full resolution, px."""
    centre: LinePoints = field(default_factory=lambda: LinePoints.empty())
    """Points of the painted centre line; only some networks detect it."""
    edge: EdgeKind | None = None
    """What the edge lines are; None: not known."""
    frames: int = 1
    """How many pictures were averaged for it, this frame's included."""
