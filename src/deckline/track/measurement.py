"""One frame's lines as a measurement of the filter: innovation, design matrix, noise, and the gate before the update.

Errors that all frames share (attitude, deck height, depth scale, focal length, a late pose) and the deck's motion are
states of the filter; only the rest averages over frames. A line carries its sensitivities to them. Where it does not,
it is modelled as a line through points that were each placed in the world alone.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deckline.config import RunConfig
from deckline.geometry import wrap_angle
from deckline.probability import chi2_gate
from deckline.track.filter import SIGN
from deckline.track.motion import Pose
from deckline.track.states import MIN_OWN_SHARE, MIN_OWN_SIGMA, FilterState, States, error_sigmas
from deckline.types import SIDES, DepthMode, Diagnostic, Diagnostics, Reason, RunwayLine

Array = NDArray[np.float64]
MIN_HEIGHT_M = 0.5  # of the camera above the deck, below which sensitivities are not valid
MIN_SLOPE_GAIN = 0.05  # share of a slope that a frame must show for its slope to be used
DOWN = np.array([0.0, 0.0, 1.0, 0.0, 0.0])  # of offset, azimuth, z and slopes


@dataclass(frozen=True, eq=False)
class Measurement:
    """Rows of a filter update: offset and azimuth of each line that was seen, the deck's height and slopes once."""

    sides: tuple[str, ...]
    innovation: Array  # (m,) measured minus predicted: offset, m, and azimuth, rad, of every side; z, m; slopes, rad
    design: Array  # (m, 20)
    noise: Array  # (m, m)
    x_m: float  # mean place along the line where it was measured

    def rows(self, name: str) -> list[int]:
        """Rows of "left", "right" or "height"."""
        if name == "height":
            return list(range(2 * len(self.sides), len(self.innovation)))
        return [2 * self.sides.index(name) + i for i in (0, 1)]

    def rows_by_reason(self) -> dict[Reason, list[int]]:
        """Rows of what was measured, by the reason with which it is left out: LEFT, RIGHT, HEIGHT."""
        return {NAMES[name][0]: self.rows(name) for name in (*self.sides, "height")}

    def subset(self, rows: list[int]) -> "Measurement":
        """The measurement with these rows alone; `sides` stay the same."""
        noise = self.noise[np.ix_(rows, rows)]
        return Measurement(self.sides, self.innovation[rows], self.design[rows], noise, self.x_m)


def measure(
    state: FilterState, lines: dict[str, RunwayLine], mode: DepthMode, pose: Pose, config: RunConfig
) -> Measurement:
    """The measurement by the edge lines among `lines`, at least one.

    Args:
        state: predicted to the frame's time.
        lines: world, as localization gives them.
        mode: FINE or COARSE: decides how shared errors act on lines that carry no sensitivities.
        pose: of the camera in this frame.
    """
    sides = tuple(side for side in SIDES if side in lines)
    hub = np.mean([state.local(lines[side].point_m) for side in sides], axis=0)
    parts = [_linearize_line(state, lines[side], side, mode, pose, hub, config) for side in sides]
    innovation, design, white, own = (_stack(part) for part in zip(*parts, strict=True))
    noise = _regularise(own @ own.T) + white @ white.T
    return Measurement(sides, innovation[:, 0], design, noise, float(hub[0]))


def _stack(parts: tuple[Array, ...]) -> Array:
    """Offset and azimuth of every line, then the mean of all else: a frame has one height and one pair of slopes."""
    return np.concatenate([*(part[:2] for part in parts), np.mean([part[2:] for part in parts], axis=0)])


