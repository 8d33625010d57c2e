"""Several frames, one view: kept pictures averaged in a crop of the newest one, where that one alone shows too little.

Between two frames the plane of the deck moves through the picture by a homography, which poses and the deck's height
give. Every kept picture is sampled straight into the crop through it, moved by what the pictures themselves show to
remain (navigation noise, an unknown ship's motion, a rolling shutter), brought to the newest picture's brightness, and
averaged.
"""

from collections import deque
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from deckline.detect.crop import CONTRAST_FLOOR, Box, Crop, crop_around, normalise, sample_crop
from deckline.detect.prior import prior_from_box
from deckline.detect.registration import measure_shift
from deckline.detect.search import CropView, Search
from deckline.geometry import Camera, rotation_matrix
from deckline.types import Frame, RunwayPrior

MAX_AGE_S = 1.0  # of a picture; a deck's motion of more than that is no translation in the picture
MAX_STEP = 1.0  # image px per network px; a runway that needs a coarser crop is near
MIN_HEIGHT_M = 1.0  # of a camera above the deck, below which the plane gives no homography
MAX_SCALE = 1.25  # between two pictures; more is seen from too different places
MAX_EXPOSURE = 2.0  # ratio of two pictures' brightness in the crop; more is another scene
FADING = 3.912  # extinction times range of what one frame barely shows: the contrast there is 2 %

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class KeptPicture:
    """One picture with its camera."""

    image_rgb: NDArray[np.uint8]  # (H, W, 3); not copied
    camera: Camera
    world_from_camera: RigidTransform
    time_s: float


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

        A frame without a pose, or whose time is not after the last one's, empties the stack; a picture that repeats the
        last one replaces it.
        """
        pose = frame.world_from_camera
        if pose is None or (self._kept and not 0 < frame.time_s - self._kept[-1].time_s <= MAX_AGE_S):
            self.reset()
        if pose is None or not np.isfinite(frame.time_s):
            return
        while self._kept and frame.time_s - self._kept[0].time_s > MAX_AGE_S:
            self._kept.popleft()
        if self._kept and _is_repeated(image_rgb, self._kept[-1].image_rgb):
            self._kept.pop()
        self._kept.append(KeptPicture(image_rgb, frame.camera, pose, frame.time_s))

    def join(
        self, crop: Crop, network_size: tuple[int, int], runway: RunwayPrior, velocity_m_s: Float64
    ) -> JoinedCrop | None:
        """The average of the kept pictures in a crop of the newest one; None where fewer than two can be joined.

        Pictures i of contrast c_i, brought to the same contrast, have noise of variance 1 / c_i^2, so that the average
        of least variance has weights w_i = c_i^2. At range d the air leaves exp(-beta d) of a contrast, and the blur
        over a pixel leaves of a thin line a part that falls with 1 / d. What needs several frames lies about where
        one frame ends, beta d_0 = 3.912 for the newest one (the contrast that defines visibility), hence

            w_i = ((d_0 / d_i) exp(-3.912 (d_i - d_0) / d_0))^2.

        Args:
            network_size: width and height of the network's image.
            runway: where the runway should be, world: the plane is horizontal at its mean height.
            velocity_m_s: (2,) of the ship, north and east.
        """
        if len(self._kept) < 2 or crop.step > MAX_STEP:
            return None
        newest = self._kept[-1]
        total = sample_crop(newest.image_rgb, crop, network_size)
        first, weights = total.copy(), [1.0]
        for picture in list(self._kept)[-2::-1]:
            sampled = _sample(picture, newest, crop, first, total, runway, velocity_m_s)
            if sampled is not None:
                weight = _weight(picture, newest, runway, velocity_m_s)
                total += np.float32(weight) * sampled
                weights.append(weight)
        if len(weights) < 2:
            return None
        gain = float(np.sqrt(np.square(weights).sum())) / sum(weights)
        return JoinedCrop(total / np.float32(sum(weights)), len(weights), gain)


def view_joined(
    search: Search, box: Box, stack: FrameStack, runway: RunwayPrior, velocity_m_s: Float64
) -> CropView | None:
    """One view of the joined pictures in the crop that the search of a box saw last.

    The contrast below which a crop is taken for noise falls as the noise does.

    Args:
        search: of the newest picture; it has viewed the box.
        box: where the runway should be.
        runway, velocity_m_s: as for `FrameStack.join`.

    Returns:
        None where nothing was joined, or both lines are not seen about the box's middle.
    """
    view = _view_stack(search, search.crops[-1], stack, runway, velocity_m_s)
    return view if view is not None and search.shows_pair(view, box) else None


def view_place_joined(
    search: Search, box: Box, stack: FrameStack, frame: Frame, velocity_m_s: Float64
) -> CropView | None:
    """One view of the joined pictures about a box in which a search saw a runway; nothing else says where it is.

    Args:
        search: of the newest picture, which is the frame's.
        velocity_m_s: as for `FrameStack.join`.

    Returns:
        None where nothing was joined, and where the box is no place on the deck's plane.
    """
    runway, config = prior_from_box(frame, box), search.config
    if runway is None:
        return None
    crop = crop_around(box, search.image_size, config.grid.size, config.fill, config.min_width_px)
    return _view_stack(search, crop, stack, runway, velocity_m_s)


def _view_stack(
    search: Search, crop: Crop, stack: FrameStack, runway: RunwayPrior, velocity_m_s: Float64
) -> CropView | None:
    joined = stack.join(crop, search.config.grid.size, runway, velocity_m_s)
    if joined is None:
        return None
    return search.view_pixels(normalise(joined.pixels, CONTRAST_FLOOR * joined.noise_gain), crop, joined.frames)


def plane_homography(
    old: KeptPicture, new: KeptPicture, plane_z_m: float, velocity_m_s: Float64
) -> NDArray[np.float64] | None:
    """Matrix (3, 3) from rays of a new picture to those of an old one, for points of a horizontal plane that moves.

    A point on the ray r of the new camera lies at c_n + R_n r h / (R_n r)_z, h the plane's depth below the camera; the
    old camera saw it at that place less the plane's way since. None where the new camera is not above the plane.
    Source: Hartley and Zisserman, "Multiple view geometry", 2004, section 13.1.
    """
    height_m = plane_z_m - new.world_from_camera.translation[2]
    if height_m < MIN_HEIGHT_M:
        return None
    moved = new.world_from_camera.translation - old.world_from_camera.translation
    moved[:2] -= (new.time_s - old.time_s) * velocity_m_s
    world_from_new = rotation_matrix(new.world_from_camera)
    in_plane = np.eye(3) + np.outer(moved, [0.0, 0.0, 1.0]) / height_m
    return np.asarray(rotation_matrix(old.world_from_camera).T @ in_plane @ world_from_new)


def _sample(
    old: KeptPicture,
    new: KeptPicture,
    crop: Crop,
    first: Float32,
    total: Float32,
    runway: RunwayPrior,
    velocity_m_s: Float64,
) -> Float32 | None:
    """An old picture in a crop of a new one, (height, width, 3), with the brightness of the new one; None: refused.

    Args:
        first: what the new picture shows there; it also fills what the old one does not show.
        total: weighted sum of what was joined so far, to which the old picture is registered.
    """
    homography = plane_homography(old, new, _plane_z_m(runway), velocity_m_s)
    corners = None if homography is None else _map_corners(old, new, crop, first.shape[:2], homography)
    if corners is None:
        return None
    sample = partial(_warp, old.image_rgb, corners, first.shape[:2])
    sampled = sample(np.zeros(2))
    gain = _exposure_gain(sampled, first)
    shift = None if gain is None else measure_shift(total, sampled)
    if gain is None or shift is None:
        return None
    sampled = sample(shift) * gain
    unknown = np.isnan(sampled[..., 0])
    if unknown.any():
        sampled[unknown] = first[unknown]
    return sampled


def _map_corners(
    old: KeptPicture, new: KeptPicture, crop: Crop, shape: tuple[int, ...], homography: Float64
) -> Float64 | None:
    """Where the crop's four corners lie in the old picture, px (4, 2); None where they lie too differently."""
    corners = crop.to_image(_corners(shape))
    rays = new.camera.rays(corners) @ homography.T
    if not (rays[:, 2] > 0).all():
        return None
    mapped = old.camera.project(rays)
    scale = np.sqrt(_area(mapped) / _area(corners))
    return mapped if 1 / MAX_SCALE <= scale <= MAX_SCALE else None  # False for NaN


