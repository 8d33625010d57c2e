"""The airlight of one image: a smooth surface through its sky, moved to the sky's own colour where that is plain.

A quadratic surface continues the sky's colour behind objects. It does not follow dark corners of a lens or a sky that
darkens along the horizon, and dehazing darkens what is below the airlight further. So each plain cell of the sky moves
the airlight to its own colour. A dark object in fog is plain, too: cells that are darker than their surroundings and
narrower than a share of the image are taken to be as bright as these.

The constants were chosen by eye on 48 photographs of fog that are not part of this project; the far reach and the
share of top rows on 40 others.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deckline.dehaze.filters import dark_channel, mean_channel

Image = NDArray[np.float32]

SKY_GRADIENT = 0.012  # of full scale a pixel; what changes less is smooth
SKY_PX = 7  # side of the window in which it is averaged
MIN_TOP_SHARE = 0.05  # of the top rows that a smooth region must hold to be sky
TOP_ROWS, TOP_SHARE = 3, 0.03  # at least so many, else a share of the height: some pictures have a frame
TOP_BAND = 0.1  # of the height, whose median grey is the sky's
LEAST_GREY = 0.85  # of it; smooth water below a sky is darker
MIN_SKY_SHARE = 0.03  # of the image; a smaller sky determines no surface
SKY_SPREAD = 0.03  # of full scale; colours farther off the surface weigh less
SKY_RIDGE = (2e-5, 0.01, 0.01, 0.1, 0.1, 0.1)  # relative to a pixel's weight, of the surface's terms
SURFACE_SAMPLES, SURFACE_STEPS = 4000, 5  # pixels of the sky that are fitted; rounds of reweighting
LOWEST_SKY = 80  # percentile of the columns' lowest sky rows; below it the airlight has that row's value
AIRLIGHT_SIGMA, MOVE_SIGMA = 0.014, 0.3  # 1-sigma, of full scale; what a move adds, of itself
LEAST_AIRLIGHT = 0.05  # of full scale; a divisor
CELLS = 60  # across the image
PLAIN_SHARE = 0.8  # of a cell's pixels that are smooth
PLAIN_STEP = 0.018  # of full scale a cell; the edge of a ship in fog is steeper
PLAIN_GREY = 0.7  # of the surface's, in the upper half of the sky; darker cells move nothing
LOWER_GREY = 0.8, 0.9  # the same below; from the second on a cell moves it in full: with one limit seas would flicker
PLAIN_BELOW = 0.15  # of the height: how far below the sky's lowest row
FILL_CELLS = 15  # side of a square; a dark place that it does not fit into is filled
MOVE_CELLS = 2.0, 8.0  # 1-sigma of a cell's reach: near, and where none is near
FAR_WEIGHT = 0.1  # of the latter
MOVE_FADE = 0.01  # the weight at which half of a move is left


@dataclass(frozen=True, eq=False)
class Airlight:
    """The airlight of an image (h, w, 3), of full scale."""

    colour: Image
    """(h, w, 3)."""
    sigma: Image
    """(h, w) 1-sigma of its grey."""
    sky: NDArray[np.bool_]
    """(h, w) where the image shows sky or the haze before it."""


def estimate_airlight_surface(image: Image) -> Airlight:
    """The airlight of an image (h, w, 3) of full scale; less certain where the sky moves it off its surface."""
    smooth = find_smooth_top(image)
    sky = find_sky(image, smooth)
    surface = fit_airlight(image, sky)
    colour = follow_sky(surface, image, smooth, _lowest_row(sky)) if sky.any() else surface
    moved = np.abs(mean_channel(colour) - mean_channel(surface))
    return Airlight(colour, np.hypot(AIRLIGHT_SIGMA, MOVE_SIGMA * moved), sky)


def find_smooth_top(image: Image) -> NDArray[np.bool_]:
    """What is smooth from the top of an image (h, w, 3) of full scale down (h, w)."""
    import cv2

    smooth = cv2.blur(_gradient(mean_channel(image)), (SKY_PX, SKY_PX)) < SKY_GRADIENT
    return _from_the_top(np.asarray(cv2.erode(smooth.astype(np.uint8), np.ones((3, 3), np.uint8)), np.uint8))


def find_sky(image: Image, smooth: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Where the smooth top (h, w) of an image (h, w, 3) of full scale is sky or the haze before it (h, w).

    A smooth top that is darker than what lies below it is none.
    """
    if not smooth.any():
        return smooth
    grey = mean_channel(image)
    rows = max(TOP_ROWS, round(TOP_BAND * len(grey)))
    sky = smooth & (grey > LEAST_GREY * np.median(grey[:rows][smooth[:rows]]))
    below = dark_channel(image, 11)[~sky]
    if len(below) and sky.any() and grey[sky].mean() < below.mean():
        return np.zeros_like(sky)
    return sky


