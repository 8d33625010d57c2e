"""How far two pictures are shifted, from the pictures alone: of one place, or from a camera that turns."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from deckline.detect.crop import Box

CELL_PX = 4  # network px of a side of the cells to which pictures are reduced
BLUR_CELLS, BACKGROUND_CELLS = 1.5, 8.0  # 1-sigma: finer is noise, coarser the slope of sky and sea
REACH_CELLS = 12  # the farthest shift that is looked for along each axis
# Of pictures of one place. Two pictures of `cvn` at 1.27 km in 1500 m visibility have 0.44 and more, those of places
# farther apart than was looked for 0.33 and less, in 3000 m visibility as in pure haze.
MIN_CORRELATION = 0.38
MAX_STRETCH = 0.1  # of an affine map, or rad: what pictures of other places need to resemble each other
AFFINE_STEPS = cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 1e-4  # at most so many; the correlation's last gain
WIDTH_PX = 320  # of whole pictures that are compared
MIN_RESPONSE = 0.1  # of the peak of their phase correlation; a lower one is chance, as between two scenes

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]


def measure_shift(reference: Float32, other: Float32, cell_px: int = CELL_PX) -> Float64 | None:
    """What has to be added to places of the reference to find them in the other picture, px (2,): right, down.

    The maximum of the normalised cross-correlation, to a fraction of a cell by a parabola along each axis.

    Args:
        reference, other: (H, W) grey levels of the same size; NaN is unknown.
        cell_px: side of the cells to which both are reduced.

    Returns:
        None where no place resembles the reference, or the best one lies as far off as was looked for, and for
        pictures that are no larger than what is looked for.
    """
    inner = _details(reference, cell_px)[REACH_CELLS:-REACH_CELLS, REACH_CELLS:-REACH_CELLS]
    if not inner.size:
        return None
    surface = cv2.matchTemplate(_details(other, cell_px), inner, cv2.TM_CCOEFF_NORMED)
    row, column = np.unravel_index(int(surface.argmax()), surface.shape)
    is_inside = 0 < row < surface.shape[0] - 1 and 0 < column < surface.shape[1] - 1
    if not (is_inside and surface[row, column] >= MIN_CORRELATION):
        return None
    along = _vertex(surface[row, column - 1 : column + 2]), _vertex(surface[row - 1 : row + 2, column])
    return cell_px * (np.array([column, row]) - REACH_CELLS + along)


def measure_affine(reference: Float32, other: Float32, cell_px: int = CELL_PX) -> Float64 | None:
    """The affine map from places of a reference, px, to those of the other picture, (3, 3) homogeneous.

    By Evangelidis and Psarakis, "Parametric image alignment using enhanced correlation coefficient maximization", IEEE
    TPAMI 30(10), 2008. It finds what is a few cells or degrees away.

    Args:
        reference, other, cell_px: as for `measure_shift`.

    Returns:
        None where it does not converge, or the pictures then do not resemble each other.
    """
    details, moved = _details(reference, cell_px), _details(other, cell_px)
    still = np.eye(2, 3, dtype=np.float32)
    try:
        correlation, affine = cv2.findTransformECC(
            details, moved, still.copy(), cv2.MOTION_AFFINE, AFFINE_STEPS, np.ones(details.shape, np.uint8), 1
        )
    except cv2.error as error:
        if error.code != cv2.Error.StsNoConv:
            raise
        return None
    is_near = np.abs(affine[:, :2] - still[:, :2]).max() <= MAX_STRETCH and np.abs(affine[:, 2]).max() <= REACH_CELLS
    if not (is_near and correlation >= MIN_CORRELATION):
        return None
    to_px = np.array([[cell_px, 0.0, (cell_px - 1) / 2], [0.0, cell_px, (cell_px - 1) / 2], [0.0, 0.0, 1.0]])
    return np.asarray(to_px @ np.vstack([affine, [0.0, 0.0, 1.0]]) @ np.linalg.inv(to_px))


def grey(pixels: Float32) -> Float32:
    """The mean (H, W) of the colours of (H, W, 3)."""
    return np.asarray(cv2.transform(pixels, np.full((1, 3), 1 / 3, np.float32)))


def _details(pixels: Float32, cell_px: int) -> Float32:
    """Grey levels (H, W) -> (H / cell_px, W / cell_px), without what is coarser or finer than a line; unknown is 0."""
    cells = cv2.resize(pixels, None, fx=1 / cell_px, fy=1 / cell_px, interpolation=cv2.INTER_AREA)
    unknown = ~np.isfinite(cells)
    cells[unknown] = 0.0 if unknown.all() else np.nanmean(cells)
    details = cv2.GaussianBlur(cells, (0, 0), BLUR_CELLS) - cv2.GaussianBlur(cells, (0, 0), BACKGROUND_CELLS)
    details[unknown] = 0.0
    return np.asarray(details)


def _vertex(values: NDArray[Any]) -> float:
    """Where the parabola through three values has its maximum, steps from the middle one."""
    before, middle, after = (float(value) for value in values)
    bend = before - 2 * middle + after
    return 0.5 * (before - after) / bend if bend < 0 else 0.0


def small_grey(image_rgb: NDArray[np.uint8]) -> Float32:
    """An image (H, W, 3) as grey levels, `WIDTH_PX` wide."""
    height, width = image_rgb.shape[:2]
    size = WIDTH_PX, max(round(height * WIDTH_PX / width), 2)
    small = cv2.resize(image_rgb, size, interpolation=cv2.INTER_AREA)
    return cv2.cvtColor(small, cv2.COLOR_RGB2GRAY).astype(np.float32)


def picture_shift(before: Float32, after: Float32) -> Float64 | None:
    """How far `after` is moved against `before`, both of `small_grey`: (du, dv) in image widths.

    By phase correlation: an aircraft that turns moves all far objects alike. None where the pictures have nothing in
    common, or another size.
    """
    if before.shape != after.shape:
        return None
    window = cv2.createHanningWindow(before.shape[::-1], cv2.CV_32F)
    shift, response = cv2.phaseCorrelate(before, after, window)
    return np.array(shift) / WIDTH_PX if response >= MIN_RESPONSE else None


def move_box(box: Box, shift: NDArray[np.float64], image_width: int) -> Box:
    """A box of an image so many px wide, moved by a shift (2,) in image widths."""
    du, dv = shift * image_width
    u0, v0, u1, v1 = box
    return u0 + du, v0 + dv, u1 + du, v1 + dv