def _corners(shape: tuple[int, ...]) -> Float64:
    height, width = shape
    return np.array([[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]], dtype=np.float64)


def _area(corners: Float64) -> float:
    x, y = corners.T
    return float(abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2)


def _warp(image_rgb: NDArray[np.uint8], corners_px: Float64, shape: tuple[int, ...], shift: Float64) -> Float32:
    """The part of an image between four corners, moved by (2,) network px: (height, width, 3), NaN outside."""
    height, width = image_rgb.shape[:2]
    low = np.clip(np.floor(corners_px.min(axis=0)).astype(int) - 8, 0, [width - 1, height - 1])
    high = np.clip(np.ceil(corners_px.max(axis=0)).astype(int) + 9, low + 1, [width, height])
    part = image_rgb[low[1] : high[1], low[0] : high[0]].astype(np.float32)
    to_network = _corners(shape).astype(np.float32)
    matrix = cv2.getPerspectiveTransform(to_network, (corners_px - low).astype(np.float32))
    matrix = matrix @ np.array([[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]], [0.0, 0.0, 1.0]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    outside = (np.nan, np.nan, np.nan)
    return np.asarray(cv2.warpPerspective(part, matrix, shape[::-1], flags=flags, borderValue=outside))


def _exposure_gain(sampled: Float32, first: Float32) -> Float32 | None:
    """Ratio (3,) of two pictures' means of each colour, where both are known; None: another scene."""
    both = np.isfinite(first[..., 0] + sampled[..., 0]).astype(np.uint8)
    if 2 * np.count_nonzero(both) < both.size:
        return None
    means = (np.array(cv2.mean(pixels, mask=both)[:3]) for pixels in (first, sampled))
    new, old = (mean + 1.0 for mean in means)  # black has no ratio
    gain = new / old
    return gain.astype(np.float32) if ((gain > 1 / MAX_EXPOSURE) & (gain < MAX_EXPOSURE)).all() else None


def _weight(old: KeptPicture, new: KeptPicture, runway: RunwayPrior, velocity_m_s: Float64) -> float:
    place = np.concatenate([runway.left_m, runway.right_m]).mean(axis=0)
    earlier = place - np.array([*(new.time_s - old.time_s) * velocity_m_s, 0.0])
    new_m = float(np.linalg.norm(place - new.world_from_camera.translation))
    old_m = float(np.linalg.norm(earlier - old.world_from_camera.translation))
    return float((new_m / old_m) ** 2 * np.exp(-2 * FADING * (old_m - new_m) / new_m))


def _plane_z_m(runway: RunwayPrior) -> float:
    return float(np.concatenate([runway.left_m, runway.right_m])[:, 2].mean())


def _is_repeated(image_rgb: NDArray[np.uint8], other_rgb: NDArray[np.uint8]) -> bool:
    """Whether two pictures are the same: noise alone makes them differ in some of so many pixels."""
    return image_rgb is other_rgb or np.array_equal(image_rgb[::16, ::16], other_rgb[::16, ::16])
