"""A straight line through detected points, in the image."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deckline.geometry import Camera, distort, undistort
from deckline.types import LinePoints, PixelLine

Array = NDArray[np.float64]
SAMPLE_SIZE = 2  # points of one hypothesis
DRAWS = 60  # hypotheses a round
MAX_ROUNDS = 8  # rounds go on until one brings no lower error
THRESHOLD_PX = 4.0  # distance of inliers; for unsure points three times their 1-sigma, at most four times this
MIN_INLIERS = 6
MIN_INLIER_SHARE = 0.5  # of the detected points
MIN_LENGTH_PX = 4.0  # between the outermost inliers
MIN_SAMPLE_SPREAD_PX = 1.0  # extent of a sample
REFITS = 5  # of inliers and line in turn, after the draws


@dataclass(frozen=True, eq=False)
class WeightedPoints:
    """Points to draw samples from, in ideal pixels."""

    xy: Array  # (N, 2)
    weights: Array  # (N,)
    limits: Array  # (N,) largest distance of an inlier


def fit_pixel_line(points: LinePoints, camera: Camera, rng: np.random.Generator) -> PixelLine | None:
    """RANSAC line through one line's detected points, refitted by weighted total least squares on its inliers.

    Lens distortion bends straight lines. The fit therefore works in ideal pixels, those of the same camera without
    distortion: `coefficients` and `sigma_px` belong to these, `ends_px` to the real image.

    Args:
        points: detected points; those with no confidence or a number that is not finite are never inliers.
        rng: draws the samples; the same state gives the same line.

    Returns:
        The line, or None when too few points agree.

    Source: Li et al. 2024, section 3.2; M-estimator cost of MSAC, Torr and Zisserman 2000.
    """
    ideal = undistort(points.points_px, camera)
    usable = np.isfinite(ideal).all(axis=1) & (points.confidence > 0) & np.isfinite(points.sigma_px)
    index = np.flatnonzero(usable)
    if len(index) < MIN_INLIERS:
        return None
    sigma = np.maximum(points.sigma_px[index], 1e-3 * THRESHOLD_PX)
    data = WeightedPoints(
        ideal[index],
        points.confidence[index] / sigma**2,
        np.clip(3 * sigma, THRESHOLD_PX, 4 * THRESHOLD_PX),
    )
    line = _find_best_draw(data, rng)
    if line is None:
        return None
    line, inside = _refit(line, data)
    needed = max(MIN_INLIERS, MIN_INLIER_SHARE * len(points))
    ends = _find_ends(data.xy[inside], line)
    if inside.sum() < needed or np.linalg.norm(ends[0] - ends[1]) < MIN_LENGTH_PX:
        return None
    inliers = np.zeros(len(points), dtype=bool)
    inliers[index[inside]] = True
    return PixelLine(line, inliers, distort(ends, camera), _residual_sigma(data, inside, line))


def least_squares_line(xy: Array, weights: Array | None = None) -> Array:
    """Total least squares line a u + b v + c = 0 through points (N, 2), (3,) with a^2 + b^2 = 1.

    Raises:
        ValueError: fewer than two points, or points that coincide.
    """
    w = np.ones(len(xy)) if weights is None else weights
    if len(xy) < 2:
        raise ValueError(f"a line needs at least 2 points, got {len(xy)}")
    centre = w @ xy / w.sum()
    offsets = xy - centre
    if np.ptp(xy, axis=0).max() == 0:
        raise ValueError(f"{len(xy)} points coincide at {xy[0].tolist()}: no line through them")
    _, vectors = np.linalg.eigh((offsets * w[:, None]).T @ offsets)
    normal = vectors[:, 0]
    return np.array([normal[0], normal[1], -normal @ centre])


def _find_best_draw(data: WeightedPoints, rng: np.random.Generator) -> Array | None:
    """Rounds of draws until the error (squared distance, cut off at the threshold) stops falling."""
    best, best_error = None, np.inf
    for _ in range(MAX_ROUNDS):
        picks = rng.random((DRAWS, len(data.xy))).argpartition(SAMPLE_SIZE - 1, axis=1)[:, :SAMPLE_SIZE]
        lines = _sample_lines(data.xy[picks])
        if len(lines):
            distances = lines[:, :2] @ data.xy.T + lines[:, 2:]
            errors = np.minimum((distances / data.limits) ** 2, 1.0).sum(axis=1)
            i = int(errors.argmin())
            if errors[i] < best_error:
                best, best_error = lines[i], errors[i]
                continue
        if best is not None:
            break
    return best


def _sample_lines(samples: Array) -> Array:
    """Lines (S, 3) through the points of every sample (D, 2, 2); samples of coinciding points are left out."""
    differences = samples[:, 1] - samples[:, 0]
    apart = np.abs(differences).max(axis=1) >= MIN_SAMPLE_SPREAD_PX
    (du, dv), (u, v) = differences[apart].T, samples[apart, 0].T
    length = np.hypot(du, dv)
    return np.array([-dv / length, du / length, (dv * u - du * v) / length]).T


def _refit(line: Array, data: WeightedPoints) -> tuple[Array, NDArray[np.bool_]]:
    inside = np.abs(_distances(data.xy, line)) <= data.limits
    for _ in range(REFITS):
        if inside.sum() < MIN_INLIERS:
            break
        line = least_squares_line(data.xy[inside], data.weights[inside])
        updated = np.abs(_distances(data.xy, line)) <= data.limits
        if np.array_equal(updated, inside):
            break
        inside = updated
    return line, inside


def _distances(xy: Array, line: Array) -> Array:
    return xy @ line[:2] + line[2]


def _find_ends(xy: Array, line: Array) -> Array:
    """Nearest (lowest in the image) and farthest point, moved onto the line; (2, 2)."""
    if len(xy) == 0:
        return np.zeros((2, 2))
    down = np.array([-line[1], line[0]]) * (1.0 if line[0] >= 0 else -1.0)
    along = xy @ down
    ends = xy[[np.argmax(along), np.argmin(along)]]
    return ends - _distances(ends, line)[:, None] * line[:2]


def _residual_sigma(data: WeightedPoints, inside: NDArray[np.bool_], line: Array) -> float:
    """Weighted root mean square distance of the inliers, with two degrees of freedom less than inliers."""
    w, distance = data.weights[inside], _distances(data.xy[inside], line)
    return float(np.sqrt(w @ distance**2 / w.sum() * len(w) / max(len(w) - 2, 1)))
