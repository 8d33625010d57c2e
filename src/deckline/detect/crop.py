"""From a crop of an image to the network's input, once for training and runtime.

A crop is an upright part of the image, possibly reaching beyond it, resampled to the network's pixel grid. Pixel
centres are exact: network pixel (x, y) shows image pixel u = left + (x + 0.5) step - 0.5.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array

from deckline.types import LinePoints

CONTRAST_FLOOR = 3.0  # grey levels; less contrast than that in a crop is noise, and is not amplified further

Box = tuple[float, float, float, float]  # u0, v0, u1, v1, image px


@dataclass(frozen=True)
class Crop:
    """Which part of the image the network sees."""

    left: float  # image u of the crop's left edge, px; -0.5 + 0.5 = 0 is the outer edge of the first pixel
    top: float  # the same for v
    step: float  # image pixels per network pixel

    def __post_init__(self) -> None:
        if not (np.isfinite([self.left, self.top]).all() and self.step > 0 and np.isfinite(self.step)):
            raise ValueError(f"a crop needs finite edges and a positive step, got {self}")

    def to_image(self, points_px: ArrayLike) -> NDArray[np.float64]:
        """Network pixels (N, 2) -> image pixels (N, 2)."""
        return (np.asarray(points_px, dtype=np.float64) + 0.5) * self.step + [self.left, self.top] - 0.5

    def to_network(self, points_px: ArrayLike) -> NDArray[np.float64]:
        """Image pixels (N, 2) -> network pixels (N, 2)."""
        return (np.asarray(points_px, dtype=np.float64) + 0.5 - [self.left, self.top]) / self.step - 0.5

    def resampled(self, network_px: float) -> "Crop":
        """The same edges, seen with pixels as wide as so many network px."""
        return Crop(self.left, self.top, self.step * network_px)

    def bounds(self, width: int, height: int) -> Box:
        """u0, v0, u1, v1 of the crop's edges in image pixels, for a network image of this size."""
        u0, v0 = self.left - 0.5, self.top - 0.5
        return (u0, v0, u0 + width * self.step, v0 + height * self.step)


def check_box(box_px: ArrayLike) -> Box:
    """The box as four floats; raise ValueError unless it is finite and has width and height."""
    u0, v0, u1, v1 = (float(value) for value in np.asarray(box_px, dtype=np.float64))
    if not (np.isfinite([u0, v0, u1, v1]).all() and u1 > u0 and v1 > v0):
        raise ValueError(f"a box needs finite u0 < u1 and v0 < v1, px, got {(u0, v0, u1, v1)}")
    return u0, v0, u1, v1


def box_around(left: LinePoints, right: LinePoints) -> Box:
    """The smallest box around the points of two lines, those left out that are not finite."""
    points = np.concatenate([left.points_px, right.points_px])
    points = points[np.isfinite(points).all(axis=1)]
    (u0, v0), (u1, v1) = points.min(axis=0), points.max(axis=0)
    return float(u0), float(v0), float(u1), float(v1)


def full_crop(image_size: tuple[int, int], network_size: tuple[int, int]) -> Crop:
    """The whole image (width, height), centred in the network's image (width, height), sides padded as needed."""
    (width, height), (net_width, net_height) = image_size, network_size
    step = max(width / net_width, height / net_height)
    return Crop((width - net_width * step) / 2, (height - net_height * step) / 2, step)


def tile_crops(image_size: tuple[int, int], network_size: tuple[int, int], count: int, share: float) -> list[Crop]:
    """`count` x `count` parts of an image (width, height), the middle ones first, each `share` of the whole's crop.

    They are spread evenly from edge to edge; an image that is smaller than the part along an axis is centred in it.
    """
    step = share * full_crop(image_size, network_size).step
    places = [
        [_shift_inside(at, side * step, limit) for at in np.linspace(0.0, max(limit - side * step, 0.0), count)]
        for side, limit in zip(network_size, image_size, strict=True)
    ]
    middle = (count - 1) / 2
    order = sorted(np.ndindex(count, count), key=lambda at: float(np.hypot(at[0] - middle, at[1] - middle)))
    return [Crop(float(places[0][column]), float(places[1][row]), step) for row, column in order]


