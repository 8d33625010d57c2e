"""Clear views with ranges, and the hazy pairs drawn from them: no two epochs repeat."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

from deckline.dehaze.network_io import averaged_down, image_to_tensor, reduction_factor, tensor_to_image
from deckline.haze import add_haze, beta_from_visibility, transmission
from deckline.recording import FrameError, Source, open_source
from deckline.train.split import split_views
from deckline.types import Frame

MAX_BAD_DRAWS = 20
HORIZON_SHARE = 0.2  # of the sky's pixels, counted from the lowest row: what "the horizon's colour" is the mean of
GREY_LEVELS = (70.0, 245.0)  # airlight of a random colour, 0..255
# Tints of random airlight, multiplied onto grey: bluish (fog in daylight) to warm (dust, low sun).
BLUISH, WARM = np.array([0.86, 0.95, 1.05]), np.array([1.06, 0.97, 0.85])


@dataclass(frozen=True)
class HazeAugmentation:
    """What haze training images get."""

    visibility_m: tuple[float, float] = (250.0, 4000.0)  # 2 % contrast, log-uniform
    clear_share: float = 0.06  # of the images get next to no haze, so that clear images come out untouched
    clear_visibility_m: tuple[float, float] = (20000.0, 200000.0)  # log-uniform
    horizon_share: float = 0.8  # of the airlights are near the sky's colour at the horizon, the others random
    exact_share: float = 0.5  # of those are the horizon's colour itself, as Koschmieder's law has it for one light
    noise_share: float = 0.3  # of the hazy images get sensor noise
    noise_max: float = 2.0  # its largest 1-sigma, grey levels
    crop_scale: tuple[float, float] = (0.75, 1.25)  # size of the window a crop is resized from, relative to the crop
    flip_horizontal: float = 0.5  # probability
    flip_vertical: float = 0.0  # the paper flips with 0.5; aircraft that see a deck from above do not

    def __post_init__(self) -> None:
        for name in ("visibility_m", "clear_visibility_m", "crop_scale"):
            low, high = getattr(self, name)
            if not 0 < low <= high:
                raise ValueError(f"{name} must be 0 < low <= high, got {low} and {high}")
        for name in ("clear_share", "horizon_share", "exact_share", "noise_share", "flip_horizontal", "flip_vertical"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} must lie in 0..1, got {getattr(self, name)}")


@dataclass(frozen=True, eq=False)
class ClearView:
    """A view without haze and how far everything in it is."""

    clear_rgb: NDArray[np.uint8]  # (H, W, 3)
    range_m: NDArray[np.float16]  # (H, W) ray length; inf for sky
    horizon_rgb: NDArray[np.float32] | None  # (3,) 0..255; None when no sky is in the view


def clear_view(frame: Frame, long_side_px: int) -> ClearView:
    """What training needs of a frame, averaged down by a whole factor to about `long_side_px`.

    Raises:
        ValueError: a frame without depth, or without a clear image.
    """
    if frame.depth_m is None:
        raise ValueError(f"{frame.file}: no depth; haze is added from depth (record with --depth.range-m inf)")
    truth = frame.truth
    if truth is not None and truth.clear_rgb is not None:
        clear = truth.clear_rgb
    elif truth is not None and truth.visibility_m is not None and np.isinf(truth.visibility_m):
        clear = frame.image_rgb
    else:
        raise ValueError(f"{frame.file}: no clear image, and the recording does not say that it was seen in clear air")
    ranges = np.nan_to_num(frame.depth_m * frame.camera.ray_lengths(), nan=np.inf)
    height, width = clear.shape[:2]
    factor = reduction_factor(height, width, long_side_px)
    if factor > 1:
        height, width = height // factor * factor, width // factor * factor
        clear = tensor_to_image(averaged_down(image_to_tensor(clear[:height, :width]), factor))
        # One range of every block: a mean over a ship's edge would lie where nothing is.
        ranges = ranges[factor // 2 : height : factor, factor // 2 : width : factor]
    with np.errstate(over="ignore"):  # beyond 65 km is as good as sky
        return ClearView(clear, ranges.astype(np.float16), horizon_colour(clear, ranges))


def horizon_colour(clear_rgb: NDArray[np.uint8], range_m: NDArray[np.floating]) -> NDArray[np.float32] | None:
    """Mean colour (3,) of the lowest part of the sky; None where fewer than 1 % of the pixels are sky."""
    rows, columns = np.nonzero(np.isinf(range_m))
    if len(rows) < 0.01 * range_m.size:
        return None
    lowest = rows >= np.quantile(rows, 1 - HORIZON_SHARE)
    return clear_rgb[rows[lowest], columns[lowest]].mean(axis=0, dtype=np.float32)


class ClearViews:
    """Views of several recordings, read when first asked for and kept in memory. Safe to share between threads.

    Args:
        recordings: folders that `deckline.recording` can open; one given twice is drawn twice as often.
        long_side_px: larger images are averaged down to about this.
        held_out: share of every recording, at its end, that training does not see.
        train: the training part; False gives the held-out part, of every recording once.

    Attributes:
        skipped: what was wrong with frames that could not be read, by file.

    Raises:
        ValueError: no recordings, or no views.
    """

    def __init__(self, recordings: list[Path], long_side_px: int, held_out: float, train: bool = True) -> None:
        self._long_side_px = long_side_px
        self._sources: dict[Path, Source] = {path: open_source(path) for path in recordings}
        self._items = split_views(recordings, self._sources, held_out, train)
        self._cache: dict[tuple[Path, int], ClearView] = {}
        self.skipped: dict[str, str] = {}

    def __len__(self) -> int:
        return len(self._items)

    def __getitem__(self, index: int) -> ClearView:
        path, frame_index = item = self._items[index]
        view = self._cache.get(item)
        if view is None:  # two threads may both load a view; either result serves
            view = clear_view(self._sources[path].load(frame_index), self._long_side_px)
            self._cache[item] = view
        return view

    def draw(self, rng: np.random.Generator) -> ClearView:
        """A random view; a frame that cannot be read is noted in `skipped` and another one drawn.

        Raises:
            ValueError: MAX_BAD_DRAWS frames in a row cannot be read.
        """
        for _ in range(MAX_BAD_DRAWS):
            try:
                return self[int(rng.integers(0, len(self)))]
            except FrameError as error:
                self.skipped[error.file] = error.reason
        raise ValueError(f"{MAX_BAD_DRAWS} frames in a row cannot be read; the last errors: {self.skipped}")


def random_airlight(
    horizon_rgb: NDArray[np.float32] | None, horizon_share: float, rng: np.random.Generator, exact_share: float = 0.0
) -> NDArray[np.float64]:
    """Colour of thick haze (3,), 0..255: the horizon's; near it, greyer, at times darker; or grey, bluish or warm."""
    if horizon_rgb is not None and rng.random() < horizon_share:
        if rng.random() < exact_share:
            return np.clip(horizon_rgb * (1 + rng.normal(0, 0.02, 3)), 0, 255)
        grey = horizon_rgb.mean()
        colour = grey + (horizon_rgb - grey) * rng.uniform(0.0, 1.2)
        colour = colour * (rng.uniform(0.55, 0.85) if rng.random() < 0.25 else rng.uniform(0.85, 1.1))
    else:
        tint = BLUISH if rng.random() < 0.5 else WARM
        colour = rng.uniform(*GREY_LEVELS) * (1 + (tint - 1) * rng.uniform(0.0, 1.0))
    return np.clip(colour * (1 + rng.normal(0, 0.03, 3)), 40, 250)


