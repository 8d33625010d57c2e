"""What one picture measures: points of both edge lines, the near end of the lines, and the horizon."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deckline.dehaze.horizon import Horizon
from deckline.geometry import Camera
from deckline.localize.depth import MIN_SIGMA_PX
from deckline.localize.observations import ROW_SIGMA_PX
from deckline.localize.solver import CORRELATION, CORRELATION_SIGMA, noise_inflation
from deckline.types import SIDES, Detection, PixelLine

Array = NDArray[np.float64]
MIN_SPREAD = 1e-4  # of a line's points along it, focal lengths; shorter ones have no direction


@dataclass(frozen=True, eq=False)
class LineSight:
    """One edge line in a picture, as two points on it whose errors across it are independent."""

    rays: Array
    """(2, 3) optical frame, z = 1, lens distortion removed."""
    across: Array
    """(2,) unit vector normal to the line, normalised image coordinates."""
    sigma: Array
    """(2,) 1-sigma across, normalised image coordinates."""


@dataclass(frozen=True, eq=False)
class HorizonSight:
    """The horizon in a picture."""

    middle: Array
    """(3,) ray to it in the picture's middle column, optical frame, z = 1."""
    slope: float
    """Its fall for each step to the right, normalised image coordinates."""
    sigma: float
    """1-sigma of the middle, up, normalised image coordinates."""
    slope_sigma: float
    """1-sigma of the slope."""


@dataclass(frozen=True, eq=False)
class LevelSight:
    """What shows roll and pitch in one frame."""

    horizon: HorizonSight | None = None
    """In its picture."""
    attitude: Array | None = None
    """(3, 3) level_from_body of a sensor."""
    white_rad: float = 0.0
    """1-sigma of the sensor's noise that is new in every frame."""

    @property
    def is_known(self) -> bool:
        """Whether either is there."""
        return self.horizon is not None or self.attitude is not None

    @property
    def roll_rad(self) -> float:
        """About where the roll is: the sensor's, else the horizon's, else level."""
        if self.attitude is not None:
            return float(np.arctan2(self.attitude[2, 1], self.attitude[2, 2]))
        return 0.0 if self.horizon is None else -float(np.arctan(self.horizon.slope))


def sight_lines(camera: Camera, detection: Detection, pixel_lines: dict[str, PixelLine]) -> dict[str, LineSight]:
    """The edge lines that a picture shows; a line without a direction is left out.

    The noise is the detector's, larger where residuals scatter or are alike more than stated (`noise_inflation`).
    """
    fits = {}
    for side in SIDES:
        if side in pixel_lines:
            fit = _fit_line(camera, detection, side, pixel_lines[side])
            if fit is not None:
                fits[side] = fit
    factors = noise_inflation([residuals for _, residuals in fits.values()], CORRELATION, CORRELATION_SIGMA)
    return {
        side: LineSight(sight.rays, sight.across, factor * sight.sigma)
        for (side, (sight, _)), factor in zip(fits.items(), factors, strict=True)
    }


def _fit_line(camera: Camera, detection: Detection, side: str, line: PixelLine) -> tuple[LineSight, Array] | None:
    """The line through its inliers by weighted least squares, and its normalised residuals in order along it."""
    points = getattr(detection, side)
    pixels, sigma_px = points.points_px[line.inliers], points.sigma_px[line.inliers]
    rays = camera.rays(pixels)
    column = np.column_stack([np.maximum(sigma_px, MIN_SIGMA_PX), np.zeros(len(pixels))])
    step = (camera.rays(pixels + column) - camera.rays(pixels - column))[:, :2] / 2
    usable = np.isfinite(rays).all(axis=1) & np.isfinite(step).all(axis=1)
    rays, step = rays[usable, :2], step[usable]
    if len(rays) < 3:
        return None
    _, _, axes = np.linalg.svd(rays - rays.mean(axis=0), full_matrices=False)
    along, across = axes
    sigma = np.hypot(step @ across, across[1] * ROW_SIGMA_PX / camera.fy)
    weights = sigma**-2.0
    centre = weights @ rays / weights.sum()
    place, offset = (rays - centre) @ along, (rays - centre) @ across
    spread = float(np.sqrt(weights @ place**2 / weights.sum()))
    if spread < MIN_SPREAD:
        return None
    turn = float(weights @ (place * offset) / (weights @ place**2))  # the offset's mean is 0 about the centre
    residuals = ((offset - turn * place) / sigma)[np.argsort(place)]
    ends = np.array([-spread, spread])
    on_line = centre + ends[:, None] * along + (turn * ends)[:, None] * across
    ends_sigma = np.full(2, np.sqrt(2 / weights.sum()))  # of offset and turn together, uncorrelated at these places
    return LineSight(np.column_stack([on_line, np.ones(2)]), across, ends_sigma), residuals


def sight_horizon(camera: Camera, horizon: Horizon) -> HorizonSight:
    """A horizon in the normalised coordinates of a lens without distortion."""
    middle = camera.rays(np.array([[(horizon.width_px - 1) / 2, horizon.middle_px]]))[0]
    stretch = camera.fx / camera.fy
    return HorizonSight(
        middle, horizon.slope * stretch, horizon.middle_sigma_px / camera.fy, horizon.slope_sigma * stretch
    )