def crop_around(
    box_px: ArrayLike, image_size: tuple[int, int], network_size: tuple[int, int], fill: float, min_width_px: float
) -> Crop:
    """A crop around a box (u0, v0, u1, v1), image px, in which the box takes `fill` of the limiting dimension.

    The crop is at least `min_width_px` wide, never larger than the whole image's, and is moved into the image as far
    as it fits.
    """
    u0, v0, u1, v1 = check_box(box_px)
    net_width, net_height = network_size
    step = max((u1 - u0) / (fill * net_width), (v1 - v0) / (fill * net_height), min_width_px / net_width)
    step = min(step, full_crop(image_size, network_size).step)
    left = _shift_inside((u0 + u1 + 1) / 2 - net_width * step / 2, net_width * step, image_size[0])
    top = _shift_inside((v0 + v1 + 1) / 2 - net_height * step / 2, net_height * step, image_size[1])
    return Crop(left, top, step)


def _shift_inside(start: float, length: float, limit: float) -> float:
    if length >= limit:
        return (limit - length) / 2
    return min(max(start, 0.0), limit - length)


def sample_crop(image_rgb: NDArray, crop: Crop, network_size: tuple[int, int]) -> NDArray[np.float32]:
    """What the network sees of an image (H, W, 3), uint8 or float grey levels, through a crop.

    Bilinear where the crop magnifies, area-weighted (a triangle as wide as two network pixels) where it shrinks.
    Outside the image is NaN.

    Returns:
        (height, width, 3) float32 grey levels.
    """
    net_width, net_height = network_size
    height, width = image_rgb.shape[:2]
    rows, first_row, valid_row = _resampling_weights(crop.top, crop.step, net_height, height)
    columns, first_column, valid_column = _resampling_weights(crop.left, crop.step, net_width, width)
    part = image_rgb[first_row : first_row + rows.shape[1], first_column : first_column + columns.shape[1]]
    turned = cv2.transpose(part).astype(np.float32, copy=False).reshape(part.shape[1], -1)
    narrow = cv2.transpose((columns @ turned).reshape(net_width, -1, 3))  # (part's rows, width, 3)
    seen = (rows @ narrow.reshape(len(part), -1)).reshape(net_height, -1, 3)
    seen[~valid_row] = np.nan
    seen[:, ~valid_column] = np.nan
    return np.asarray(seen)


def _resampling_weights(start: float, step: float, count: int, size: int) -> tuple[csr_array, int, NDArray[np.bool_]]:
    """Along one axis: weights (count, part), the first pixel of the part, which outputs lie in the image."""
    centres = start + (np.arange(count) + 0.5) * step - 0.5
    reach = max(step, 1.0)
    first = int(np.clip(np.floor(centres[0] - reach), 0, size - 1))
    last = int(np.clip(np.ceil(centres[-1] + reach), 0, size - 1))
    inside = np.clip(centres, 0, size - 1)[:, None]
    pixels = np.ceil(inside - reach) + np.arange(int(2 * reach) + 2)  # all that a triangle can reach
    weights = np.maximum(1.0 - np.abs(pixels - inside) / reach, 0.0)
    weights[(pixels < first) | (pixels > last)] = 0.0
    weights /= np.maximum(weights.sum(axis=1, keepdims=True), 1e-9)
    place = np.clip(pixels, first, last).astype(np.int32) - first
    ends = np.arange(count + 1, dtype=np.int32) * pixels.shape[1]
    valid = (centres > -0.5) & (centres < size - 0.5)
    sparse = csr_array((weights.astype(np.float32).ravel(), place.ravel(), ends), shape=(count, last - first + 1))
    return sparse, first, valid


def normalise(seen_rgb: NDArray[np.float32], floor: float = CONTRAST_FLOOR) -> NDArray[np.float32]:
    """Grey levels (H, W, 3), NaN outside the image -> the network's input (3, H, W).

    Each colour's mean is subtracted and all are divided by one common contrast. This removes airlight's colour and
    most of haze's fading, so that the network need not learn them. Outside the image is 0. A contrast
    below `floor`, grey levels, is not amplified further.
    """
    planes = np.array(np.moveaxis(seen_rgb, 2, 0), dtype=np.float32, order="C")
    outside = ~np.isfinite(planes[0])
    count = outside.size - np.count_nonzero(outside)
    if count == 0:
        return np.zeros_like(planes)
    planes[:, outside] = 0.0
    planes -= (planes.sum(axis=(1, 2), dtype=np.float64) / count).astype(np.float32)[:, None, None]
    planes[:, outside] = 0.0
    power = sum(float(np.dot(plane, plane)) for plane in planes.reshape(3, -1))
    planes /= np.float32(max(np.sqrt(power / (3 * count)), floor))
    return planes
