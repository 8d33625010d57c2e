"""Observations of one frame for the joint fit: rays of the lines' points, their noise and depths."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deckline.config import Mode
from deckline.geometry import intersect_plane, rotation_matrix
from deckline.localize.depth import MIN_DOWN, MIN_LINE_POINTS, MIN_SIGMA_PX, sample_depth, select_independent
from deckline.types import NO_POSE, Diagnostic, Diagnostics, Frame, LinePoints, PixelLine, Reason

Array = NDArray[np.float64]
Index = NDArray[np.int64]
ROW_SIGMA_PX = 0.05  # of a point's v, which detectors take as exact; bounds the weight of lines along the image's rows


@dataclass(frozen=True, eq=False)
class Observations:
    """All points of one frame, L lines together.

    Rays are in the camera's optical frame with z = 1, lens distortion removed.
    """

    names: tuple[str, ...]
    """(L,) the lines in order."""
    line: Index
    """(N,) which line a point belongs to."""
    rays: Array
    """(N, 3)."""
    steps: Array
    """(N, 2) change of a ray by 1-sigma of the detector's u."""
    row_step: float
    """Change of a ray by 1-sigma of the point's v."""
    log_depth: Array
    """(N,) logarithm of the depth camera's metres; NaN where there is none."""
    body_m: Array
    """(3,) world."""
    camera_m: Array
    """(3,) world."""
    rotation: Array
    """(3, 3) of world_from_camera."""

    @property
    def world_rays(self) -> Array:
        return self.rays @ self.rotation.T

    def select(self, names: tuple[str, ...]) -> "Observations":
        """The observations of some of the lines, in the order given."""
        index = [np.flatnonzero(self.line == self.names.index(name)) for name in names]
        chosen = np.concatenate([np.zeros(0, dtype=np.int64), *index])
        line = np.repeat(np.arange(len(names)), [len(part) for part in index])
        rest = (self.row_step, self.log_depth[chosen], self.body_m, self.camera_m, self.rotation)
        return Observations(names, line, self.rays[chosen], self.steps[chosen], *rest)


def observe(
    frame: Frame, points: dict[str, LinePoints], pixel_lines: dict[str, PixelLine], mode: Mode
) -> tuple[Observations, Diagnostics]:
    """Points of the lines that have enough of them on the deck, and which lines have not.

    A point above the horizon is on no deck and is left out. A point without a depth stays: it lies on the deck that the
    others measure. Of points that share pixels of the depth image, only one gets a depth.

    Args:
        frame: camera, pose and, unless coarse mode was asked for, the depth image.
        points: the detected points of each line.
        pixel_lines: which of them are inliers.
        mode: as asked for.

    Raises:
        ValueError: a frame without a pose.
    """
    pose = frame.world_from_camera
    if pose is None or frame.world_from_body is None:
        raise ValueError(f"{frame.file}: {NO_POSE.message}")
    rotation = rotation_matrix(pose)
    parts, missing = {}, []
    for side, line in pixel_lines.items():
        part = _line_rays(frame, points[side], line, rotation, mode)
        if len(part[0]) < MIN_LINE_POINTS:
            missing.append(Diagnostic(Reason.NO_POINTS, f"the {side} line has too few points on the deck"))
        else:
            parts[side] = part
    nothing = (np.zeros((0, 3)), np.zeros((0, 2)), np.zeros(0))
    rays, steps, log_depth = (np.concatenate(column) for column in zip(nothing, *parts.values(), strict=True))
    index = np.repeat(np.arange(len(parts)), [len(part[0]) for part in parts.values()])
    rest = (ROW_SIGMA_PX / frame.camera.fy, log_depth, frame.world_from_body.translation, pose.translation, rotation)
    return Observations(tuple(parts), index, rays, steps, *rest), tuple(missing)


def _line_rays(
    frame: Frame, points: LinePoints, line: PixelLine, rotation: Array, mode: Mode
) -> tuple[Array, Array, Array]:
    px, sigma = points.points_px[line.inliers], points.sigma_px[line.inliers]
    step = np.column_stack([np.maximum(sigma, MIN_SIGMA_PX), np.zeros(len(px))])
    rays, after, before = frame.camera.rays(np.concatenate([px, px + step, px - step])).reshape(3, -1, 3)
    steps = (after - before)[:, :2] / 2
    log_depth = np.full(len(px), np.nan)
    if mode != "coarse" and frame.depth_m is not None:
        depth = sample_depth(frame.depth_m, px)
        log_depth = np.log(np.where(select_independent(px, np.isfinite(depth)), depth, np.nan))
    chosen = np.isfinite(rays).all(axis=1) & np.isfinite(steps).all(axis=1) & (rays @ rotation[2] > MIN_DOWN)
    return rays[chosen], steps[chosen], log_depth[chosen]


def initial_height(observations: Observations, deck_z_m: float | None, fine: bool) -> float | None:
    """World z of the deck to start from: the depth camera's median in fine mode, else the reported height.

    None when there is neither, or when the deck would lie above the camera.
    """
    valid = np.isfinite(observations.log_depth)
    if valid.any() and (fine or deck_z_m is None):
        below_m = np.exp(observations.log_depth[valid]) * observations.world_rays[valid, 2]
        z = float(np.median(observations.camera_m[2] + below_m))
    elif deck_z_m is not None:
        z = deck_z_m
    else:
        return None
    return z if z > observations.camera_m[2] else None


def initial_line(observations: Observations, number: int, normal: Array, z_m: float) -> tuple[Array, float] | None:
    """Where an image line lies on the plane z = z_m: a point (3,) in the middle of its points, and its azimuth.

    The weight of a point is the inverse square of its distance.

    Args:
        normal: (3,) world normal of the plane through the camera and the image line.

    Returns:
        None for an image line along the horizon, which is no line on the deck.
    """
    rays = observations.world_rays[observations.line == number]
    ground = intersect_plane(observations.camera_m, rays, z_m)
    weights = rays[:, 2] ** 2
    level = normal * [1.0, 1.0, 0.0]
    if np.linalg.norm(level) < 1e-9 * np.linalg.norm(normal):
        return None
    middle = weights @ ground / weights.sum()
    middle = middle - level * (normal @ (middle - observations.camera_m)) / (level @ level)
    azimuth = float(np.arctan2(-normal[0], normal[1]))
    if (middle - observations.camera_m)[:2] @ [np.cos(azimuth), np.sin(azimuth)] < 0:
        azimuth += np.pi
    return middle, azimuth
