"""How far away detected points are: depth camera (fine) or deck plane (coarse)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deckline.geometry import intersect_plane
from deckline.localize.config import LocalizeConfig, NoiseConfig
from deckline.types import DepthMode, Frame

Array = NDArray[np.float64]
WINDOW = np.array([(du, dv) for dv in (-1, 0, 1) for du in (-1, 0, 1)])  # px about a point
WINDOW_PX = 3.0  # its side
MIN_SAMPLES = 6  # of the window's 9: so many never lie on one image line, so a plane through them is determined
MAX_STEP = 0.25  # of inverse depth against the window's median; a row of deck seen at 3 m height changes by 0.1
NO_POSE = "no pose: give poses.csv"
NO_DECK = "no depth and no deck height: give --deck-z-m"


@dataclass(frozen=True, eq=False)
class DeckPoints:
    """Points of one line in the world, with what noise moves them.

    Displacements are those of one standard deviation; K = 9 common sources are attitude about world x, y, z, position
    along x, y, z, deck height, focal length and depth scale.
    """

    index: NDArray[np.int64]  # (N,) which detected points
    points_m: Array  # (N, 3) world
    pixel_m: Array  # (N, 3) displacement by the detector's noise
    depth_m: Array  # (N, 3) displacement by the depth camera's noise; zero in coarse mode
    common_m: Array  # (K, N, 3)
    relative_m: Array  # (K, N, 3) what is left of it when the aircraft's own wrong motion is taken along

    def __len__(self) -> int:
        return len(self.points_m)

    def take(self, keep: NDArray[np.bool_]) -> "DeckPoints":
        return DeckPoints(
            self.index[keep],
            self.points_m[keep],
            self.pixel_m[keep],
            self.depth_m[keep],
            self.common_m[:, keep],
            self.relative_m[:, keep],
        )


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
    median = _masked_median(inverse, valid)
    valid &= np.abs(inverse - median[:, None]) <= MAX_STEP * median[:, None]
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


def independent(points_px: Array, usable: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which of one line's usable points (N,) to take so that no two of their windows share a pixel, near end first."""
    kept = np.zeros(len(points_px), dtype=bool)
    if not usable.any():
        return kept
    axis = int(np.ptp(points_px[usable], axis=0).argmax())
    last = np.full(2, np.inf)
    for i in np.argsort(-points_px[:, axis], kind="stable"):
        if usable[i] and np.abs(points_px[i] - last).max() >= WINDOW_PX:
            kept[i], last = True, points_px[i]
    return kept


def choose_mode(frame: Frame, inliers_px: list[Array], config: LocalizeConfig) -> tuple[DepthMode, str]:
    """Fine, coarse or none for one frame, and why when it is none.

    Args:
        frame: what the frame has of depth, pose and deck height.
        inliers_px: the inliers (N, 2) of each line that was seen.
        config: mode and thresholds. `auto` takes fine when every line has enough inliers with a depth, and
            coarse when most have none; a mode asked for by name is never replaced by the other.
    """
    if frame.world_from_body is None:
        return DepthMode.NONE, NO_POSE
    if config.mode == "coarse":
        if frame.deck_z_m is None:
            return DepthMode.NONE, "coarse mode was asked for and there is no deck height: give --deck-z-m"
        return DepthMode.COARSE, ""
    if frame.depth_m is None:
        if config.mode == "fine":
            return DepthMode.NONE, "fine mode was asked for and the frame has no depth image"
        return (DepthMode.NONE, NO_DECK) if frame.deck_z_m is None else (DepthMode.COARSE, "")
    counts = [int(np.isfinite(sample_depth(frame.depth_m, points)).sum()) for points in inliers_px]
    shares = [count / max(len(points), 1) for count, points in zip(counts, inliers_px, strict=True)]
    enough = min(counts) >= config.min_points
    if enough and (min(shares) >= config.min_depth_share or config.mode == "fine" or frame.deck_z_m is None):
        return DepthMode.FINE, ""
    found = f"depth at {', '.join(map(str, counts))} points of the lines, {config.min_points} each are needed"
    if config.mode == "fine":
        return DepthMode.NONE, f"fine mode was asked for: {found}"
    if frame.deck_z_m is None:
        return DepthMode.NONE, f"{found}, and no deck height: give --deck-z-m"
    return DepthMode.COARSE, ""