def hazy_pair(
    view: ClearView, window: tuple[slice, slice], haze: HazeAugmentation, rng: np.random.Generator
) -> tuple[NDArray[np.uint8], NDArray[np.uint8], NDArray[np.float32]]:
    """Hazy and clear (h, w, 3) and transmission (h, w) of one window of a view, flipped at random."""
    clear = view.clear_rgb[window]
    limits = haze.clear_visibility_m if rng.random() < haze.clear_share else haze.visibility_m
    visibility_m = float(np.exp(rng.uniform(*np.log(limits))))
    airlight = random_airlight(view.horizon_rgb, haze.horizon_share, rng, haze.exact_share)
    beta = beta_from_visibility(visibility_m)
    hazy = add_haze(clear, view.range_m[window], beta, airlight)
    if rng.random() < haze.noise_share:
        noise = rng.standard_normal(hazy.shape, dtype=np.float32) * rng.uniform(0, haze.noise_max)
        hazy = np.clip(np.rint(hazy + noise), 0, 255).astype(np.uint8)
    step_v = -1 if rng.random() < haze.flip_vertical else 1
    step_u = -1 if rng.random() < haze.flip_horizontal else 1
    t = transmission(view.range_m[window], beta)
    return hazy[::step_v, ::step_u], clear[::step_v, ::step_u], t[::step_v, ::step_u]


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
    views: ClearViews, batch: int, crop: tuple[int, int], haze: HazeAugmentation, seed: list[int]
) -> tuple[Tensor, Tensor, Tensor]:
    """Hazy and clear (batch, 3, h, w) in 0..1 and transmission (batch, 1, h, w).

    The same for the same seed, so a resumed run sees what it would have seen.
    """
    rng = np.random.default_rng(seed)
    samples = []
    for _ in range(batch):
        view = views.draw(rng)
        window = random_window(view.clear_rgb.shape[:2], crop, haze.crop_scale, rng)
        hazy, clear, t = hazy_pair(view, window, haze, rng)
        planes = [image_to_tensor(hazy), image_to_tensor(clear), np.ascontiguousarray(t)[None, None]]
        sample = torch.cat([torch.from_numpy(plane) for plane in planes], 1)
        if sample.shape[2:] != crop:
            sample = F.interpolate(sample, crop, mode="bilinear", antialias=True, align_corners=False)
        samples.append(sample)
    stacked = torch.cat(samples)
    return stacked[:, :3], stacked[:, 3:6], stacked[:, 6:]
