"""What the camera should see of straight lines on one deck: residuals and their analytic Jacobian.

Unknowns are, for every line, its offset to its right, m, and its azimuth, rad; then the deck's z, m; then nuisances in
units of their own 1-sigma: attitude about world x and y, focal length, depth scale, deck slope along and across.

The aircraft's heading and position are no unknowns: in one frame an error of theirs moves the lines along with it and
nothing shows it, except its height against the deck's reported one, which that prior counts.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from deckline.config import Deck, FrameNoise
from deckline.localize.observations import MIN_DOWN, Observations

Array = NDArray[np.float64]
NUISANCES = 6
MIN_SIGMA_M = 1e-4  # keeps weights of what is known exactly finite
MIN_SIGMA_RAD = 1e-5
MIN_DEPTH_FRACTION = 1e-4
MIN_HEIGHT_M = 1e-2  # of the camera over the deck; a step below it is held there
DOWN = np.array([0.0, 0.0, 1.0])
# 1-sigma of the true angle between the lines in one frame, in units of the one that the deck's description states: one
# frame may not see both lines at the same place, so it trusts the description half as much.
PARALLEL_FACTOR = 2.0
CENTRE_SIGMA_M = 0.1  # of a painted centre line's place midway between the edge lines
CENTRE_SIGMA_RAD = float(np.deg2rad(0.05))  # and of its direction


@dataclass(frozen=True, eq=False)
class State:
    """The unknowns: lines, deck height and nuisances."""

    points_m: Array  # (L, 2) world x, y on every line
    azimuths_rad: Array  # (L,)
    z_m: float  # of the deck at the hub
    nuisances: Array  # (6,) in 1-sigma

    def step(self, step: Array) -> "State":
        """The state after a step (2 L + 1 + 6,) of the unknowns."""
        lines = step[: 2 * len(self.azimuths_rad)].reshape(-1, 2)
        return State(
            self.points_m + lines[:, :1] * rights(self.azimuths_rad),
            self.azimuths_rad + lines[:, 1],
            self.z_m + float(step[2 * len(lines)]),
            self.nuisances + step[2 * len(lines) + 1 :],
        )


@dataclass(frozen=True, eq=False)
class DeckPlane:
    """The reference of the deck's slopes: heights are z at the hub plus slopes times the offset from it."""

    hub_m: Array  # (2,) world
    axes: Array  # (2, 2) unit vectors along and across
    slopes: Array  # (2,) 1-sigma along and across, rad


@dataclass(frozen=True, eq=False)
class Terms:
    """Whitened residuals (measured less expected, in 1-sigma), and how expectations follow the unknowns."""

    residuals: Array  # (M,)
    jacobian: Array  # (M, P)


def rights(azimuths_rad: Array) -> Array:
    """Unit vectors (L, 2) to the right of lines."""
    return np.stack([-np.sin(azimuths_rad), np.cos(azimuths_rad)], axis=1)


def measurement_terms(view: Observations, state: State, deck: DeckPlane, noise: FrameNoise) -> tuple[Terms, Terms]:
    """Terms of all points' pixels (N,), normal to the line in the image, and of the existing depths (D,)."""
    attitude_error = Rotation.from_rotvec([*state.nuisances[:2] * noise.attitude_rad, 0.0]).as_matrix()
    arm = attitude_error @ (view.camera_m - view.body_m)
    turn = attitude_error @ view.turn
    stretch = 1.0 + state.nuisances[2] * noise.focal_fraction
    rays = view.rays / [stretch, stretch, 1.0]
    world = rays @ turn.T
    at = _Context(view, state, deck, noise, arm, turn, rays, world, stretch)
    return _pixel_terms(at), _depth_terms(at)


@dataclass(frozen=True, eq=False)
class _Context:
    view: Observations
    state: State
    deck: DeckPlane
    noise: FrameNoise
    arm: Array  # (3,) camera from body, world
    turn: Array  # (3, 3) world_from_camera as thought now
    rays: Array  # (N, 3) optical
    world: Array  # (N, 3)
    stretch: float  # of the focal length

    @property
    def camera_m(self) -> Array:
        return self.view.body_m + self.arm

    @property
    def slopes(self) -> Array:
        return self.state.nuisances[4:] * self.deck.slopes


