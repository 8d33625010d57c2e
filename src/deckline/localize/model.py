"""Measurement model of straight lines on one deck: residuals and their analytic Jacobian.

Unknowns are, for every line, its offset to its right, m, and its azimuth, rad; then the deck's z, m; then nuisances in
units of their own 1-sigma: attitude about world x and y, focal length, depth scale, deck slope along and across.

The aircraft's heading and position are not observable in one frame: their errors move the lines with them. Only the
error of its height is observable, against the reported deck height; the prior of that height includes it.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deckline.config import Deck, FrameNoise
from deckline.geometry import cross
from deckline.localize.depth import MIN_DOWN
from deckline.localize.observations import Observations

Array = NDArray[np.float64]
NUISANCES = 6
MIN_SIGMA_M = 1e-4  # bounds the weights of what is known exactly
MIN_SIGMA_RAD = 1e-5
MIN_DEPTH_FRACTION = 1e-4
MIN_HEIGHT_M = 1e-2  # of the camera over the deck; smaller heights are clamped
MIN_SCALE = 1e-2  # of focal length and depth over what is stated; a wild step may want less
DOWN = np.array([0.0, 0.0, 1.0])
# Factor on the stated 1-sigma of the angle between the lines: one frame may not see both over the same stretch.
PARALLEL_FACTOR = 2.0
CENTRE_SIGMA_M = 0.1  # of a painted centre line's place midway between the edge lines
CENTRE_SIGMA_RAD = float(np.deg2rad(0.05))  # and of its direction


@dataclass(frozen=True, eq=False)
class FitState:
    """The unknowns: lines, deck height and nuisances."""

    points_m: Array  # (L, 2) world x, y on every line
    azimuths_rad: Array  # (L,)
    z_m: float  # of the deck at the origin of its plane
    nuisances: Array  # (6,) in 1-sigma

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return 2 * len(self.azimuths_rad) + 1 + NUISANCES

    def select(self, numbers: list[int]) -> "FitState":
        """The state of some of the lines."""
        return replace(self, points_m=self.points_m[numbers], azimuths_rad=self.azimuths_rad[numbers])

    def step(self, step: Array) -> "FitState":
        """The state after a step (2 L + 1 + 6,) of the unknowns."""
        lines = step[: 2 * len(self.azimuths_rad)].reshape(-1, 2)
        return FitState(
            self.points_m + lines[:, :1] * right_vectors(self.azimuths_rad),
            self.azimuths_rad + lines[:, 1],
            self.z_m + float(step[2 * len(lines)]),
            self.nuisances + step[2 * len(lines) + 1 :],
        )


@dataclass(frozen=True, eq=False)
class DeckPlane:
    """The sloping deck: z is that at the origin plus slopes times the offset from the origin."""

    origin_m: Array  # (2,) world
    axes: Array  # (2, 2) unit vectors along and across
    slopes: Array  # (2,) 1-sigma along and across, rad


@dataclass(frozen=True, eq=False)
class Terms:
    """Normalised residuals (measured less expected, in 1-sigma) and the Jacobian of the expectations."""

    residuals: Array  # (M,)
    jacobian: Array  # (M, P)


def empty_terms(state: FitState) -> Terms:
    return Terms(np.zeros(0), np.zeros((0, state.size)))


def concatenate(*terms: Terms) -> Terms:
    return Terms(np.concatenate([t.residuals for t in terms]), np.concatenate([t.jacobian for t in terms]))


def right_vectors(azimuths_rad: Array) -> Array:
    """Unit vectors (L, 2) to the right of lines."""
    return np.array([-np.sin(azimuths_rad), np.cos(azimuths_rad)]).T


def linearize_measurements(observations: Observations, state: FitState, plane: DeckPlane, noise: FrameNoise) -> Terms:
    """Terms of all points' pixels (N,), normal to the line in the image, then of the existing depths (D,)."""
    attitude_error = tilt_matrix(*state.nuisances[:2] * noise.attitude_rad)
    lever_arm = attitude_error @ (observations.camera_m - observations.body_m)
    rotation = attitude_error @ observations.rotation
    focal_scale = max(1.0 + float(state.nuisances[2]) * noise.focal_fraction, MIN_SCALE)
    rays = observations.rays / np.array([focal_scale, focal_scale, 1.0])
    context = Linearization(observations, state, plane, noise, lever_arm, rotation, rays, focal_scale)
    pixels = _linearize_pixels(context)
    return concatenate(pixels, _linearize_depths(context)) if observations.has_depth.any() else pixels


