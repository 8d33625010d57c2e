"""Clear views with the range of every pixel: what haze is added to."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from deckline.dehaze.tensors import average_down, image_to_tensor, reduction_factor, tensor_to_image
from deckline.geometry import Camera
from deckline.types import Frame

LOWEST_STEP, LOWEST_PERCENTILE = 4, 95.0  # px, %: waves have no depth of their own
HORIZON_SHARE = 0.2  # of the sky's pixels, counted from the lowest row: what "the horizon's colour" is the mean of


@dataclass(frozen=True, eq=False)
class ClearView:
    """A view without haze and how far everything in it is."""

    clear_rgb: NDArray[np.uint8]  # (H, W, 3)
    range_m: NDArray[np.float16]  # (H, W) ray length; inf for sky
    horizon_rgb: NDArray[np.float32] | None  # (3,) 0..255; None when no sky is in the view
    camera: Camera  # of the picture as it is here
    world_from_camera: RigidTransform | None = None
    deck_z_m: float | None = None  # world z
    sea_z_m: float = 0.0  # world z of the lowest things in view; 0 without a pose
    hazy_rgb: NDArray[np.uint8] | None = None  # (H, W, 3) as it was recorded, where that was in haze
    visibility_m: float = float("inf")  # of that picture, 2 % contrast


def make_clear_view(frame: Frame, long_side_px: int | None = None) -> ClearView:
    """What training needs of a frame, averaged down as `shrink` does."""
    if frame.depth_m is None:
        raise ValueError(f"{frame.file}: no depth; haze is added from depth (record with --depth.range-m inf)")
    truth = frame.truth
    visibility_m = None if truth is None else truth.visibility_m
    clear, hazy = None if truth is None else truth.clear_rgb, None
    if clear is not None and visibility_m is not None and np.isfinite(visibility_m):
        hazy = frame.image_rgb
    elif clear is None and visibility_m == np.inf:
        clear = frame.image_rgb
    if clear is None:
        raise ValueError(f"{frame.file}: no clear image, and its visibility_m is not inf")
    clear, factor = shrink(clear, long_side_px)
    height, width = factor * clear.shape[0], factor * clear.shape[1]
    # One range of every block: a mean over a ship's edge would lie where nothing is.
    ranges = (frame.depth_m * frame.camera.ray_lengths())[factor // 2 : height : factor, factor // 2 : width : factor]
    ranges = np.nan_to_num(ranges, nan=np.inf)
    camera, pose = frame.camera.resized(clear.shape[1], clear.shape[0]), frame.true_world_from_camera
    with np.errstate(over="ignore"):  # beyond 65 km is as good as sky
        half = ranges.astype(np.float16)
    return ClearView(
        clear,
        half,
        horizon_colour(clear, ranges),
        camera,
        pose,
        frame.deck_z_m,
        0.0 if pose is None else lowest_z(ranges, camera, pose),
        None if hazy is None else shrink(hazy, long_side_px)[0],
        float("inf") if hazy is None or visibility_m is None else visibility_m,
    )


def shrink(image_rgb: NDArray[np.uint8], long_side_px: int | None) -> tuple[NDArray[np.uint8], int]:
    """Average a picture down by a whole factor to about `long_side_px`; None leaves its size.

    Returns:
        Means of blocks, without the pixels at the right and below that fill none; and the factor.
    """
    if long_side_px is None:
        return image_rgb, 1
    height, width = image_rgb.shape[:2]
    factor = reduction_factor(height, width, long_side_px)
    if factor == 1:
        return image_rgb, 1
    height, width = (side // factor * factor for side in (height, width))
    return tensor_to_image(average_down(image_to_tensor(image_rgb[:height, :width]), factor)), factor


def lowest_z(range_m: NDArray[np.floating], camera: Camera, world_from_camera: RigidTransform) -> float:
    """World z (down) of the lowest things in a view: the water wherever it is seen. The camera's own when all is sky.

    Args:
        range_m: (H, W) ray lengths; infinite: sky.
    """
    v, u = np.mgrid[0 : camera.height : LOWEST_STEP, 0 : camera.width : LOWEST_STEP]
    rays = camera.rays(np.stack([u.ravel(), v.ravel()], axis=1).astype(np.float64))
    ranges = range_m[v.ravel(), u.ravel()]
    seen = np.isfinite(ranges) & np.isfinite(rays).all(axis=1)
    eye_z = float(world_from_camera.translation[2])
    if not seen.any():
        return eye_z
    down = (rays[seen] @ world_from_camera.rotation.as_matrix()[2]) / np.linalg.norm(rays[seen], axis=1)
    return eye_z + float(np.percentile(ranges[seen] * down, LOWEST_PERCENTILE))


def horizon_colour(clear_rgb: NDArray[np.uint8], range_m: NDArray[np.floating]) -> NDArray[np.float32] | None:
    """Mean colour (3,) of the lowest part of the sky; None where fewer than 1 % of the pixels are sky."""
    rows, columns = np.nonzero(np.isinf(range_m))
    if len(rows) < 0.01 * range_m.size:
        return None
    lowest = rows >= np.quantile(rows, 1 - HORIZON_SHARE)
    return clear_rgb[rows[lowest], columns[lowest]].mean(axis=0, dtype=np.float32)
