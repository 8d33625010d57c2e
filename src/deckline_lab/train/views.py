"""What networks are trained on: clear views with ranges, views with lines, and batches made ahead of time.

Recorded frames have depth, so haze is added to them; labelled pictures, and pairs of a hazy and a clear one, stay in
the haze that they were taken in.
"""

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from deckline.dehaze.tensors import average_down, image_to_tensor, reduction_factor, tensor_to_image
from deckline.geometry import Camera
from deckline.recording import FrameError, open_recording
from deckline.recording.airsim import RECORD_FILE
from deckline.recording.images import read_image
from deckline.recording.source import is_inside
from deckline.types import SIDES, EdgeKind, Frame, Segment
from deckline_lab.evaluation.dehazing_pairs import Pair, open_pairs
from deckline_lab.labels.lines import LABELS_FILE, Labels, read_labels, resample
from deckline_sim.visible_line import LINE_POINTS, project_line

MAX_BAD_DRAWS = 20  # frames in a row that cannot be used
PREFETCH = 4  # batches made ahead
LOWEST_STEP, LOWEST_PERCENTILE = 4, 95.0  # px, %: waves have no depth of their own
HORIZON_SHARE = 0.2  # of the sky's pixels, counted from the lowest row: what "the horizon's colour" is the mean of

View = TypeVar("View")
Batch = TypeVar("Batch")


class Views(Generic[View]):
    """Views of several recordings, read when first asked for and kept in memory. Safe to share between threads.

    `skipped` says what was wrong with frames that could not be used, by file.

    Args:
        counts: frames of each recording, by path.
        recordings: paths; one given twice is drawn twice as often.
        held_out: share of every recording, at its end, that training does not see.
        train: the training part; False gives the held-out part, of every recording once.
        load: view `index` of a recording. It raises FrameError where it cannot be read and others can, ValueError
            where it lacks what training needs, as all of its recording will.
    """

    def __init__(
        self,
        counts: Mapping[Path, int],
        recordings: list[Path],
        held_out: float,
        train: bool,
        load: Callable[[Path, int], View],
    ) -> None:
        self._load = load
        self._items: list[tuple[Path, int]] = []
        for path in recordings if train else counts:
            first_held_out = counts[path] - round(held_out * counts[path])
            part = range(first_held_out) if train else range(first_held_out, counts[path])
            self._items += [(path, index) for index in part]
        if not self._items:
            raise ValueError(f"no {'training' if train else 'held-out'} views in {[str(path) for path in recordings]}")
        self._cache: dict[tuple[Path, int], View] = {}
        self.skipped: dict[str, str] = {}

    def __len__(self) -> int:
        return len(self._items)

    def __getitem__(self, index: int) -> View:
        item = self._items[index]
        view = self._cache.get(item)
        if view is None:  # two threads may both load a view; either result serves
            view = self._cache[item] = self._load(*item)
        return view

    def draw(self, rng: np.random.Generator) -> View:
        """A random view; a frame that cannot be used is noted in `skipped` and another one drawn."""
        for _ in range(MAX_BAD_DRAWS):
            view = self.get_usable(int(rng.integers(0, len(self))))
            if view is not None:
                return view
        file, reason = list(self.skipped.items())[-1]
        raise ValueError(f"{MAX_BAD_DRAWS} frames in a row cannot be used, {file} as {reason}")

    def get_usable(self, index: int) -> View | None:
        """View `index`; None, and a note in `skipped`, where it cannot be used."""
        try:
            return self[index]
        except FrameError as error:
            self.skipped[error.file] = error.reason
            return None

    def spread(self, count: int) -> list[int]:
        """Indices of at most `count` views, evenly spread over all."""
        return np.linspace(0, len(self) - 1, min(len(self), count)).round().astype(int).tolist()


def make_ahead(make: Callable[[int], Batch], start: int, steps: int) -> Iterator[Batch]:
    """`make(step)` of the steps from `start` to `steps`, both included, made ahead by threads."""
    with ThreadPoolExecutor(2) as pool:
        waiting = [pool.submit(make, start + k) for k in range(PREFETCH)]
        try:
            for step in range(start, steps + 1):
                waiting.append(pool.submit(make, step + PREFETCH))
                yield waiting.pop(0).result()
        finally:
            pool.shutdown(cancel_futures=True)


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


@dataclass(frozen=True, eq=False)
class PairView:
    """A view in haze and without it, of which no depth is known."""

    clear_rgb: NDArray[np.uint8]  # (H, W, 3)
    hazy_rgb: NDArray[np.uint8]  # (H, W, 3)


def make_clear_view(frame: Frame, long_side_px: int) -> ClearView:
    """What training needs of a frame, averaged down by a whole factor to about `long_side_px`."""
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
        raise ValueError(f"{frame.file}: no clear image, and the recording does not say that it was seen in clear air")
    height, width = clear.shape[:2]
    factor = reduction_factor(height, width, long_side_px)
    clear = _shrink(clear, factor)
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
        None if hazy is None else _shrink(hazy, factor),
        float("inf") if hazy is None or visibility_m is None else visibility_m,
    )