def _linearize_line(
    state: FilterState, line: RunwayLine, side: str, mode: DepthMode, pose: Pose, hub: Array, config: RunConfig
) -> tuple[Array, Array, Array, Array]:
    """Residual (K, 1), design (K, 20), the pose's white noise (K, 5) and own noise (K, M) of one line.

    K rows: offset, azimuth, z, and slopes where they were measured.
    """
    sign = SIGN[side]
    x, y, z = state.local(line.point_m)
    expected = sign / 2 * (state.mean[States.SPACING] + state.mean[States.ANGLE] * x)
    azimuth = float(wrap_angle(line.azimuth_rad - state.azimuth_rad - sign / 2 * state.mean[States.ANGLE]))
    slopes = np.zeros(2) if line.errors is None else line.errors.slopes_rad
    residual = np.array([y - expected, azimuth, z, *slopes])
    camera = state.local(pose.position_m)
    ahead = np.array([x - camera[0], expected - camera[1], max(z - camera[2], MIN_HEIGHT_M)])
    effects, own = _effects_and_own(state, line, side, ahead, mode, config)
    # An error of heading or of lateral position moves the line with the aircraft; one of height does unless the
    # reported deck height is trusted more than the aircraft's.
    rigid = np.column_stack([effects[:, :2], [ahead[0], 1.0, 0, 0, 0], [1.0, 0, 0, 0, 0], DOWN - effects[:, 2]])
    design = np.zeros((5, States.SIZE))
    design[0, [States.OFFSET, States.AZIMUTH, States.SPACING, States.ANGLE]] = 1.0, x, sign / 2, sign / 2 * x
    design[1, [States.AZIMUTH, States.ANGLE]] = 1.0, sign / 2
    design[2, States.HEIGHT] = 1.0
    design[:, [States.ATTITUDE_X, States.ATTITUDE_Y, States.DECK, States.FOCAL, States.SCALE]] = effects[:, :5]
    rises = np.array([[1.0, x, expected], [1.0, hub[0], hub[1]]])  # by heave, pitch, roll: at the line, and midway
    design[:, [States.HEAVE, States.PITCH, States.ROLL]] = np.outer(DOWN, rises[0]) - np.outer(effects[:, 2], rises[1])
    design[:, [States.PITCH, States.ROLL]] += effects[:, 5:]
    design[[3, 4], [States.PITCH, States.ROLL]] += 1.0
    axes = np.stack([state.along, state.right, DOWN[:3]])
    motion = np.concatenate([axes @ pose.turn_rate_rad_s, axes[1:] @ pose.velocity_m_s])  # a second's turn and shift
    design[:, States.DELAY] = -rigid @ motion
    design[0, States.LEFT if side == "left" else States.RIGHT] = 1.0
    residual -= design[:, States.DISTURBANCES] @ state.mean[States.DISTURBANCES]
    s = config.sensors
    white = rigid * np.array([s.attitude_white_rad] * 3 + [s.position_white_m] * 2)
    # Only a depth camera measures slopes; without it they follow from the assumed directions of the lines.
    rows = [0, 1, 2, *(k for k in (3, 4) if mode is DepthMode.FINE and 1 + effects[k, 2 + k] > MIN_SLOPE_GAIN)]
    return residual[rows, None], design[rows], white[rows], own[rows]


def _effects_and_own(
    state: FilterState, line: RunwayLine, side: str, ahead_m: Array, mode: DepthMode, config: RunConfig
) -> tuple[Array, Array]:
    """Effects of shared errors on a line, (5, 7) as in `LineErrors` but in its own axes, and its own noise (5, M).

    Args:
        ahead_m: (3,) from the camera to the line's measured point, along, right, down.
    """
    if line.errors is not None:
        cos, sin = state.along[:2]
        effects = line.errors.effects.copy()
        effects[:, :2] = effects[:, :2] @ [[cos, -sin], [sin, cos]]
        return effects, np.hstack([line.errors.own, MIN_OWN_SIGMA * np.eye(5)])
    effects = _point_effects(ahead_m, mode)
    about_x, about_y, deck, scale, focal = error_sigmas(config)[:5]
    rest = _own_covariance(line.aircraft_covariance, effects[:3, :5] * [about_x, about_y, deck, focal, scale])
    # Square root with one column for z, which both lines share: a frame's height is not better by the second line.
    root = np.linalg.cholesky(rest[::-1, ::-1])[::-1, ::-1]
    own = np.zeros((5, 5))
    own[:3, [0, 1, 4] if side == "left" else [2, 3, 4]] = root
    return effects, own


def _point_effects(ahead_m: Array, mode: DepthMode) -> Array:
    """Effects (5, 7) on a line through points that were each placed in the world alone, which show no slopes."""
    x, y, h = ahead_m
    effects = np.zeros((5, 7))
    effects[[3, 4], [5, 6]] = -1.0
    if mode is DepthMode.FINE:
        effects[:3, [0, 1, 4]] = [[-h, 0.0, y], [0.0, 0.0, 0.0], [y, -x, h]]
    else:  # every displaced point is continued along its ray back to the deck
        effects[:3, [0, 1, 2]] = [[-(h + y * y / h), x * y / h, y / h], [0.0, y / h, 0.0], [0.0, 0.0, 1.0]]
        effects[1, 5] = -y / h
    return effects


def _own_covariance(covariance: Array, shared: Array) -> Array:
    """A covariance (3, 3) without its shared part, effects (3, K)."""
    root = np.linalg.cholesky(covariance + MIN_OWN_SIGMA**2 * np.eye(3))
    whitened = np.linalg.solve(root, shared)
    values, vectors = np.linalg.eigh(np.eye(3) - whitened @ whitened.T)
    scaled = root @ vectors
    return (scaled * np.maximum(values, MIN_OWN_SHARE)) @ scaled.T