def fit_airlight(image: Image, sky: NDArray[np.bool_]) -> Image:
    """The airlight (h, w, 3): a quadratic surface through the sky, or the haziest colour where there is none."""
    height, width = sky.shape
    if sky.mean() <= MIN_SKY_SHARE:
        dark = dark_channel(image, 11)
        colour = np.median(image[dark >= np.percentile(dark, 99.5)], axis=0)
        return np.broadcast_to(np.maximum(colour, LEAST_AIRLIGHT), image.shape).astype(np.float32)
    y, x = (np.linspace(-1, 1, count, dtype=np.float32) for count in sky.shape)
    sample = np.flatnonzero(sky)
    sample = sample[:: max(1, len(sample) // SURFACE_SAMPLES)]
    rows, colours = _quadratic_terms(y[sample // width], x[sample % width]), image.reshape(-1, 3)[sample]
    ridge = np.diag(np.array(SKY_RIDGE, np.float32) * len(rows))
    weights = np.ones(len(rows), np.float32)
    for _ in range(SURFACE_STEPS):
        weighted = (rows * weights[:, None]).T
        surface = np.linalg.solve(weighted @ rows + ridge, weighted @ colours)
        weights = 1 / (1 + ((colours - rows @ surface) ** 2).sum(axis=1) / SKY_SPREAD**2)
    held = np.minimum(np.arange(height), _lowest_row(sky))
    constant, slope, square = (_quadratic_terms(y[held], np.full_like(y, at)) @ surface for at in (0, 1, -1))
    slope, square = (slope - square) / 2, (slope + square) / 2 - constant  # in x, of every row
    found = np.stack([np.ones_like(x), x, x * x], axis=1) @ np.stack([constant, slope, square], axis=1)
    darkest = [max(LEAST_AIRLIGHT, channel[sky].min()) for channel in np.moveaxis(image, 2, 0)]
    return np.clip(found, np.array(darkest, np.float32), 1)


def _lowest_row(sky: NDArray[np.bool_]) -> int:
    return int(np.percentile(len(sky) - 1 - sky[::-1].argmax(axis=0)[sky.any(axis=0)], LOWEST_SKY))


def _quadratic_terms(y: Image, x: Image) -> Image:
    """1, x, y, x^2, x y, y^2 of points (N,), x and y from -1 to 1: (N, 6)."""
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)


def follow_sky(airlight: Image, image: Image, smooth: NDArray[np.bool_], lowest_row: int) -> Image:
    """An airlight (h, w, 3) moved to an image's own colour where its smooth top (h, w) is plain; the move fades out.

    Args:
        lowest_row: of the sky; a plain sea or road far below it moves nothing.
    """
    import cv2

    height, width = smooth.shape
    size = min(CELLS, width), max(1, min(height, round(CELLS * height / width)))
    parts = (image, airlight, smooth.astype(np.float32))
    colour, air, share = (cv2.resize(part, size, interpolation=cv2.INTER_AREA) for part in parts)
    grey = colour.mean(axis=2)
    relative, (low, high) = grey / air.mean(axis=2), LOWER_GREY
    is_upper = np.arange(len(grey))[:, None] < 0.5 * lowest_row / height * len(grey)
    certainty = np.where(is_upper, relative > PLAIN_GREY, np.clip((relative - low) / (high - low), 0, 1))
    plain = (share > PLAIN_SHARE) & (_gradient(grey) < PLAIN_STEP) & (certainty > 0)
    plain[round((lowest_row / height + PLAIN_BELOW) * len(plain)) :] = False
    plain = _from_the_top(plain.astype(np.uint8))
    shift = fill_dark_places(np.where(plain[..., None], certainty[..., None] * (colour - air), -1).astype(np.float32))
    weight = (shift.min(axis=2, keepdims=True) > -1).astype(np.float32)
    near, far = (cv2.GaussianBlur(np.dstack([shift * weight, weight]), (0, 0), cells) for cells in MOVE_CELLS)
    blurred = near + FAR_WEIGHT * far
    faded = blurred[..., :3] / (blurred[..., 3:] + MOVE_FADE)
    correction = cv2.resize(faded, (width, height), interpolation=cv2.INTER_LINEAR)
    return np.clip(airlight + correction, LEAST_AIRLIGHT, 1).astype(np.float32)


def fill_dark_places(shift: Image) -> Image:
    """A map (h, w, 3) whose dark places, narrower than a square, are as bright as their surroundings; -1 is unknown.

    A place that gets ever darker towards the border or the unknown stays: a corner, a horizon.
    """
    import cv2

    padded = cv2.copyMakeBorder(shift, *(FILL_CELLS,) * 4, cv2.BORDER_CONSTANT, value=(-1, -1, -1))
    closed = cv2.morphologyEx(padded, cv2.MORPH_CLOSE, np.ones((FILL_CELLS, FILL_CELLS), np.uint8))
    return np.asarray(closed[FILL_CELLS:-FILL_CELLS, FILL_CELLS:-FILL_CELLS], dtype=np.float32)


def _gradient(grey: Image) -> Image:
    """Of a map (h, w), a pixel."""
    import cv2

    across, down = (cv2.Sobel(grey, cv2.CV_32F, *order) / 8 for order in ((1, 0), (0, 1)))
    return np.hypot(across, down)


def _from_the_top(mask: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """The parts of a mask (h, w) that hold enough of the top rows."""
    import cv2

    _, labels = cv2.connectedComponents(mask, connectivity=4)
    top = labels[: max(TOP_ROWS, round(TOP_SHARE * len(labels)))]
    is_top = np.bincount(top.ravel(), minlength=labels.max() + 1) > MIN_TOP_SHARE * top.size
    is_top[0] = False
    return np.asarray(is_top[labels])
