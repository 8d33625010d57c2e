"""Observations of one frame for the joint fit: rays of the lines' points, their noise and depths."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from deckline.config import Mode
from deckline.geometry import intersect_plane, rotation_matrix
from deckline.localize.depth import MIN_DOWN, MIN_LINE_POINTS, sample_depth, select_independent, trace_points
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
    """(N,) which line a point belongs to, in ascending order."""
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

    @cached_property
    def world_rays(self) -> Array:
        """(N, 3)."""
        return self.rays @ self.rotation.T

    @cached_property
    def has_depth(self) -> NDArray[np.bool_]:
        """(N,) which points have a depth."""
        return np.isfinite(self.log_depth)

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
    rotation, camera = rotation_matrix(pose), frame.camera
    inliers = [points[side].points_px[line.inliers] for side, line in pixel_lines.items()]
    counts = [len(px) for px in inliers]
    px = np.concatenate(inliers)
    sigma = np.concatenate([points[side].sigma_px[line.inliers] for side, line in pixel_lines.items()])
    rays, steps = trace_points(camera, px, sigma)
    on_deck = np.isfinite(rays).all(axis=1) & np.isfinite(steps).all(axis=1) & (rays @ rotation[2] > MIN_DOWN)
    log_depth = np.full(len(px), np.nan)
    if mode != "coarse" and frame.depth_m is not None:
        depth = sample_depth(frame.depth_m, px)
        parts = zip(inliers, np.split(np.isfinite(depth), np.cumsum(counts)[:-1]), strict=True)
        alone = np.concatenate([select_independent(line_px, has_depth) for line_px, has_depth in parts])
        log_depth = np.log(np.where(alone, depth, np.nan))
    index = np.repeat(np.arange(len(counts)), counts)
    enough = np.bincount(index[on_deck], minlength=len(counts)) >= MIN_LINE_POINTS
    names = tuple(side for side, is_enough in zip(pixel_lines, enough, strict=True) if is_enough)
    chosen, number = on_deck & enough[index], np.cumsum(enough) - 1  # of the lines that have enough points
    rest = (ROW_SIGMA_PX / camera.fy, log_depth[chosen], frame.world_from_body.translation, pose.translation, rotation)
    return Observations(names, number[index[chosen]], rays[chosen], steps[chosen], *rest), tuple(
        Diagnostic(Reason.NO_POINTS, f"the {side} line has too few points on the deck")
        for side in pixel_lines
        if side not in names
    )


def initial_height(observations: Observations, deck_z_m: float | None, fine: bool) -> float | None:
    """World z of the deck to start from: the depth camera's median in fine mode, else the reported height.

    None when there is neither, or when the deck would lie above the camera.
    """
    valid = observations.has_depth
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
