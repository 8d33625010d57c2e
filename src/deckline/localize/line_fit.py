"""A horizontal line w0 + w1 x + w2 y = 0, z = w3 through points on the deck, with its covariance.

Points are far from equally good: one pixel is centimetres near the ramp and a metre at the far end. Each point
therefore counts by the inverse variance of its cross-track error, to which its pixel's and its depth's noise are
propagated; near points decide the offset, the spread decides the direction.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deckline.geometry import wrap_angle
from deckline.localize.depth import DeckPoints

Array = NDArray[np.float64]
REWEIGHTINGS = 6  # direction and weights depend on each other; they settle in three
MIN_SIGMA_M = 1e-6  # keeps the weights of noiseless points finite
MAX_CORRELATION = 0.9  # of neighbouring residuals that is still believed
HEIGHT_OUTLIER = 4.0  # standard deviations


@dataclass(frozen=True, eq=False)
class LineFit:
    """A fitted line and what each noise source moves it by.

    Columns of the sensitivities are independent sources of 1-sigma each; fits of one frame share them, so their
    joint covariance is known. Rows: offset across the line to its right, m; azimuth, rad; z, m.
    """

    point_m: Array  # (3,)
    azimuth_rad: float
    own: Array  # (3, M) noise of the points
    common: Array  # (3, K) pose and deck
    relative: Array  # (3, K) pose and deck as seen from the aircraft

    @property
    def direction(self) -> Array:
        return np.array([np.cos(self.azimuth_rad), np.sin(self.azimuth_rad)])

    @property
    def right(self) -> Array:
        return np.array([-np.sin(self.azimuth_rad), np.cos(self.azimuth_rad)])

    @property
    def covariance(self) -> Array:
        return self.own @ self.own.T + self.common @ self.common.T

    @property
    def relative_covariance(self) -> Array:
        return self.own @ self.own.T + self.relative @ self.relative.T


def fit_lines(points: dict[str, DeckPoints], camera_m: Array, min_points: int) -> dict[str, LineFit]:
    """Fit every line of one frame. The lines lie on one deck, so all points together decide its height.

    Points off the deck by more than four standard deviations are left out; a line with fewer than `min_points`
    remaining is left out as well.

    Args:
        points: the points of each line; at least one line.
        camera_m: (3,) the camera in the world; lines point away from it, in the direction of landing.
        min_points: points a line needs.
    """
    points = _on_deck(points)
    points = {side: p for side, p in points.items() if len(p) >= max(min_points, 3)}
    if not points:
        return {}
    merged = _merge(list(points.values()))
    height, height_gradient, height_inflation = _height(merged)
    fits, first = {}, 0
    for side, line in points.items():
        mine = slice(first, first + len(line))
        first += len(line)
        fits[side] = _fit(line, merged, mine, camera_m, height, height_gradient, height_inflation)
    return fits


def weighted_line(xy_m: Array, weights: Array) -> tuple[Array, float]:
    """Weighted total least squares line in the plane: centre (2,) and azimuth, rad, up to half a turn.

    Minimises sum w_i d_i^2 over the perpendicular distances d_i in closed form.

    Raises:
        ValueError: fewer than two points.
    """
    if len(xy_m) < 2:
        raise ValueError(f"a line needs at least 2 points, got {len(xy_m)}")
    centre = weights @ xy_m / weights.sum()
    offsets = xy_m - centre
    _, vectors = np.linalg.eigh((offsets * weights[:, None]).T @ offsets)
    return centre, float(np.arctan2(vectors[1, 1], vectors[0, 1]))


def fit_sgd(
    points_m: Array,
    rng: np.random.Generator,
    weights: Array | None = None,
    epochs: int = 400,
    learning_rate: float = 0.5,
) -> Array:
    """The paper's fit: w <- w - eta dL/dw on the squared distance, one point at a time; (w0, w1, w2, w3).

    w1^2 + w2^2 = 1 is restored after every step. Points are centred and scaled first, and eta falls as 1 / epoch,
    without which the steps never settle.

    Args:
        points_m: (N, 3) world points, metres.
        rng: order of the points.
        weights: (N,) weight of each squared distance; all equal by default.
        epochs: passes over the points.
        learning_rate: eta of the first pass, per mean weight, on points scaled to unit size.

    Raises:
        ValueError: fewer than two points.
    Source: paper, section on line fitting; SPEC section 4.4.
    """
    if len(points_m) < 2:
        raise ValueError(f"a line needs at least 2 points, got {len(points_m)}")
    w = np.ones(len(points_m)) if weights is None else weights / weights.mean()
    centre = points_m[:, :2].mean(axis=0)
    offsets = points_m[:, :2] - centre
    scale = float(np.abs(offsets).max())
    scaled = offsets / scale
    along = scaled[-1] - scaled[0]
    line = np.array([0.0, -along[1], along[0]]) / np.hypot(*along)
    for epoch in range(epochs):
        rate = learning_rate / (1.0 + epoch) / w.max()
        for i in rng.permutation(len(scaled)):
            row = np.array([1.0, *scaled[i]])
            line = line - rate * w[i] * (line @ row) * row
            line[1:] /= np.hypot(line[1], line[2])
    w0 = line[0] * scale - line[1:] @ centre
    return np.array([w0, line[1], line[2], points_m[:, 2] @ w / w.sum()])


def _on_deck(points: dict[str, DeckPoints]) -> dict[str, DeckPoints]:
    """Leave out points whose height contradicts the deck's; in coarse mode all lie on it."""
    heights = np.concatenate([p.points_m[:, 2] for p in points.values()])
    if len(heights) == 0:
        return points
    middle = np.median(heights)
    spread = 1.4826 * np.median(np.abs(heights - middle))
    kept = {}
    for side, p in points.items():
        sigma = np.sqrt(p.depth_m[:, 2] ** 2 + (p.common_m[..., 2] ** 2).sum(axis=0))
        limit = HEIGHT_OUTLIER * np.maximum(np.maximum(sigma, spread), MIN_SIGMA_M)
        kept[side] = p.take(np.abs(p.points_m[:, 2] - middle) <= limit)
    return kept


