"""Distances of detected points: by the depth camera (fine) or by the deck plane (coarse)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deckline.config import FrameNoise, Mode
from deckline.geometry import Camera, cross, intersect_plane, rotation_matrix
from deckline.types import NO_POSE, DepthMode, Diagnostic, Frame, Reason

Array = NDArray[np.float64]
WINDOW = np.array([(du, dv) for dv in (-1, 0, 1) for du in (-1, 0, 1)])  # px about a point
WINDOW_PX = 3.0  # its side
MIN_SAMPLES = 6  # of the window's 9: six never lie on one image line, so they determine a plane
# Of inverse depth, as a share of the window's median; a row of deck seen from 3 m height changes by 0.1.
MAX_INVERSE_DEPTH_STEP = 0.25
MIN_LINE_POINTS = 6  # that a line needs a distance for
MIN_DEPTH_SHARE = 0.5  # of a line's inliers with a depth, below which `auto` prefers coarse
MIN_SIGMA_PX = 0.1  # floor of a detected point's 1-sigma
MIN_DOWN = 1e-6  # z of a world ray of unit optical depth that still goes down to the deck


@dataclass(frozen=True, eq=False)
class DeckPoints:
    """Points of one line in the world and their displacements by noise.

    Displacements are those of 1-sigma; K = 9 common sources are attitude about world x, y, z, position
    along x, y, z, deck height, focal length and depth scale.
    """

    index: NDArray[np.int64]
    """(N,) numbers of the detected points."""
    points_m: Array
    """(N, 3) world."""
    pixel_m: Array
    """(N, 3) displacement by the detector's noise."""
    depth_m: Array
    """(N, 3) displacement by the depth camera's noise; zero in coarse mode."""
    common_m: Array
    """(K, N, 3) displacements by the common sources."""
    relative_m: Array
    """(K, N, 3) the same without the rigid motion by errors of the aircraft's own heading and position."""

    def __len__(self) -> int:
        return len(self.points_m)


def sample_depth(depth_m: NDArray[np.float32], points_px: Array) -> Array:
    """Depth at sub-pixel points, (N,) metres, NaN where fewer than 6 of the 3x3 pixels agree on one.

    Inverse depth of a plane is linear in the image, so a plane through the window's inverse depths, without those
    far from their median, gives the depth at the point itself rather than at a pixel's centre.
    """
    height, width = depth_m.shape
    centre = np.rint(points_px).astype(np.int64)
    pixels = centre[:, None, :] + WINDOW
    inside = np.all((pixels >= 0) & (pixels < [width, height]), axis=2)
    clipped = np.clip(pixels, 0, [width - 1, height - 1])
    samples = depth_m[clipped[..., 1], clipped[..., 0]].astype(np.float64)
    valid = inside & np.isfinite(samples) & (samples > 0)
    inverse = 1.0 / np.where(valid, samples, 1.0)
    median = _median(inverse, valid)
    valid &= np.abs(inverse - median[:, None]) <= MAX_INVERSE_DEPTH_STEP * median[:, None]
    enough = valid.sum(axis=1) >= MIN_SAMPLES
    result = np.full(len(points_px), np.nan)
    if enough.any():
        offsets = (pixels - points_px[:, None, :])[enough]
        design = np.concatenate([np.ones((*offsets.shape[:2], 1)), offsets], axis=2) * valid[enough][..., None]
        normal = np.swapaxes(design, 1, 2) @ design
        right = np.swapaxes(design, 1, 2) @ inverse[enough][..., None]
        value = np.linalg.solve(normal, right)[:, 0, 0]
        result[enough] = np.where(value > 0, 1.0 / np.where(value > 0, value, 1.0), np.nan)
    return result