@dataclass(frozen=True, eq=False)
class Linearization:
    """The state at which the measurements are linearized, and what follows from it."""

    observations: Observations
    state: FitState
    plane: DeckPlane
    noise: FrameNoise
    lever_arm: Array  # (3,) camera from body, world
    rotation: Array  # (3, 3) world_from_camera of the state
    rays: Array  # (N, 3) optical
    focal_scale: float  # true focal length over the stated one

    @property
    def camera_m(self) -> Array:
        return self.observations.body_m + self.lever_arm

    @property
    def slopes(self) -> Array:
        return self.state.nuisances[4:] * self.plane.slopes


def _linearize_pixels(context: Linearization) -> Terms:
    """n . ray = 0 for a ray to a line, n the normal of the plane through camera and line."""
    state, line, noise = context.state, context.observations.line, context.noise
    normals, changes = _linearize_normals(context)
    optical = (normals @ context.rotation)[line]
    residual = np.einsum("nk,nk->n", optical, context.rays)
    closest, sigma = _project_on_lines(context, optical, residual)
    rows, count = np.arange(len(line)), len(state.azimuths_rad)
    products = changes @ context.rotation @ closest.T  # (7, L, N) changes of every line's n . ray
    units = np.array([1.0, 1.0, 1.0, noise.attitude_rad, noise.attitude_rad, *context.plane.slopes])
    gradient = products[:, line, rows] * (units[:, None] / sigma)
    by_focal = np.einsum("nk,nk->n", optical[:, :2], closest[:, :2]) * (-noise.focal_fraction / context.focal_scale)
    jacobian = np.zeros((len(line), state.size))
    jacobian[rows, 2 * line], jacobian[rows, 2 * line + 1] = gradient[:2]
    jacobian[:, 2 * count : 2 * count + 3] = gradient[2:5].T
    jacobian[:, 2 * count + 3] = by_focal / sigma
    jacobian[:, 2 * count + 5 :] = gradient[5:].T
    return Terms(-residual / sigma, jacobian)


def _linearize_normals(context: Linearization) -> tuple[Array, Array]:
    """Normals (L, 3) of the planes through camera and lines, and their changes (7, L, 3).

    The changes are those by offset, azimuth, height, attitude about x and y, slope along and across.
    """
    state, lever_arm, axes = context.state, context.lever_arm, context.plane.axes
    offsets = (state.points_m - context.plane.origin_m) @ axes.T  # (L, 2) along and across
    right = right_vectors(state.azimuths_rad)
    heading = np.array([right[:, 1], -right[:, 0]]).T
    gains = heading @ axes.T  # (L, 2) of a line, per slope
    point, direction, lateral = np.zeros((3, len(right), 3))
    point[:, :2], point[:, 2] = state.points_m, state.z_m + offsets @ context.slopes
    point -= context.camera_m
    direction[:, :2], direction[:, 2], lateral[:, :2] = heading, gains @ context.slopes, right
    # Factors of the normal, and of its changes by offset, azimuth, height, slope gain, the lever arm in roll and pitch.
    first, second = np.empty((2, 7, len(right), 3))
    first[[0, 2, 4]], first[1], first[3] = point, lateral, DOWN
    first[5], first[6] = (0.0, lever_arm[2], -lever_arm[1]), (-lever_arm[2], 0.0, lever_arm[0])
    second[:], second[2], second[4] = direction, lateral, DOWN
    normal, by_offset, by_azimuth, by_height, by_gain, by_roll, by_pitch = cross(first, second)
    by_roll[:, 1] += normal[:, 2]
    by_roll[:, 2] -= normal[:, 1]
    by_pitch[:, 0] -= normal[:, 2]
    by_pitch[:, 2] += normal[:, 0]
    by_slopes = by_height * offsets.T[..., None] + by_gain * gains.T[..., None]
    return normal, np.array([by_offset, by_azimuth, by_height, by_roll, by_pitch, *by_slopes])


