"""The paper's own line estimator: each line alone in the world, by stochastic gradient descent.

The baseline of Table 6's first rows; nothing that flies uses it.
"""

import math

import numpy as np
from numpy.typing import NDArray

from deckline.config import RunConfig
from deckline.geometry import wrap_angle
from deckline.localize.depth import MIN_LINE_POINTS, DeckPoints
from deckline.localize.line_fit import LineFit, drop_contradictions, drop_unsure
from deckline.localize.localizer import PlacedLines, localize, locate_inliers
from deckline.localize.solver import CORRELATION, CORRELATION_SIGMA, noise_inflation
from deckline.types import DepthMode, Detection, Diagnostic, Frame, PixelLine, Reason, RunwayEstimate

Array = NDArray[np.float64]
MIN_SIGMA_M = 1e-6  # lower bound, for finite residuals of noiseless points
EPOCHS = 400  # passes of the descent over the points
LEARNING_RATE = 0.5  # eta of the first pass, on points scaled to unit size; falls as 1 / epoch


def localize_by_descent(
    frame: Frame, detection: Detection, config: RunConfig, rng: np.random.Generator
) -> RunwayEstimate:
    """`localize` with the paper's estimator in place of the joint fit."""
    return localize(frame, detection, config, rng, place_alone)


def place_alone(
    frame: Frame,
    detection: Detection,
    pixel_lines: dict[str, PixelLine],
    mode: DepthMode,
    config: RunConfig,
    rng: np.random.Generator,
) -> PlacedLines:
    """Each inlier into the world, then each line alone through its points."""
    noise, pose = config.noise, frame.world_from_camera
    points = {s: locate_inliers(frame, getattr(detection, s), line, mode, noise) for s, line in pixel_lines.items()}
    fits = {} if pose is None else fit_alone(points, pose.translation, rng)
    others = (side for side in pixel_lines if side not in fits)
    missing = (Diagnostic(Reason.NO_POINTS, f"the {side} line has too few points on the deck") for side in others)
    sure, unsure = drop_unsure(fits)
    consistent, contradictions = drop_contradictions(sure)
    return PlacedLines(consistent, points, (*missing, *unsure, *contradictions))


def fit_alone(points: dict[str, DeckPoints], camera_m: Array, rng: np.random.Generator) -> dict[str, LineFit]:
    """Each line alone, all its points with equal weight, by stochastic gradient descent in the world.

    Sensitivities are those of the least-squares line that the descent converges to. A line with too few points is left
    out. Lines point away from the camera (3,), in the direction of landing.

    Source: Li et al. 2024, section 3.2.
    """
    points = {side: line for side, line in points.items() if len(line) >= MIN_LINE_POINTS}
    total = sum(len(line) for line in points.values())
    fits, start = {}, 0
    for side, line in points.items():
        fits[side] = _fit(line, start, total, camera_m, rng)
        start += len(line)
    return fits


def fit_sgd(points_m: Array, rng: np.random.Generator) -> Array:
    """The paper's fit: w <- w - eta dL/dw on the squared distance, one point at a time; (w0, w1, w2, w3).

    Every step ends with w1^2 + w2^2 = 1. Points are centred and scaled first. Eta falls as 1 / epoch, else the steps
    never converge.

    Args:
        points_m: (N, 3) world points, metres.
        rng: order of the points.

    Raises:
        ValueError: fewer than two points.
    Source: Li et al. 2024, section 3.2.
    """
    if len(points_m) < 2:
        raise ValueError(f"a line needs at least 2 points, got {len(points_m)}")
    centre = points_m[:, :2].mean(axis=0)
    offsets = points_m[:, :2] - centre
    scale = float(np.abs(offsets).max())
    scaled = offsets / scale
    along = scaled[-1] - scaled[0]
    length = math.hypot(*along)
    constant, across, down = 0.0, -float(along[1]) / length, float(along[0]) / length
    points = scaled.tolist()  # plain numbers: a tenth of the time of arrays of three
    for epoch in range(EPOCHS):
        rate = LEARNING_RATE / (1.0 + epoch)
        for i in rng.permutation(len(points)).tolist():
            x, y = points[i]
            step = rate * (constant + across * x + down * y)
            constant, across, down = constant - step, across - step * x, down - step * y
            length = math.hypot(across, down)
            across, down = across / length, down / length
    line = np.array([constant, across, down])
    w0 = line[0] * scale - line[1:] @ centre
    return np.array([w0, line[1], line[2], points_m[:, 2] @ np.ones(len(points_m)) / len(points_m)])


def _fit(line: DeckPoints, start: int, total: int, camera_m: Array, rng: np.random.Generator) -> LineFit:
    w0, w1, w2, z = fit_sgd(line.points_m, rng)
    xy, count = line.points_m[:, :2], len(line)
    middle = xy.mean(axis=0)
    middle = middle - (w0 + w1 * middle[0] + w2 * middle[1]) * np.array([w1, w2])
    azimuth = float(np.arctan2(-w1, w2))
    if (middle - camera_m[:2]) @ [np.cos(azimuth), np.sin(azimuth)] < 0:
        azimuth = float(wrap_angle(azimuth + np.pi))
    right = np.array([-np.sin(azimuth), np.cos(azimuth)])
    along = (xy - middle) @ [np.cos(azimuth), np.sin(azimuth)]
    gradient = np.zeros((3, count, 3))
    gradient[0, :, :2] = right / count
    gradient[1, :, :2] = (along / (along @ along))[:, None] * right
    gradient[2, :, 2] = 1 / count
    displacements = np.stack([line.pixel_m, line.depth_m])
    own = np.zeros((3, 2, total))
    own[:, :, start : start + count] = np.einsum("rnk,snk->rsn", gradient, displacements)
    sigma = np.sqrt(((displacements[..., :2] @ right) ** 2).sum(axis=0))
    across = ((xy - middle) @ right) / np.maximum(sigma, MIN_SIGMA_M)
    in_order = across[np.argsort(along)]
    own[:2] *= noise_inflation([in_order], CORRELATION, CORRELATION_SIGMA)[0]
    return LineFit(
        np.array([*middle, z]),
        azimuth,
        own.reshape(3, -1),
        np.einsum("rnk,cnk->rc", gradient, line.common_m),
        np.einsum("rnk,cnk->rc", gradient, line.relative_m),
    )