def make_pair_view(pair: Pair, long_side_px: int) -> PairView:
    """A pair averaged down by a whole factor to about `long_side_px`."""
    if pair.clear_rgb is None:
        raise ValueError(f'{pair.frame.file}: no clear picture; name it in {LABELS_FILE} as "pair_of" of the hazy one')
    height, width = pair.clear_rgb.shape[:2]
    factor = reduction_factor(height, width, long_side_px)
    return PairView(_shrink(pair.clear_rgb, factor), _shrink(pair.frame.image_rgb, factor))


def _shrink(image_rgb: NDArray[np.uint8], factor: int) -> NDArray[np.uint8]:
    """Means of blocks of `factor` px; what is left over at the right and below is cut off."""
    if factor == 1:
        return image_rgb
    height, width = (side // factor * factor for side in image_rgb.shape[:2])
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
) -> Views[ClearView | PairView]:
    """Clear views of recordings and pairs of labelled folders, larger ones averaged down to about `long_side_px`; see
    `Views`.
    """
    pairs = {path: open_pairs(path) for path in recordings if is_labelled_folder(path)}
    sources = {path: open_recording(path) for path in recordings if path not in pairs}
    counts = {path: len(pairs[path].keys if path in pairs else sources[path]) for path in recordings}

    def load(path: Path, index: int) -> ClearView | PairView:
        if path in pairs:
            return make_pair_view(pairs[path].load(pairs[path].keys[index]), long_side_px)
        return make_clear_view(sources[path].load(index), long_side_px)

    return Views(counts, recordings, held_out, train, load)


@dataclass(frozen=True, eq=False)
class LineView:
    """A picture and where its lines are in it."""

    file: str
    image_rgb: NDArray[np.uint8]  # (H, W, 3); without haze where there is a clear view
    lines_px: NDArray[np.float64] | None  # (3, N, 2) left, right, centre in order along each, NaN one that is not there
    clear: ClearView | None = None  # None: labelled by people
    ranges_m: NDArray[np.float64] | None = None  # (3, N) of the lines from the camera
    centre_painted: bool | None = None  # None: not known
    edge: EdgeKind | None = None  # what the edge lines are; None: not known


def make_line_view(frame: Frame) -> LineView:
    """What training needs of a frame; the lines need its true pose."""
    clear = make_clear_view(frame, long_side_px=max(frame.image_rgb.shape))  # at its own size
    without_lines = LineView(frame.file, clear.clear_rgb, None, clear)
    truth = frame.truth
    if truth is None or truth.left is None or truth.right is None:
        return without_lines
    if frame.true_world_from_camera is None:
        raise ValueError(f"{frame.file}: no pose; true lines cannot be brought into the image")
    ends = [(a + b) / 2 for a, b in ((truth.left.p0_m, truth.right.p0_m), (truth.left.p1_m, truth.right.p1_m))]
    lines = [project_line(frame, segment) for segment in (truth.left, truth.right, Segment(*ends))]
    if any(line is None for line in lines):
        return without_lines  # a line wholly behind the camera
    points, ranges = (np.stack(parts) for parts in zip(*(line for line in lines if line is not None), strict=True))
    edge = EdgeKind(truth.conditions.get("edge", EdgeKind.PAINT))
    return LineView(frame.file, clear.clear_rgb, points, clear, ranges, truth.centre_painted, edge)


def load_labelled_view(folder: Path, file: str, labels: Labels) -> LineView:
    """Picture `file` of a folder, with its labelled lines."""
    try:
        image = read_image(folder / file)
    except ValueError as error:
        raise FrameError(str(folder / file), str(error)) from None
    lines = np.full((len(SIDES) + 1, LINE_POINTS, 2), np.nan)  # nobody labels the centre line
    for k, side in enumerate(SIDES):
        line = labels[side]
        if line is not None:
            lines[k] = resample(line, LINE_POINTS)
    return LineView(file, image, None if np.isnan(lines).all() else lines)


def is_labelled_folder(path: Path) -> bool:
    """Whether a folder holds pictures with labels.json, and no recording."""
    return (path / LABELS_FILE).is_file() and not (path / RECORD_FILE).exists()


def open_line_views(recordings: list[Path], held_out: float, train: bool = True) -> Views[LineView]:
    """Views of recordings and labelled folders; see `Views`. Pictures that labels.json does not name are left out."""
    labels = {path: read_labels(path / LABELS_FILE) for path in recordings if is_labelled_folder(path)}
    for path, named in labels.items():
        for file in named:
            if not is_inside(file) or not (path / file).is_file():
                raise ValueError(f"{path / LABELS_FILE}: there is no image {file} in {path}")
    files = {path: list(named) for path, named in labels.items()}
    sources = {path: open_recording(path) for path in recordings if path not in labels}

    def load(path: Path, index: int) -> LineView:
        if path in sources:
            return make_line_view(sources[path].load(index))
        return load_labelled_view(path, files[path][index], labels[path][files[path][index]])

    counts = {path: len(files[path] if path in labels else sources[path]) for path in recordings}
    return Views(counts, recordings, held_out, train, load)