def _pixel_terms(at: _Context) -> Terms:
    """n . ray = 0 for a ray to a line, n the normal of the plane through camera and line."""
    state, line = at.state, at.view.line
    count, noise, arm = len(state.azimuths_rad), at.noise, at.arm
    ways = (state.points_m - at.deck.hub_m) @ at.deck.axes.T  # (L, 2) from the hub, along and across
    heading = np.stack([np.cos(state.azimuths_rad), np.sin(state.azimuths_rad)], axis=1)
    climbs = heading @ at.deck.axes.T  # (L, 2) of a line, per slope
    point = np.column_stack([state.points_m, state.z_m + ways @ at.slopes]) - at.camera_m
    direction = np.column_stack([heading, climbs @ at.slopes])
    sideways = np.column_stack([-heading[:, 1], heading[:, 0], np.zeros(count)])
    down, rolled, pitched = (
        np.broadcast_to(v, (count, 3)) for v in (DOWN, [0.0, arm[2], -arm[1]], [-arm[2], 0.0, arm[0]])
    )
    normal, by_offset, by_azimuth, by_height, by_climb, by_roll, by_pitch = _cross(
        np.stack([point, sideways, point, down, point, rolled, pitched]),
        np.stack([direction, direction, sideways, direction, down, direction, direction]),
    )
    zero = np.zeros(count)
    by_roll = by_roll + np.column_stack([zero, normal[:, 2], -normal[:, 1]])
    by_pitch = by_pitch + np.column_stack([-normal[:, 2], zero, normal[:, 0]])
    by_slopes = [by_height * ways[:, k : k + 1] + by_climb * climbs[:, k : k + 1] for k in (0, 1)]
    changes = np.stack([by_offset, by_azimuth, by_height, by_roll, by_pitch, *by_slopes], axis=1)
    optical = (normal @ at.turn)[line]
    residual = (optical * at.rays).sum(axis=1)
    foot, sigma = _foot_points(at, optical, residual)
    gradient = np.einsum("nck,nk->nc", changes[line], foot @ at.turn.T)  # (N, 7) changes of n . ray
    jacobian = np.zeros((len(line), 2 * count + 1 + NUISANCES))
    rows = np.arange(len(line))
    jacobian[rows, 2 * line], jacobian[rows, 2 * line + 1] = gradient[:, 0], gradient[:, 1]
    jacobian[:, 2 * count] = gradient[:, 2]
    jacobian[:, 2 * count + 1 : 2 * count + 3] = gradient[:, 3:5] * noise.attitude_rad
    jacobian[:, 2 * count + 3] = (optical * foot)[:, :2].sum(axis=1) * (-noise.focal_fraction / at.stretch)
    jacobian[:, 2 * count + 5 :] = gradient[:, 5:] * at.deck.slopes
    return Terms(-residual / sigma, jacobian / sigma[:, None])


def _foot_points(at: _Context, optical: Array, residual: Array) -> tuple[Array, Array]:
    """The foot point (N, 3) of each ray on its line, and 1-sigma of n . ray (N,).

    Derivatives are taken at the foot point: at the noisy ray they would correlate with the residual and bias the fit.
    """
    steps = at.view.steps / at.stretch
    by_column = (optical[:, :2] * steps).sum(axis=1)
    by_row = optical[:, 1] * at.view.row_step
    variance = by_column**2 + by_row**2
    shift = steps * by_column[:, None]
    shift[:, 1] += by_row * at.view.row_step
    foot = at.rays.copy()
    foot[:, :2] -= shift * (residual / variance)[:, None]
    return foot, np.sqrt(variance)


def _depth_terms(at: _Context) -> Terms:
    """Logarithm of the distance to the deck along each ray that has a depth, against the measured one."""
    has = np.isfinite(at.view.log_depth)
    if not has.any():
        return Terms(np.zeros(0), np.zeros((0, 2 * len(at.state.azimuths_rad) + 1 + NUISANCES)))
    ray, count, arm = at.world[has], len(at.state.azimuths_rad), at.arm
    level = np.array([*-(at.slopes @ at.deck.axes), 1.0])  # the deck's normal
    down = np.array([*at.deck.hub_m, at.state.z_m]) - at.camera_m
    height, fall = max(float(level @ down), MIN_HEIGHT_M), np.maximum(ray @ level, MIN_DOWN)
    scale = 1.0 + at.state.nuisances[3] * at.noise.depth_scale
    expected = np.log(height / fall * scale)
    jacobian = np.zeros((len(ray), 2 * count + 1 + NUISANCES))
    jacobian[:, 2 * count] = 1.0 / height
    zero = np.zeros(len(ray))
    rotated = [np.column_stack([zero, -ray[:, 2], ray[:, 1]]), np.column_stack([ray[:, 2], zero, -ray[:, 0]])]
    arm_shift = [[0.0, -arm[2], arm[1]], [arm[2], 0.0, -arm[0]]]
    for k in (0, 1):
        change = -(level @ arm_shift[k]) / height - rotated[k] @ level / fall
        jacobian[:, 2 * count + 1 + k] = at.noise.attitude_rad * change
        tilted = np.array([*-at.deck.axes[k], 0.0])
        jacobian[:, 2 * count + 5 + k] = at.deck.slopes[k] * (tilted @ down / height - ray @ tilted / fall)
    zoomed = at.rays[has] * [1.0, 1.0, 0.0] @ (level @ at.turn)
    jacobian[:, 2 * count + 3] = at.noise.focal_fraction / at.stretch * zoomed / fall
    jacobian[:, 2 * count + 4] = at.noise.depth_scale / scale
    sigma = max(at.noise.depth_fraction, MIN_DEPTH_FRACTION)
    return Terms((at.view.log_depth[has] - expected) / sigma, jacobian / sigma)


