"""A horizontal line w0 + w1 x + w2 y = 0, z = w3 on the deck, what noise moves it, and the paper's way to fit it."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deckline.geometry import wrap_angle
from deckline.localize.config import NoiseConfig
from deckline.localize.depth import DeckPoints
from deckline.localize.spread import inflation
from deckline.types import LineErrors

Array = NDArray[np.float64]
MIN_SIGMA_M = 1e-6  # keeps residuals of noiseless points finite


@dataclass(frozen=True, eq=False)
class LineFit:
    """A fitted line and what each noise source moves it by.

    Columns of the sensitivities are independent sources of 1-sigma each; fits of one frame share them, so their
    joint covariance is known. Rows: offset across the line to its right, m; azimuth, rad; z, m.
    """

    point_m: Array  # (3,)
    azimuth_rad: float
    own: Array  # (3, M) noise of the points, and what is known of the lines' lie
    common: Array  # (3, K) pose, calibration and deck
    relative: Array  # (3, K) the same as seen from the aircraft
    errors: LineErrors | None = None  # None: not known

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


def fit_alone(
    points: dict[str, DeckPoints], camera_m: Array, min_points: int, noise: NoiseConfig, rng: np.random.Generator
) -> dict[str, LineFit]:
    """The paper's lines: each alone, all its points alike, by stochastic gradient descent in the world.

    Sensitivities are those of the least-squares line that the descent goes to.

    Args:
        points: the points of each line; a line with fewer than `min_points` is left out.
        camera_m: (3,) the camera in the world; lines point away from it, in the direction of landing.
        min_points: points a line needs.
        noise: how far neighbouring points are expected to err alike.
        rng: order of the points in the descent.

    Source: paper, section on line fitting; SPEC section 4.4.
    """
    points = {side: p for side, p in points.items() if len(p) >= max(min_points, 3)}
    total = sum(len(p) for p in points.values())
    fits, first = {}, 0
    for side, line in points.items():
        fits[side] = _fit(line, first, total, camera_m, noise, rng)
        first += len(line)
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
    length = math.hypot(*along)
    constant, across, down = 0.0, -float(along[1]) / length, float(along[0]) / length
    points, shares = scaled.tolist(), (w / w.max()).tolist()  # plain numbers: a tenth of the time of arrays of three
    for epoch in range(epochs):
        rate = learning_rate / (1.0 + epoch)
        for i in rng.permutation(len(points)).tolist():
            x, y = points[i]
            step = rate * shares[i] * (constant + across * x + down * y)
            constant, across, down = constant - step, across - step * x, down - step * y
            length = math.hypot(across, down)
            across, down = across / length, down / length
    line = np.array([constant, across, down])
    w0 = line[0] * scale - line[1:] @ centre
    return np.array([w0, line[1], line[2], points_m[:, 2] @ w / w.sum()])


def _fit(
    line: DeckPoints, first: int, total: int, camera_m: Array, noise: NoiseConfig, rng: np.random.Generator
) -> LineFit:
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
    moved = np.stack([line.pixel_m, line.depth_m])
    own = np.zeros((3, 2, total))
    own[:, :, first : first + count] = np.einsum("rnk,snk->rsn", gradient, moved)
    sigma = np.sqrt(((moved[..., :2] @ right) ** 2).sum(axis=0))
    across = ((xy - middle) @ right) / np.maximum(sigma, MIN_SIGMA_M)
    in_order = across[np.argsort(along)]
    own[:2] *= inflation([in_order], noise.point_correlation, noise.point_correlation_sigma)[0]
    return LineFit(
        np.array([*middle, z]),
        azimuth,
        own.reshape(3, -1),
        np.einsum("rnk,cnk->rc", gradient, line.common_m),
        np.einsum("rnk,cnk->rc", gradient, line.relative_m),
    )
