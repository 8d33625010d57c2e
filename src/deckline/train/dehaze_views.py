"""Clear views with ranges: what training dehazers starts from."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from deckline.dehaze.network import average_down, image_to_tensor, reduction_factor, tensor_to_image
from deckline.geometry import Camera
from deckline.recording import open_recording
from deckline.train.views import Views
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


def make_clear_view(frame: Frame, long_side_px: int) -> ClearView:
    """What training needs of a frame, averaged down by a whole factor to about `long_side_px`.

    Raises:
        ValueError: a frame without depth, or without a clear image.
    """
    if frame.depth_m is None:
        raise ValueError(f"{frame.file}: no depth; haze is added from depth (record with --depth.range-m inf)")
    clear, hazy = _clear_and_hazy(frame)
    height, width = clear.shape[:2]
    factor = reduction_factor(height, width, long_side_px)
    height, width = height // factor * factor, width // factor * factor
    # One range of every block: a mean over a ship's edge would lie where nothing is.
    ranges = (frame.depth_m * frame.camera.ray_lengths())[factor // 2 : height : factor, factor // 2 : width : factor]
    ranges = np.nan_to_num(ranges, nan=np.inf)
    clear = _average_down(clear, factor)
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
        None if hazy is None else _average_down(hazy, factor),
        float("inf") if hazy is None or frame.truth is None else float(frame.truth.visibility_m or np.inf),
    )


def _clear_and_hazy(frame: Frame) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
    """A frame's clear picture, and its hazy one where it was recorded in haze."""
    truth = frame.truth
    visibility_m = None if truth is None else truth.visibility_m
    if truth is not None and truth.clear_rgb is not None:
        return truth.clear_rgb, None if visibility_m is None or np.isinf(visibility_m) else frame.image_rgb
    if visibility_m is not None and np.isinf(visibility_m):
        return frame.image_rgb, None
    raise ValueError(f"{frame.file}: no clear image, and the recording does not say that it was seen in clear air")


def _average_down(image_rgb: NDArray[np.uint8], factor: int) -> NDArray[np.uint8]:
    """Averaged down; what is left over at the right and the bottom is cut off."""
    height, width = (side // factor * factor for side in image_rgb.shape[:2])
    if factor == 1:
        return image_rgb
    return tensor_to_image(average_down(image_to_tensor(image_rgb[:height, :width]), factor))


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


def open_clear_views(
    recordings: list[Path], long_side_px: int, held_out: float, train: bool = True
) -> Views[ClearView]:
    """Clear views of several recordings; see `Views`.

    Args:
        recordings: folders that `deckline.recording` can open.
        long_side_px: larger images are averaged down to about this.
        held_out: share of every recording, at its end, that training does not see.
        train: the training part.

    Raises:
        ValueError: no recordings, or no views.
    """
    sources = {path: open_recording(path) for path in recordings}
    counts = {path: len(source) for path, source in sources.items()}

    def load(path: Path, index: int) -> ClearView:
        return make_clear_view(sources[path].load(index), long_side_px)

    return Views(counts, recordings, held_out, train, load)
