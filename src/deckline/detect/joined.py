"""Several frames, one view: kept pictures averaged in a crop of the newest one, where that one alone shows too little.

Every kept picture is sampled straight into the crop where `motion.py` has it, moved by what the pictures themselves
show to remain (navigation noise, an unknown ship's motion, a rolling shutter), brought to the newest picture's
brightness, and averaged.
"""

from collections import deque
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from deckline.detect.crop import CONTRAST_FLOOR, Box, Crop, crop_around, normalise, sample_crop
from deckline.detect.motion import KeptPicture, Motion, SeenMotion, crop_corners, place_motion
from deckline.detect.registration import CELL_PX, grey
from deckline.detect.search import CropView, Search
from deckline.types import Frame

MAX_AGE_S = 1.0  # of a picture; a deck's motion of more than that is no translation in the picture
MAX_STEP = 1.0  # image px per network px; a runway that needs a coarser crop is near
# Image px between two samples of the joined pictures at most, where a network px shows less: finer ones show no more.
SAMPLE_PX = 0.8
REDUCTIONS = 1, 2, 4  # network px between two samples
MAX_SCALE = 1.25  # between two pictures; more is seen from too different places
MAX_EXPOSURE = 2.0  # ratio of two pictures' brightness in the crop; more is another scene
FADING = 3.912  # extinction times range of what one frame barely shows: the contrast there is 2 %

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class JoinedCrop:
    """What several frames show through a crop of the newest one."""

    pixels: Float32
    """(height, width, 3) grey levels; NaN outside the newest picture."""
    frames: int
    """How many were averaged."""
    noise_gain: float
    """Noise of the average over that of one frame, white noise assumed."""