def deck_points(
    frame: Frame, points_px: Array, sigma_px: Array, index: NDArray[np.int64], mode: DepthMode, noise: NoiseConfig
) -> DeckPoints:
    """Detected points back-projected into the world; points without a distance are left out.

    p_optical = depth * ray, then body_from_camera, then world_from_body (SPEC section 4.3).

    Args:
        frame: camera, pose and, by mode, depth image or deck height.
        points_px: (N, 2).
        sigma_px: (N,) 1-sigma of u.
        index: (N,) carried through.
        mode: FINE or COARSE.
        noise: 1-sigma of everything else.

    Raises:
        ValueError: a frame that lacks what the mode needs.
    """
    world_from_camera, depth = frame.world_from_camera, frame.depth_m
    if world_from_camera is None or frame.world_from_body is None:
        raise ValueError(f"{frame.file}: {NO_POSE}")
    origin, turn = world_from_camera.translation, world_from_camera.rotation
    rays = turn.apply(frame.camera.rays(points_px))
    if mode is DepthMode.FINE and depth is not None:
        points = origin + sample_depth(depth, points_px)[:, None] * rays
    elif mode is DepthMode.COARSE and frame.deck_z_m is not None:
        points = intersect_plane(origin, rays, frame.deck_z_m)
    else:
        raise ValueError(f"{frame.file}: mode {mode} needs what the frame does not have")
    keep = np.isfinite(points).all(axis=1)
    # A point on the deck plane has a ray that goes down; one that does not has no place on the plane to move to.
    keep &= rays[:, 2] > 1e-6
    points, rays, px = points[keep], rays[keep], points_px[keep]
    distance = ((points - origin) * rays).sum(axis=1) / (rays**2).sum(axis=1)
    step = np.column_stack([np.maximum(sigma_px[keep], noise.min_pixel), np.zeros(len(px))])
    turned = turn.apply(frame.camera.rays(px + step) - frame.camera.rays(px - step)) / 2
    pixel = _on_plane(distance[:, None] * turned, rays)
    along = distance[:, None] * rays * noise.depth_fraction
    depth_step = along if mode is DepthMode.FINE else np.zeros_like(along)
    body = frame.world_from_body.translation
    flat = frame.camera.rays(px) * [-noise.focal_fraction, -noise.focal_fraction, 0.0]
    calibration = distance[:, None] * np.stack([turn.apply(flat), rays * noise.depth_scale])
    common, relative = _common(points, rays, calibration, body, mode, noise)
    return DeckPoints(index[keep], points, pixel, depth_step, common, relative)


def _common(
    points: Array, rays: Array, calibration: Array, body: Array, mode: DepthMode, noise: NoiseConfig
) -> tuple[Array, Array]:
    """Displacements (9, N, 3) by all that is common to the points, in the world and as the aircraft sees them.

    Args:
        points: (N, 3) world.
        rays: (N, 3) world, any length.
        calibration: (2, N, 3) displacements by focal length, at constant depth, and depth scale.
        body: (3,) the aircraft.
        mode: whether points lie on the reported deck (coarse) or where the depth camera says.
        noise: 1-sigma of everything.
    """
    axes = np.eye(3)
    turns = np.cross(axes[:, None, :], points - body) * noise.attitude_rad
    shifts = np.broadcast_to(axes[:, None, :] * noise.position_m, (3, *points.shape))
    zero = np.zeros((1, *points.shape))
    moved, deck = np.concatenate([turns, shifts]), zero
    if mode is DepthMode.COARSE:
        moved, calibration = _on_plane(moved, rays), _on_plane(calibration, rays)
        deck = (rays / rays[:, 2:] * noise.deck_z_m)[None]
    common = np.concatenate([moved, deck, calibration])
    # A wrong heading and position of the aircraft carry the line along: relative to the aircraft nothing changed.
    carried = np.concatenate([zero, zero, turns[2:], shifts, zero, zero, zero])
    return common, common - carried


def _on_plane(moved: Array, rays: Array) -> Array:
    """Displacements (..., N, 3) continued along the rays (N, 3) back to the horizontal plane they left."""
    return moved - rays * (moved[..., 2:] / rays[:, 2:])


def _masked_median(values: Array, valid: NDArray[np.bool_]) -> Array:
    """Row medians of the valid values, (N,); 0 for a row without any."""
    ordered = np.sort(np.where(valid, values, np.inf), axis=1)
    count = valid.sum(axis=1)
    rows = np.arange(len(values))
    low, high = ordered[rows, np.maximum(count - 1, 0) // 2], ordered[rows, np.minimum(count // 2, values.shape[1] - 1)]
    return np.where(count > 0, (low + np.where(count > 0, high, 0.0)) / 2, 0.0)