def _median(values: Array, valid: NDArray[np.bool_]) -> Array:
    """Median (N,) of the valid ones of each row (N, M), 0 where none is; numpy's masked one takes ten times as long."""
    ordered, count, row = np.sort(np.where(valid, values, np.inf), axis=1), valid.sum(axis=1), np.arange(len(values))
    upper = np.minimum(count // 2, values.shape[1] - 1)
    middle = (ordered[row, np.maximum(count - 1, 0) // 2] + ordered[row, upper]) / 2
    return np.where(count > 0, middle, 0.0)


def select_independent(points_px: Array, usable: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Mask (N,) of usable points whose windows share no pixel, selected from the end with the larger v, or u, on."""
    selected = np.zeros(len(points_px), dtype=bool)
    if not usable.any():
        return selected
    axis = int(np.ptp(points_px[usable], axis=0).argmax())
    last = np.full(2, np.inf)
    for i in np.argsort(-points_px[:, axis], kind="stable"):
        if usable[i] and np.abs(points_px[i] - last).max() >= WINDOW_PX:
            selected[i], last = True, points_px[i]
    return selected


def count_depths(depth_m: NDArray[np.float32], lines_px: list[Array]) -> list[int]:
    """How many points (N, 2) of each line have a depth; of no lines, none."""
    has_depth = np.isfinite(sample_depth(depth_m, np.concatenate([np.empty((0, 2)), *lines_px])))
    parts = np.split(has_depth, np.cumsum([len(points) for points in lines_px]))
    return [int(part.sum()) for part in parts[: len(lines_px)]]


def choose_mode(frame: Frame, inliers_px: list[Array], mode: Mode) -> tuple[DepthMode, Diagnostic | None]:
    """Fine, coarse or none for one frame, and why when it is none.

    Args:
        frame: its depth, pose and deck height, as far as there are.
        inliers_px: the inliers (N, 2) of each line that was seen.
        mode: `auto` is fine when enough inliers of every line have a depth, else coarse; a mode given by name is never
            replaced by the other one.
    """
    if frame.missing is not None:
        return DepthMode.NONE, frame.missing
    if mode == "coarse":
        if frame.deck_z_m is None:
            return _no_deck_height("coarse mode was asked for and there is")
        return DepthMode.COARSE, None
    if frame.depth_m is None:
        if mode == "fine":
            return _no_depth("the frame has no depth image")
        return _no_deck_height("no depth and") if frame.deck_z_m is None else (DepthMode.COARSE, None)
    counts = count_depths(frame.depth_m, inliers_px)
    shares = [count / max(len(points), 1) for count, points in zip(counts, inliers_px, strict=True)]
    enough = min(counts) >= MIN_LINE_POINTS
    if enough and (min(shares) >= MIN_DEPTH_SHARE or mode == "fine" or frame.deck_z_m is None):
        return DepthMode.FINE, None
    found = f"depth at {', '.join(map(str, counts))} points of the lines, {MIN_LINE_POINTS} each are needed"
    if mode == "fine":
        return _no_depth(found)
    if frame.deck_z_m is None:
        return _no_deck_height(f"{found}, and")
    return DepthMode.COARSE, None


def _no_deck_height(found: str) -> tuple[DepthMode, Diagnostic]:
    return DepthMode.NONE, Diagnostic(Reason.NO_DECK_HEIGHT, f"{found} no deck height: give --deck-z-m")


def _no_depth(why: str) -> tuple[DepthMode, Diagnostic]:
    return DepthMode.NONE, Diagnostic(Reason.NO_DEPTH, f"fine mode was asked for: {why}")


def trace_points(camera: Camera, points_px: Array, sigma_px: Array) -> tuple[Array, Array]:
    """Rays (N, 3) of pixels (N, 2) in the optical frame, z = 1, and their change (N, 2) by 1-sigma (N,) of u."""
    step = np.zeros_like(points_px)
    step[:, 0] = np.maximum(sigma_px, MIN_SIGMA_PX)
    rays, after, before = camera.rays(np.concatenate([points_px, points_px + step, points_px - step])).reshape(3, -1, 3)
    return rays, (after - before)[:, :2] / 2


def locate_points(
    frame: Frame,
    points_px: Array,
    sigma_px: Array,
    index: NDArray[np.int64],
    mode: DepthMode,
    noise: FrameNoise,
    deck_z_m: float | None = None,
) -> DeckPoints:
    """Detected points back-projected into the world; points without a distance are left out.

    p_optical = depth * ray, then body_from_camera, then world_from_body (Li et al. 2024, section 3.2).

    Args:
        frame: camera, pose and, by mode, depth image or deck height.
        points_px: (N, 2).
        sigma_px: (N,) 1-sigma of u.
        index: (N,) numbers of the points, passed on to the result.
        mode: FINE or COARSE.
        noise: 1-sigma of everything else.
        deck_z_m: height of the deck; None: the frame's.

    Raises:
        ValueError: a frame that lacks what the mode needs.
    """
    world_from_camera, depth = frame.world_from_camera, frame.depth_m
    if world_from_camera is None or frame.world_from_body is None:
        raise ValueError(f"{frame.file}: {NO_POSE.message}")
    origin, camera_from_world = world_from_camera.translation, rotation_matrix(world_from_camera).T
    optical, steps = trace_points(frame.camera, points_px, sigma_px)
    rays = optical @ camera_from_world
    if mode is DepthMode.FINE and depth is not None:
        points = origin + sample_depth(depth, points_px)[:, None] * rays
    elif mode is DepthMode.COARSE and (plane_z_m := frame.deck_z_m if deck_z_m is None else deck_z_m) is not None:
        points = intersect_plane(origin, rays, plane_z_m)
    else:
        raise ValueError(f"{frame.file}: mode {mode} needs what the frame does not have")
    usable = np.isfinite(points).all(axis=1) & (rays[:, 2] > MIN_DOWN)
    points, rays, flat, steps = points[usable], rays[usable], optical[usable, :2], steps[usable]
    distance = np.einsum("nk,nk->n", points - origin, rays) / np.einsum("nk,nk->n", rays, rays)
    pixel = _project_on_plane(distance[:, None] * (steps @ camera_from_world[:2]), rays)
    depth_step = distance[:, None] * rays * (noise.depth_fraction if mode is DepthMode.FINE else 0.0)
    by_focal = flat @ camera_from_world[:2] * -noise.focal_fraction
    calibration = distance[:, None] * np.array([by_focal, rays * noise.depth_scale])
    common = _common_displacements(points, rays, calibration, frame.world_from_body.translation, mode, noise)
    return DeckPoints(index[usable], points, pixel, depth_step, *common)


def _common_displacements(
    points: Array, rays: Array, calibration: Array, body: Array, mode: DepthMode, noise: FrameNoise
) -> tuple[Array, Array]:
    """Displacements (9, N, 3) by all that is common to the points, in the world and relative to the aircraft.

    Errors of heading and position move points and aircraft together: relative to the aircraft these are zero.

    Args:
        points: (N, 3) world.
        rays: (N, 3) world, any length.
        calibration: (2, N, 3) displacements by focal length, at constant depth, and depth scale.
        body: (3,) the aircraft.
        mode: whether points lie on the reported deck (coarse) or where the depth camera measures them.
        noise: 1-sigma of everything.
    """
    axes = np.eye(3)
    turns = cross(axes[:, None, :], points - body) * noise.attitude_rad
    shifts = np.broadcast_to(axes[:, None, :] * noise.position_m, (3, *points.shape))
    zero = np.zeros((1, *points.shape))
    pose, deck = np.concatenate([turns, shifts]), zero
    if mode is DepthMode.COARSE:
        pose, calibration = _project_on_plane(pose, rays), _project_on_plane(calibration, rays)
        deck = (rays / rays[:, 2:] * noise.deck_z_m)[None]
    common = np.concatenate([pose, deck, calibration])
    rigid = np.concatenate([zero, zero, turns[2:], shifts, zero, zero, zero])
    return common, common - rigid


def _project_on_plane(displacements: Array, rays: Array) -> Array:
    """Displacements (..., N, 3) moved along the rays (N, 3) back onto the horizontal plane."""
    return displacements - rays * (displacements[..., 2:] / rays[:, 2:])