def _height(points: DeckPoints) -> tuple[float, Array, float]:
    """Deck z, its gradient (N, 3) by every point, and how much the scatter exceeds the assumed depth noise."""
    own = points.depth_m[:, 2]
    # Tilted by a wrong attitude, far points are worse than their depth noise says.
    variance = own**2 + (points.common_m[:3, :, 2] ** 2).sum(axis=0) + MIN_SIGMA_M**2
    share = 1 / variance / (1 / variance).sum()
    z = points.points_m[:, 2]
    height = float(share @ z)
    gradient = np.column_stack([np.zeros((len(z), 2)), share])
    if not own.any():
        return height, gradient, 1.0
    # The tilt is counted among the common errors; here only scatter about the tilted plane counts.
    design = np.column_stack([np.ones(len(z)), points.points_m[:, :2] - points.points_m[:, :2].mean(axis=0)])
    scale = 1 / np.hypot(own, MIN_SIGMA_M)
    fitted = design @ np.linalg.lstsq(design * scale[:, None], z * scale, rcond=None)[0]
    chi2 = (((z - fitted) * scale) ** 2).sum() / max(len(z) - 3, 1)
    return height, gradient, float(np.sqrt(max(chi2, 1.0)))


def _fit(
    line: DeckPoints,
    merged: DeckPoints,
    mine: slice,
    camera_m: Array,
    height: float,
    height_gradient: Array,
    height_inflation: float,
) -> LineFit:
    xy = line.points_m[:, :2]
    weights = np.ones(len(xy))
    for _ in range(REWEIGHTINGS):
        centre, azimuth = weighted_line(xy, weights)
        right = np.array([-np.sin(azimuth), np.cos(azimuth)])
        noise = np.stack([line.pixel_m[:, :2] @ right, line.depth_m[:, :2] @ right])
        weights = 1 / ((noise**2).sum(axis=0) + MIN_SIGMA_M**2)
    if (centre - camera_m[:2]) @ [np.cos(azimuth), np.sin(azimuth)] < 0:
        azimuth, right = float(wrap_angle(azimuth + np.pi)), -right
    along = (xy - centre) @ [np.cos(azimuth), np.sin(azimuth)]
    across = (xy - centre) @ right
    gradient = np.zeros((3, len(merged), 3))
    gradient[0, mine, :2] = (weights / weights.sum())[:, None] * right
    gradient[1, mine, :2] = (weights * along / (weights @ along**2))[:, None] * right
    gradient[2] = height_gradient
    own = np.concatenate(
        [np.einsum("rnk,nk->rn", gradient, merged.pixel_m), np.einsum("rnk,nk->rn", gradient, merged.depth_m)], axis=1
    )
    own[:2] *= _inflation(across * np.sqrt(weights), along)
    own[2] *= height_inflation
    return LineFit(
        np.array([*centre, height]),
        float(wrap_angle(azimuth)),
        own,
        np.einsum("rnk,cnk->rc", gradient, merged.common_m),
        np.einsum("rnk,cnk->rc", gradient, merged.relative_m),
    )


def _inflation(residuals: Array, along: Array) -> float:
    """Factor on 1-sigma for residuals (N,), in expected 1-sigma, that are larger or less independent than assumed.

    Neighbouring rows of a detector err together; N points with correlation r between neighbours are worth
    N (1 - r) / (1 + r). A correlation that chance explains is not counted.
    """
    ordered = residuals[np.argsort(along)]
    n = len(ordered)
    energy = float(ordered @ ordered)
    chi2 = energy / max(n - 2, 1)
    correlation = float(ordered[1:] @ ordered[:-1]) / energy if energy > 0 else 0.0
    if chi2 < 1e-6 or correlation < 2 / np.sqrt(n):
        correlation = 0.0
    correlation = min(correlation, MAX_CORRELATION)
    return float(np.sqrt(max(chi2, 1.0) * (1 + correlation) / (1 - correlation)))


def _merge(lines: list[DeckPoints]) -> DeckPoints:
    return DeckPoints(
        np.concatenate([p.index for p in lines]),
        np.concatenate([p.points_m for p in lines]),
        np.concatenate([p.pixel_m for p in lines]),
        np.concatenate([p.depth_m for p in lines]),
        np.concatenate([p.common_m for p in lines], axis=1),
        np.concatenate([p.relative_m for p in lines], axis=1),
    )