def _cross(a: Array, b: Array) -> Array:
    """Cross products (..., 3); numpy's own takes ten times as long for a few vectors."""
    return a[..., [1, 2, 0]] * b[..., [2, 0, 1]] - a[..., [2, 0, 1]] * b[..., [1, 2, 0]]


def nuisance_terms(state: State) -> Terms:
    """Prior of the nuisances: zero mean, unit variance in their own 1-sigma."""
    lines = np.zeros((NUISANCES, 2 * len(state.azimuths_rad) + 1))
    return Terms(-state.nuisances, np.hstack([lines, np.eye(NUISANCES)]))


def height_term(state: State, deck_z_m: float | None, noise: FrameNoise) -> Terms:
    """Prior of the deck height: as the ship reports it; no row without a reported height."""
    size = 2 * len(state.azimuths_rad) + 1 + NUISANCES
    if deck_z_m is None:
        return Terms(np.zeros(0), np.zeros((0, size)))
    sigma = max(float(np.hypot(noise.deck_z_m, noise.position_m)), MIN_SIGMA_M)
    row = np.zeros((1, size))
    row[0, size - NUISANCES - 1] = 1 / sigma
    return Terms(np.array([(deck_z_m - state.z_m) / sigma]), row)


def parallel_sigma(deck: Deck) -> float:
    """1-sigma of the true angle between the lines, rad."""
    return max(PARALLEL_FACTOR * deck.angle_sigma_rad, MIN_SIGMA_RAD)


def deck_terms(names: tuple[str, ...], state: State, deck: Deck) -> Terms:
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
        return Terms(np.zeros(0), np.zeros((0, 2 * len(names) + 1 + NUISANCES)))
    return Terms(np.array([row[0] for row in rows]), np.stack([row[1] for row in rows]))


def _azimuth_row(state: State, shares: dict[int, float], expected: float, sigma: float) -> tuple[float, Array]:
    """A weighted sum of azimuths, whose weights add up to zero, against its expectation."""
    first = state.azimuths_rad[0]
    azimuths = np.arctan2(np.sin(state.azimuths_rad - first), np.cos(state.azimuths_rad - first))
    row = np.zeros(2 * len(azimuths) + 1 + NUISANCES)
    for k, share in shares.items():
        row[2 * k + 1] = share / sigma
    return (expected - sum(share * float(azimuths[k]) for k, share in shares.items())) / sigma, row


def _offset_row(state: State, shares: dict[int, float], expected: float, sigma: float) -> tuple[float, Array]:
    """A weighted sum of offsets across the lines' mean direction, at the middle of their points."""
    sigma = max(sigma, MIN_SIGMA_M)
    numbers = list(shares)
    along = np.array([np.cos(state.azimuths_rad[numbers]).sum(), np.sin(state.azimuths_rad[numbers]).sum()])
    along /= np.linalg.norm(along)
    across = np.array([-along[1], along[0]])
    middle = state.points_m[numbers].mean(axis=0)
    row, total = np.zeros(2 * len(state.azimuths_rad) + 1 + NUISANCES), 0.0
    for k, share in shares.items():
        heading = np.array([np.cos(state.azimuths_rad[k]), np.sin(state.azimuths_rad[k])])
        lever = float((middle - state.points_m[k]) @ along / (heading @ along))
        total += share * float((state.points_m[k] + lever * heading - middle) @ across)
        row[2 * k], row[2 * k + 1] = share / sigma, share * lever / sigma
    return (expected - total) / sigma, row