class FrameStack:
    """The last pictures of a flight, in their order; constant memory.

    Args:
        most: pictures kept; noise falls by their square root.
    """

    def __init__(self, most: int) -> None:
        self._kept: deque[KeptPicture] = deque(maxlen=most)

    def __len__(self) -> int:
        return len(self._kept)

    def reset(self) -> None:
        """Start another flight: forget all pictures."""
        self._kept.clear()

    def add(self, frame: Frame, image_rgb: NDArray[np.uint8]) -> None:
        """Keep the picture of the next frame, (H, W, 3), in which the detector searches.

        Pictures that are more than `MAX_AGE_S` older are dropped; a picture that repeats the last one replaces it.
        """
        while self._kept and frame.time_s - self._kept[0].time_s > MAX_AGE_S:
            self._kept.popleft()
        if self._kept and _is_repeated(image_rgb, self._kept[-1].image_rgb):
            self._kept.pop()
        self._kept.append(KeptPicture(image_rgb, frame.camera, frame.world_from_camera, frame.time_s))

    def join(self, crop: Crop, network_size: tuple[int, int], motion: Motion | None) -> JoinedCrop | None:
        """The average of the kept pictures in a crop of the newest one; None where fewer than two can be joined.

        Pictures i of contrast c_i, brought to the same contrast, have noise of variance 1 / c_i^2, so that the average
        of least variance has weights w_i = c_i^2. At range d the air leaves exp(-beta d) of a contrast, and the blur
        over a pixel leaves of a thin line a part that falls with 1 / d. What needs several frames lies about where
        one frame ends, beta d_0 = 3.912 for the newest one (the contrast that defines visibility), hence

            w_i = ((d_0 / d_i) exp(-3.912 (d_i - d_0) / d_0))^2.

        Args:
            network_size: width and height of the network's image.
            motion: of the place; None: as the pictures show it.
        """
        if len(self._kept) < 2 or crop.step > MAX_STEP:
            return None
        newest = self._kept[-1]
        reduction = _reduction(crop, network_size)
        size, crop = (network_size[0] // reduction, network_size[1] // reduction), crop.resampled(reduction)
        total = sample_crop(newest.image_rgb, crop, size)
        first, weights = total.copy(), [1.0]
        motion = motion or SeenMotion()
        cell_px = CELL_PX // reduction
        for picture in list(self._kept)[-2::-1]:
            sampled = _sample(picture, newest, crop, first, total, motion, cell_px)
            if sampled is not None:
                weight = _weight(motion.range_ratio(picture, newest))
                total = np.asarray(cv2.scaleAdd(sampled, weight, total))
                weights.append(weight)
        if len(weights) < 2:
            return None
        gain = float(np.sqrt(np.square(weights).sum())) / sum(weights)
        mean = cv2.resize(total / np.float32(sum(weights)), network_size, interpolation=cv2.INTER_LINEAR)
        return JoinedCrop(np.asarray(mean), len(weights), gain)


def view_joined(search: Search, box: Box, stack: FrameStack, motion: Motion | None) -> CropView | None:
    """One view of the joined pictures in the crop that the search of a box saw last.

    The contrast below which a crop is taken for noise falls as the noise does.

    Args:
        search: of the newest picture; it has viewed the box.
        box: where the runway should be.
        motion: as for `FrameStack.join`.

    Returns:
        None where nothing was joined, or both lines are not seen about the box's middle.
    """
    view = _view_stack(search, search.crops[-1], stack, motion)
    return view if view is not None and search.shows_pair(view, box) else None


def view_place_joined(
    search: Search, box: Box, stack: FrameStack, frame: Frame, velocity_m_s: Float64
) -> CropView | None:
    """One view of the joined pictures about a box in which a search saw a runway; nothing else says where it is.

    Args:
        search: of the newest picture, which is the frame's.
        velocity_m_s: (2,) of the ship, north and east.

    Returns:
        None where nothing was joined.
    """
    config = search.config
    crop = crop_around(box, search.image_size, config.grid.size, config.fill, config.min_width_px)
    return _view_stack(search, crop, stack, place_motion(frame, box, velocity_m_s))


def _view_stack(search: Search, crop: Crop, stack: FrameStack, motion: Motion | None) -> CropView | None:
    joined = stack.join(crop, search.config.grid.size, motion)
    if joined is None:
        return None
    return search.view_pixels(normalise(joined.pixels, CONTRAST_FLOOR * joined.noise_gain), crop, joined.frames)


def _reduction(crop: Crop, network_size: tuple[int, int]) -> int:
    """Network px between two samples of the joined pictures."""
    fitting = [many for many in REDUCTIONS if all(side % many == 0 for side in network_size)]
    return max((many for many in fitting if many * crop.step <= SAMPLE_PX), default=1)


def _sample(
    old: KeptPicture, new: KeptPicture, crop: Crop, first: Float32, total: Float32, motion: Motion, cell_px: int
) -> Float32 | None:
    """An old picture in a crop of a new one, (height, width, 3), with the brightness of the new one; None: refused.

    Args:
        first: what the new picture shows there; it also fills what the old one does not show.
        total: weighted sum of what was joined so far, to which the old picture is registered.
    """
    height, width = first.shape[:2]
    corners = motion.corners(old, new, crop, (width, height))
    if corners is None or not _is_alike(corners, crop.to_image(crop_corners((width, height)))):
        return None
    part, matrix = _cut_out(old.image_rgb, corners, (width, height))
    residual = motion.register(grey(total), _warp(grey(part), matrix, (width, height)), cell_px)
    if residual is None:
        return None
    sampled = _warp(part, matrix @ residual, (width, height))
    gain = _exposure_gain(sampled, first)
    if gain is None:
        return None
    sampled = np.asarray(cv2.transform(sampled, np.diag(gain)))
    if np.isnan(_mean(sampled)[0]):
        unknown = np.isnan(sampled[..., 0])
        sampled[unknown] = first[unknown]
    return sampled


def _is_alike(corners_px: Float64, others_px: Float64) -> bool:
    """Whether the areas within corners (4, 2) are about as large."""
    areas = (cv2.contourArea(corners.astype(np.float32)) for corners in (corners_px, others_px))
    scale = np.sqrt(next(areas) / next(areas))
    return bool(1 / MAX_SCALE <= scale <= MAX_SCALE)  # False for NaN


def _cut_out(image_rgb: NDArray[np.uint8], corners_px: Float64, size: tuple[int, int]) -> tuple[Float32, Float64]:
    """The part of an image about four corners, and the map (3, 3) to its pixels from those of a network's image."""
    height, width = image_rgb.shape[:2]
    low = np.clip(np.floor(corners_px.min(axis=0)).astype(int) - 8, 0, [width - 1, height - 1])
    high = np.clip(np.ceil(corners_px.max(axis=0)).astype(int) + 9, low + 1, [width, height])
    part = image_rgb[low[1] : high[1], low[0] : high[0]].astype(np.float32)
    to_network = crop_corners(size).astype(np.float32)
    matrix = cv2.getPerspectiveTransform(to_network, (corners_px - low).astype(np.float32))
    return part, np.asarray(matrix, np.float64)


def _warp(pixels: Float32, matrix: Float64, size: tuple[int, int]) -> Float32:
    """What a network's image (width, height) shows of pixels (H, W) or (H, W, 3), NaN outside."""
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpPerspective(pixels, matrix, size, flags=flags, borderValue=(np.nan,) * 3))


def _exposure_gain(sampled: Float32, first: Float32) -> Float32 | None:
    """Ratio (3,) of two pictures' means of each colour, where both are known; None: another scene."""
    new, old = _mean(first), _mean(sampled)
    if not np.isfinite(new + old).all():
        both = np.isfinite(first[..., 0] + sampled[..., 0]).astype(np.uint8)
        if 2 * np.count_nonzero(both) < both.size:
            return None
        new, old = _mean(first, both), _mean(sampled, both)
    gain = (new + 1.0) / (old + 1.0)  # black has no ratio
    return gain.astype(np.float32) if ((gain > 1 / MAX_EXPOSURE) & (gain < MAX_EXPOSURE)).all() else None


def _mean(pixels: Float32, where: NDArray[np.uint8] | None = None) -> Float64:
    """(3,) of (H, W, 3) where a mask (H, W) is not 0; NaN where a pixel is."""
    return np.array(cv2.mean(pixels, mask=where)[:3])


def _weight(range_ratio: float) -> float:
    return float(range_ratio**-2 * np.exp(-2 * FADING * (range_ratio - 1)))


def _is_repeated(image_rgb: NDArray[np.uint8], other_rgb: NDArray[np.uint8]) -> bool:
    """Whether two pictures are the same: noise alone makes them differ in some of so many pixels."""
    return image_rgb is other_rgb or np.array_equal(image_rgb[::16, ::16], other_rgb[::16, ::16])
