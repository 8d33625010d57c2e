"""The lines' points as the camera sees them: rays, their noise and depths, gathered for the joint fit."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deckline.geometry import intersect_plane
from deckline.localize.config import LocalizeConfig
from deckline.localize.depth import independent, sample_depth
from deckline.types import Frame, LinePoints, PixelLine

Array = NDArray[np.float64]
Index = NDArray[np.int64]
ROW_SIGMA_PX = 0.05  # of a point's v, which detectors take as exact; bounds the weight of lines along the image's rows
LEAST_DOWN = 1e-6  # z of a world ray of unit optical depth that still goes down to the deck


@dataclass(frozen=True, eq=False)
class Sight:
    """All points of one frame, L lines together.

    Rays are in the camera's optical frame with z = 1, lens distortion removed.
    """

    names: tuple[str, ...]  # (L,) the lines in order
    line: Index  # (N,) which line a point belongs to
    rays: Array  # (N, 3)
    steps: Array  # (N, 2) what one standard deviation of the detector moves a ray by
    row_step: float  # what one standard deviation of a point's row moves a ray by
    log_depth: Array  # (N,) of the depth camera, metres; NaN where there is none
    body_m: Array  # (3,) world
    camera_m: Array  # (3,) world
    turn: Array  # (3, 3) world_from_camera rotation

    @property
    def world_rays(self) -> Array:
        return self.rays @ self.turn.T

    def take(self, names: tuple[str, ...]) -> "Sight":
        """The sight of some of the lines, in the order given."""
        parts = [np.flatnonzero(self.line == self.names.index(name)) for name in names]
        keep = np.concatenate([np.zeros(0, dtype=np.int64), *parts])
        line = np.repeat(np.arange(len(names)), [len(part) for part in parts])
        rest = (self.row_step, self.log_depth[keep], self.body_m, self.camera_m, self.turn)
        return Sight(names, line, self.rays[keep], self.steps[keep], *rest)


def sight(
    frame: Frame, points: dict[str, LinePoints], pixel_lines: dict[str, PixelLine], config: LocalizeConfig
) -> tuple[Sight, list[str]]:
    """Points of the lines that have enough of them on the deck, and what is missing, for people.

    A point that looks above the horizon is on no deck and is left out. One without a depth counts: it lies on the deck
    that the others measure. Of points so close together that they would share pixels of the depth image, one has a
    depth.

    Args:
        frame: camera, pose and, unless coarse mode was asked for, the depth image.
        points: the detected points of each line.
        pixel_lines: which of them are inliers.
        config: mode, noise and `min_points`.

    Raises:
        ValueError: a frame without a pose.
    """
    pose = frame.world_from_camera
    if pose is None or frame.world_from_body is None:
        raise ValueError(f"{frame.file}: no pose: give poses.csv")
    turn = pose.rotation.as_matrix()
    parts, missing = {}, []
    for side, line in pixel_lines.items():
        part = _line_rays(frame, points[side], line, turn, config)
        if len(part[0]) < max(config.min_points, 3):
            missing.append(f"the {side} line has too few points on the deck")
        else:
            parts[side] = part
    nothing = (np.zeros((0, 3)), np.zeros((0, 2)), np.zeros(0))
    rays, steps, log_depth = (np.concatenate(column) for column in zip(nothing, *parts.values(), strict=True))
    index = np.repeat(np.arange(len(parts)), [len(part[0]) for part in parts.values()])
    rest = (ROW_SIGMA_PX / frame.camera.fy, log_depth, frame.world_from_body.translation, pose.translation, turn)
    return Sight(tuple(parts), index, rays, steps, *rest), missing


def _line_rays(
    frame: Frame, points: LinePoints, line: PixelLine, turn: Array, config: LocalizeConfig
) -> tuple[Array, Array, Array]:
    px, sigma = points.points_px[line.inliers], points.sigma_px[line.inliers]
    step = np.column_stack([np.maximum(sigma, config.noise.min_pixel), np.zeros(len(px))])
    rays = frame.camera.rays(px)
    steps = (frame.camera.rays(px + step) - frame.camera.rays(px - step))[:, :2] / 2
    log_depth = np.full(len(px), np.nan)
    if config.mode != "coarse" and frame.depth_m is not None:
        depth = sample_depth(frame.depth_m, px)
        log_depth = np.log(np.where(independent(px, np.isfinite(depth)), depth, np.nan))
    keep = np.isfinite(rays).all(axis=1) & np.isfinite(steps).all(axis=1) & (rays @ turn[2] > LEAST_DOWN)
    return rays[keep], steps[keep], log_depth[keep]


def first_height(view: Sight, deck_z_m: float | None, fine: bool) -> float | None:
    """World z of the deck to begin with: the depth camera's median in fine mode, else the reported one; None: neither
    is above the water of the camera, that is, below it in the picture."""
    seen = np.isfinite(view.log_depth)
    if seen.any() and (fine or deck_z_m is None):
        z = float(np.median(view.camera_m[2] + np.exp(view.log_depth[seen]) * view.world_rays[seen, 2]))
    elif deck_z_m is not None:
        z = deck_z_m
    else:
        return None
    return z if z > view.camera_m[2] else None


def first_line(view: Sight, number: int, normal: Array, z_m: float) -> tuple[Array, float] | None:
    """Where an image line lies on the plane z = z_m: a point (3,) in the middle of what was seen, and its azimuth.

    Points count by the inverse square of their distance, as a pixel is worth less far away.

    Args:
        view: the points.
        number: which line.
        normal: (3,) world normal of the plane through the camera and the image line.
        z_m: height of the deck.

    Returns:
        None for an image line along the horizon, which is no line on the deck.
    """
    rays = view.world_rays[view.line == number]
    ground = intersect_plane(view.camera_m, rays, z_m)
    weights = rays[:, 2] ** 2
    level = normal * [1.0, 1.0, 0.0]
    if np.linalg.norm(level) < 1e-9 * np.linalg.norm(normal):
        return None
    middle = weights @ ground / weights.sum()
    middle = middle - level * (normal @ (middle - view.camera_m)) / (level @ level)
    azimuth = float(np.arctan2(-normal[0], normal[1]))
    if (middle - view.camera_m)[:2] @ [np.cos(azimuth), np.sin(azimuth)] < 0:
        azimuth += np.pi
    return middle, azimuth
