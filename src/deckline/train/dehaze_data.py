"""Clear views with ranges, and the hazy pairs drawn from them: no two epochs repeat."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform
from torch import Tensor

from deckline.dehaze.network import average_down, image_to_tensor, reduction_factor, tensor_to_image
from deckline.geometry import Camera
from deckline.recording import Source, open_recording
from deckline.train.dehaze_haze import HazeAugmentation, geometry_prior, lay_haze
from deckline.train.views import Views
from deckline.types import Frame

MAX_BAD_DRAWS = 20
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


def clear_view(frame: Frame, long_side_px: int) -> ClearView:
    """What training needs of a frame, averaged down by a whole factor to about `long_side_px`.

    Raises:
        ValueError: a frame without depth, or without a clear image.
    """
    if frame.depth_m is None:
        raise ValueError(f"{frame.file}: no depth; haze is added from depth (record with --depth.range-m inf)")
    clear, hazy = _pictures(frame)
    height, width = clear.shape[:2]
    factor = reduction_factor(height, width, long_side_px)
    height, width = height // factor * factor, width // factor * factor
    # One range of every block: a mean over a ship's edge would lie where nothing is.
    ranges = (frame.depth_m * frame.camera.ray_lengths())[factor // 2 : height : factor, factor // 2 : width : factor]
    ranges = np.nan_to_num(ranges, nan=np.inf)
    clear = _reduced(clear, factor)
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
        None if hazy is None else _reduced(hazy, factor),
        float("inf") if hazy is None or frame.truth is None else float(frame.truth.visibility_m or np.inf),
    )


def _pictures(frame: Frame) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
    """A frame's clear picture, and its hazy one where it was recorded in haze."""
    truth = frame.truth
    visibility_m = None if truth is None else truth.visibility_m
    if truth is not None and truth.clear_rgb is not None:
        return truth.clear_rgb, None if visibility_m is None or np.isinf(visibility_m) else frame.image_rgb
    if visibility_m is not None and np.isinf(visibility_m):
        return frame.image_rgb, None
    raise ValueError(f"{frame.file}: no clear image, and the recording does not say that it was seen in clear air")


def _reduced(image_rgb: NDArray[np.uint8], factor: int) -> NDArray[np.uint8]:
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


class ClearViews(Views[ClearView, Source]):
    """Clear views of several recordings; see `Views`.

    Args:
        recordings: folders that `deckline.recording` can open.
        long_side_px: larger images are averaged down to about this.
        held_out: share of every recording, at its end, that training does not see.
        train: the training part.

    Raises:
        ValueError: no recordings, or no views.
    """

    def __init__(self, recordings: list[Path], long_side_px: int, held_out: float, train: bool = True) -> None:
        self._long_side_px = long_side_px
        super().__init__({path: open_recording(path) for path in recordings}, recordings, held_out, train)

    def load(self, source: Source, index: int) -> ClearView:
        """View `index` of a recording.

        Raises:
            FrameError: it cannot be read; others can.
            ValueError: it lacks what training needs, as all of its recording will.
        """
        return clear_view(source.load(index), self._long_side_px)


def hazy_pair(
    view: ClearView, window: tuple[slice, slice], haze: HazeAugmentation, rng: np.random.Generator, prior: bool = False
) -> tuple[NDArray[np.uint8], NDArray[np.uint8], NDArray[np.float32], NDArray[np.uint8]]:
    """One window of a view, flipped at random.

    Returns:
        Hazy and clear (h, w, 3), transmission (h, w), and the geometry dehazer's picture (h, w, 3), which is the hazy
        one again unless `prior` asks for it and luck gives it.
    """
    hazy, t = lay_haze(view, haze, rng)
    guess = geometry_prior(view, hazy, rng) if prior and rng.random() < haze.prior_share else hazy
    step_v = -1 if rng.random() < haze.flip_vertical else 1
    step_u = -1 if rng.random() < haze.flip_horizontal else 1
    flip = np.s_[::step_v, ::step_u]
    return hazy[window][flip], view.clear_rgb[window][flip], t[window][flip], guess[window][flip]


def random_window(
    size: tuple[int, int], crop: tuple[int, int], scale: tuple[float, float], rng: np.random.Generator
) -> tuple[slice, slice]:
    """Where in an image of `size` (H, W) a crop (h, w) is taken from: `scale` times its size, made to fit."""
    fit = min(size[0] / crop[0], size[1] / crop[1])
    factor = min(rng.uniform(*scale), fit)
    height, width = (min(round(side * factor), limit) for side, limit in zip(crop, size, strict=True))
    top, left = rng.integers(0, size[0] - height + 1), rng.integers(0, size[1] - width + 1)
    return slice(top, top + height), slice(left, left + width)


def training_batch(
    views: ClearViews, batch: int, crop: tuple[int, int], haze: HazeAugmentation, seed: list[int], prior: bool = False
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Hazy and clear (batch, 3, h, w) in 0..1, transmission (batch, 1, h, w), and the picture (batch, 3, h, w) that a
    network with a prior starts from.

    The same for the same seed, so a resumed run sees what it would have seen.
    """
    rng = np.random.default_rng(seed)
    samples = []
    for _ in range(batch):
        view = views.draw(rng)
        window = random_window(view.clear_rgb.shape[:2], crop, haze.crop_scale, rng)
        hazy, clear, t, guess = hazy_pair(view, window, haze, rng, prior)
        planes = [image_to_tensor(hazy), image_to_tensor(clear), np.ascontiguousarray(t)[None, None]]
        planes.append(image_to_tensor(guess))
        sample = torch.cat([torch.from_numpy(plane) for plane in planes], 1)
        if sample.shape[2:] != crop:
            sample = F.interpolate(sample, crop, mode="bilinear", antialias=True, align_corners=False)
        samples.append(sample)
    stacked = torch.cat(samples)
    return stacked[:, :3], stacked[:, 3:6], stacked[:, 6:7], stacked[:, 7:]