def _regularise(matrix: Array) -> Array:
    """The nearest covariance that can be inverted."""
    scale = np.sqrt(np.diag(matrix))
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    return (vectors * np.maximum(values, 1e-6)) @ vectors.T * np.outer(scale, scale)


@dataclass(frozen=True, eq=False)
class GatedMeasurement:
    """The part of a measurement that may update the filter."""

    accepted: Measurement | None  # None: nothing of it
    excluded: Diagnostics  # LEFT, RIGHT, HEIGHT: why it was left out
    distance2: float  # squared Mahalanobis distance of what was accepted
    degrees: int  # of freedom of that
    measured: Mapping[Reason, Array]  # LEFT, RIGHT, HEIGHT: the innovation of what was measured


NAMES = {
    "left": (Reason.LEFT, "the left line"),
    "right": (Reason.RIGHT, "the right line"),
    "height": (Reason.HEIGHT, "the deck's height"),
}


def select_consistent(
    state: FilterState, measurement: Measurement, gate_sigma: float, kept_out: Collection[Reason] = ()
) -> GatedMeasurement:
    """Chi-square innovation gate: drop the one component whose removal makes the innovation consistent.

    One contradiction is assumed at most: each line and the height is left out in turn, and the rest that agrees best is
    accepted. When none agrees, nothing is accepted.

    Args:
        gate_sigma: standard deviations of a normal error with the same probability of being exceeded.
        kept_out: of these one is left out even where all agree.
    """
    all_rows = list(range(len(measurement.innovation)))
    distance2 = _distance2(state, measurement)
    names = (*measurement.sides, "height")
    measured = {reason: measurement.innovation[rows] for reason, rows in measurement.rows_by_reason().items()}
    if not kept_out and distance2 <= chi2_gate(gate_sigma, len(all_rows)):
        return GatedMeasurement(measurement, (), distance2, len(all_rows), measured)
    best: GatedMeasurement | None = None
    for name in names:
        if kept_out and NAMES[name][0] not in kept_out:
            continue
        rows = [row for row in all_rows if row not in measurement.rows(name)]
        part = measurement.subset(rows)
        rest = _distance2(state, part)
        # A line's direction can be right where its place is not; only the rest has to agree.
        if len(rows) > 1 and rest <= chi2_gate(gate_sigma, len(rows)) and (best is None or rest < best.distance2):
            left_out = (_deviation(measurement, name),)
            best = GatedMeasurement(part, left_out, rest, len(rows), measured)
    if best is not None:
        return best
    excluded = tuple(_deviation(measurement, name) for name in names)
    return GatedMeasurement(None, excluded, distance2, len(all_rows), measured)


def is_consistent(state: FilterState, measurement: Measurement, gate_sigma: float) -> bool:
    """Whether all of a measurement passes the gate."""
    return _distance2(state, measurement) <= chi2_gate(gate_sigma, len(measurement.innovation))


def has_returned(state: FilterState, measurement: Measurement, reason: Reason, before: Array) -> bool:
    """Whether a component of the measurement is at most half as far off as it was, by the state's covariance now.

    Args:
        reason: LEFT, RIGHT or HEIGHT, of a component that was measured.
        before: the innovation that it had; one of other rows cannot be compared, and has not returned.
    """
    rows = measurement.rows_by_reason()[reason]
    if len(rows) != len(before):
        return False
    part = measurement.subset(rows)
    now2, before2 = (_distance2(state, replace(part, innovation=each)) for each in (part.innovation, before))
    return now2 <= before2 / 4


def _distance2(state: FilterState, measurement: Measurement) -> float:
    variance = measurement.design @ state.covariance @ measurement.design.T + measurement.noise
    return float(measurement.innovation @ np.linalg.solve(variance, measurement.innovation))


def _deviation(measurement: Measurement, name: str) -> Diagnostic:
    """How far off a component of the measurement is."""
    rows, (reason, what) = measurement.rows(name), NAMES[name]
    first = float(measurement.innovation[rows[0]])
    if name == "height":
        return Diagnostic(reason, f"{what} is {abs(first):.1f} m {'lower' if first > 0 else 'higher'} than expected")
    turn = np.rad2deg(measurement.innovation[rows[1]])
    side = "right" if first > 0 else "left"
    return Diagnostic(reason, f"{what} is {abs(first):.1f} m to the {side} and {turn:+.1f} degrees off")