def tilt_matrix(x_rad: float, y_rad: float) -> Array:
    """Rotation (3, 3) by the rotation vector (x, y, 0). Source: Rodrigues' formula."""
    half = math.hypot(x_rad, y_rad) / 2
    sinc = math.sin(half) / half if half else 1.0
    sine, cosine = sinc * math.cos(half), sinc**2 / 2  # sin(a) / a, (1 - cos(a)) / a^2 of the angle a
    x2, y2, xy = cosine * x_rad**2, cosine * y_rad**2, cosine * x_rad * y_rad
    x, y = sine * x_rad, sine * y_rad
    return np.array([[1 - y2, xy, y], [xy, 1 - x2, -x], [-y, x, 1 - x2 - y2]])


def _project_on_lines(context: Linearization, optical: Array, residual: Array) -> tuple[Array, Array]:
    """The point (N, 3) of each line closest to a ray, and 1-sigma of n . ray (N,).

    Derivatives are taken there: at the noisy ray they would correlate with the residual and bias the fit.
    """
    steps = context.observations.steps / context.focal_scale
    by_column = np.einsum("nk,nk->n", optical[:, :2], steps)
    by_row = optical[:, 1] * context.observations.row_step
    variance = by_column**2 + by_row**2
    shift = steps * by_column[:, None]
    shift[:, 1] += by_row * context.observations.row_step
    closest = context.rays.copy()
    closest[:, :2] -= shift * (residual / variance)[:, None]
    return closest, np.sqrt(variance)


def _linearize_depths(context: Linearization) -> Terms:
    """Logarithm of the distance to the deck along each ray with a depth, against the measured one."""
    has_depth, lever_arm = context.observations.has_depth, context.lever_arm
    optical, count = context.rays[has_depth], len(context.state.azimuths_rad)
    ray = optical @ context.rotation.T
    normal = np.array([*-(context.slopes @ context.plane.axes), 1.0])  # the deck's normal
    down = np.array([*context.plane.origin_m, context.state.z_m]) - context.camera_m
    height, descent = max(float(normal @ down), MIN_HEIGHT_M), np.maximum(ray @ normal, MIN_DOWN)
    scale = max(1.0 + context.state.nuisances[3] * context.noise.depth_scale, MIN_SCALE)
    expected = np.log(height / descent * scale)
    jacobian = np.zeros((len(ray), context.state.size))
    jacobian[:, 2 * count] = 1.0 / height
    zero = np.zeros(len(ray))
    rotated = [np.column_stack([zero, -ray[:, 2], ray[:, 1]]), np.column_stack([ray[:, 2], zero, -ray[:, 0]])]
    lever_arm_change = [[0.0, -lever_arm[2], lever_arm[1]], [lever_arm[2], 0.0, -lever_arm[0]]]
    for k in (0, 1):
        change = -(normal @ lever_arm_change[k]) / height - rotated[k] @ normal / descent
        jacobian[:, 2 * count + 1 + k] = context.noise.attitude_rad * change
        tilt = np.array([*-context.plane.axes[k], 0.0])
        jacobian[:, 2 * count + 5 + k] = context.plane.slopes[k] * (tilt @ down / height - ray @ tilt / descent)
    by_focal = optical[:, :2] @ (normal @ context.rotation)[:2]
    jacobian[:, 2 * count + 3] = context.noise.focal_fraction / context.focal_scale * by_focal / descent
    jacobian[:, 2 * count + 4] = context.noise.depth_scale / scale
    sigma = max(context.noise.depth_fraction, MIN_DEPTH_FRACTION)
    return Terms((context.observations.log_depth[has_depth] - expected) / sigma, jacobian / sigma)


def linearize_state_prior(state: FitState, deck_z_m: float | None, noise: FrameNoise) -> Terms:
    """Priors of the deck height, one row where it is reported, and of the nuisances: zero, 1 in their own 1-sigma."""
    rows = NUISANCES + (deck_z_m is not None)
    residuals, jacobian = np.empty(rows), np.zeros((rows, state.size))
    residuals[-NUISANCES:] = -state.nuisances
    jacobian[-NUISANCES:, -NUISANCES:] = np.eye(NUISANCES)
    if deck_z_m is not None:
        sigma = max(math.hypot(noise.deck_z_m, noise.position_m), MIN_SIGMA_M)
        residuals[0], jacobian[0, -NUISANCES - 1] = (deck_z_m - state.z_m) / sigma, 1 / sigma
    return Terms(residuals, jacobian)


def parallel_sigma(deck: Deck) -> float:
    """1-sigma of the true angle between the lines, rad."""
    return max(PARALLEL_FACTOR * deck.angle_sigma_rad, MIN_SIGMA_RAD)


def linearize_deck_prior(names: tuple[str, ...], state: FitState, deck: Deck) -> Terms:
    """Prior of the lines' geometry: angle, spacing, and the centre line's place between them."""
    pairs = {name: k for k, name in enumerate(names)}
    parallel, width, angle = parallel_sigma(deck), deck.width_m, deck.angle_rad
    rows = []
    if {"left", "right"} <= set(pairs):
        left, right = pairs["left"], pairs["right"]
        rows.append(_azimuth_row(state, {right: 1.0, left: -1.0}, angle, parallel))
        if width is not None:
            rows.append(_offset_row(state, {right: 1.0, left: -1.0}, width, deck.width_sigma_m))
    if "centre" in pairs:
        centre = pairs["centre"]
        sides = [pairs[name] for name in ("left", "right") if name in pairs]
        both = len(sides) == 2
        sign = 0.0 if both else (1.0 if "left" in pairs else -1.0)
        between = {centre: 1.0} | {side: -1.0 / len(sides) for side in sides}
        azimuth_sigma = CENTRE_SIGMA_RAD if both else float(np.hypot(CENTRE_SIGMA_RAD, parallel / 2))
        rows.append(_azimuth_row(state, between, sign * angle / 2, max(azimuth_sigma, MIN_SIGMA_RAD)))
        if both or width is not None:
            half = sign * (width or 0.0) / 2
            sigma = CENTRE_SIGMA_M if both else np.hypot(CENTRE_SIGMA_M, deck.width_sigma_m)
            rows.append(_offset_row(state, between, half, float(sigma)))
    if not rows:
        return empty_terms(state)
    return Terms(np.array([row[0] for row in rows]), np.stack([row[1] for row in rows]))


def _azimuth_row(state: FitState, shares: dict[int, float], expected: float, sigma: float) -> tuple[float, Array]:
    """A weighted sum of azimuths, whose weights add up to zero, against its expectation."""
    first, row, total = float(state.azimuths_rad[0]), np.zeros(state.size), 0.0
    for k, share in shares.items():
        total += share * math.remainder(float(state.azimuths_rad[k]) - first, math.tau)
        row[2 * k + 1] = share / sigma
    return (expected - total) / sigma, row


def _offset_row(state: FitState, shares: dict[int, float], expected: float, sigma: float) -> tuple[float, Array]:
    """A weighted sum of offsets across the lines' mean direction, at the middle of their points."""
    sigma = max(sigma, MIN_SIGMA_M)
    numbers, weights = np.array(list(shares)), np.array(list(shares.values()))
    azimuths, points = state.azimuths_rad[numbers], state.points_m[numbers]
    headings = np.array([np.cos(azimuths), np.sin(azimuths)]).T
    along = headings.sum(axis=0)
    along /= math.hypot(*along)
    ahead = points.mean(axis=0) - points  # from each line's point to the middle
    levers = ahead @ along / (headings @ along)
    offsets = (levers[:, None] * headings - ahead) @ np.array([-along[1], along[0]])
    row = np.zeros(state.size)
    row[2 * numbers], row[2 * numbers + 1] = weights / sigma, weights * levers / sigma
    return (expected - float(weights @ offsets)) / sigma, row
