"""One frame's lines as the filter takes them: what was measured, what the state does to it, and its noise.

Errors that all frames have in common - attitude, deck height, depth scale, focal length, a late pose - and the deck's
motion are states of the filter; only the rest is averaged over frames. A line says itself what such errors do to it.
Where it does not, it is taken for one through points that were each placed in the world alone.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deckline.geometry import wrap_angle
from deckline.track.config import TrackConfig
from deckline.track.state import (
    ANGLE,
    AZIMUTH,
    BANK,
    DECK,
    DELAY,
    FOCAL,
    HEIGHT,
    LEFT,
    OFFSET,
    PITCH,
    RIGHT,
    RISE,
    ROLL,
    SCALE,
    SIGN,
    SIZE,
    SPACING,
    TILT,
    Pose,
    State,
    error_sigmas,
)
from deckline.types import SIDES, DepthMode, RunwayLine

Array = NDArray[np.float64]
OWN_SHARE = 0.02  # of a measurement's variance, at least, that is its own and not common to all frames
OWN_SIGMA = 1e-5  # m, rad; a line that states no noise at all is taken for this sure
MIN_HEIGHT_M = 0.5  # of the camera above the deck, below which sensitivities are not believed
SLOPE_SEEN = 0.05  # share of a slope that a frame must show for its slope to be used
DOWN = np.array([0.0, 0.0, 1.0, 0.0, 0.0])  # of offset, azimuth, z and slopes


@dataclass(frozen=True, eq=False)
class Measurement:
    """Rows of a filter update: offset and azimuth of each line that was seen, the deck's height and slopes once."""

    sides: tuple[str, ...]
    values: Array  # (m,) measured minus predicted: offset, m, and azimuth, rad, of every side; z, m; slopes, rad
    design: Array  # (m, 20)
    noise: Array  # (m, m)
    x_m: float  # mean place along the line where it was measured

    def rows(self, name: str) -> list[int]:
        """Rows of "left", "right" or "height"."""
        if name == "height":
            return list(range(2 * len(self.sides), len(self.values)))
        return [2 * self.sides.index(name) + i for i in (0, 1)]

    def take(self, rows: list[int]) -> "Measurement":
        """The measurement without the rows that are not named; `sides` stay as they were."""
        return Measurement(
            self.sides, self.values[rows], self.design[rows], self.noise[np.ix_(rows, rows)], self.x_m
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Row:
    """One line: residual (K,), design (K, 20), the pose's white noise (K, 5), its own noise (K, M).

    K rows: offset, azimuth, z, and slopes where they were measured.
    """

    residual: Array
    design: Array
    white: Array
    own: Array


def measure(
    state: State, lines: dict[str, RunwayLine], mode: DepthMode, pose: Pose, frame_s: float, config: TrackConfig
) -> Measurement | None:
    """Rows of the edge lines among `lines`; None where there are none.

    Args:
        state: predicted to the frame's time.
        lines: world, as localization gives them.
        mode: FINE or COARSE: decides how common errors act on lines that do not say so themselves.
        pose: of the aircraft in this frame.
        frame_s: time between frames: an error that lasts longer than that is averaged less.
    """
    sides = tuple(side for side in SIDES if side in lines)
    if not sides:
        return None
    hub = np.mean([state.local(lines[side].point_m) for side in sides], axis=0)
    parts = [_line_row(state, lines[side], side, mode, pose, hub, config) for side in sides]
    slower = max(1.0, 2 * config.noise_correlation_s / max(frame_s, 1e-3))
    own = _stacked([part.own for part in parts])
    white = _stacked([part.white for part in parts])
    noise = slower * _positive(own @ own.T) + white @ white.T
    values = _stacked([part.residual[:, None] for part in parts])[:, 0]
    return Measurement(sides, values, _stacked([part.design for part in parts]), noise, float(hub[0]))


def _stacked(parts: list[Array]) -> Array:
    """Offset and azimuth of every line, then the mean of all else: a frame's height and slopes are one."""
    return np.concatenate([*(part[:2] for part in parts), np.mean([part[2:] for part in parts], axis=0)])


def _line_row(
    state: State, line: RunwayLine, side: str, mode: DepthMode, pose: Pose, hub: Array, config: TrackConfig
) -> _Row:
    sign = SIGN[side]
    x, y, z = state.local(line.point_m)
    expected = sign / 2 * (state.mean[SPACING] + state.mean[ANGLE] * x)
    turned = float(wrap_angle(line.azimuth_rad - state.azimuth_rad - sign / 2 * state.mean[ANGLE]))
    slopes = np.zeros(2) if line.errors is None else line.errors.slopes_rad
    residual = np.array([y - expected, turned, z, *slopes])
    away = state.local(pose.position_m)
    away = np.array([x - away[0], expected - away[1], max(z - away[2], MIN_HEIGHT_M)])
    effects, own = _effects_and_own(state, line, side, away, mode, config)
    # A turn about z carries the line along; so does a shift to the side, and one down unless the deck's height is
    # believed more than the aircraft's.
    carried = np.column_stack([effects[:, :2], [away[0], 1.0, 0, 0, 0], [1.0, 0, 0, 0, 0], DOWN - effects[:, 2]])
    design = np.zeros((5, SIZE))
    design[0, [OFFSET, AZIMUTH, SPACING, ANGLE]] = 1.0, x, sign / 2, sign / 2 * x
    design[1, [AZIMUTH, ANGLE]] = 1.0, sign / 2
    design[2, HEIGHT] = 1.0
    design[:, [ROLL, PITCH, DECK, FOCAL, SCALE]] = effects[:, :5]
    rises = np.array([[1.0, x, expected], [1.0, hub[0], hub[1]]])  # by rise, tilt, bank: at the line, and midway
    design[:, [RISE, TILT, BANK]] = np.outer(DOWN, rises[0]) - np.outer(effects[:, 2], rises[1])
    design[:, [TILT, BANK]] += effects[:, 5:]
    design[[3, 4], [TILT, BANK]] += 1.0
    design[:, DELAY] = -carried @ _per_second(state, pose)
    design[0, LEFT if side == "left" else RIGHT] = 1.0
    residual -= design[:, RISE:] @ state.mean[RISE:]
    e = config.errors
    white = carried * np.array([e.attitude_white_rad] * 3 + [e.position_white_m] * 2)
    # Only a depth camera sees slopes themselves; without it they are guessed from the lines' directions.
    keep = [0, 1, 2, *(k for k in (3, 4) if mode is DepthMode.FINE and 1 + effects[k, 2 + k] > SLOPE_SEEN)]
    return _Row(residual[keep], design[keep], white[keep], own[keep])


def _effects_and_own(
    state: State, line: RunwayLine, side: str, away_m: Array, mode: DepthMode, config: TrackConfig
) -> tuple[Array, Array]:
    """What common errors do to a line, (5, 7) as in `LineErrors` but turned to its own axes, and its own noise (5, M).

    Args:
        away_m: (3,) from the camera to the line's measured point, along, right, down.
    """
    if line.errors is not None:
        cos, sin = state.along[:2]
        effects = line.errors.effects.copy()
        effects[:, :2] = effects[:, :2] @ [[cos, -sin], [sin, cos]]
        return effects, np.hstack([line.errors.own, OWN_SIGMA * np.eye(5)])
    effects = _alone(away_m, mode)
    known = line.covariance if line.relative_covariance is None else line.relative_covariance
    roll, pitch, deck, scale, focal = error_sigmas(config)[:5]
    rest = _rest(known, effects[:3, :5] * [roll, pitch, deck, focal, scale])
    # Square root with one column for z, which both lines share: a frame's height is not better by the second line.
    root = np.linalg.cholesky(rest[::-1, ::-1])[::-1, ::-1]
    own = np.zeros((5, 5))
    own[:3, [0, 1, 4] if side == "left" else [2, 3, 4]] = root
    return effects, own


def _alone(away_m: Array, mode: DepthMode) -> Array:
    """What errors do to a line through points that were each placed in the world alone, (5, 7); slopes are not seen."""
    x, y, h = away_m
    effects = np.zeros((5, 7))
    effects[[3, 4], [5, 6]] = -1.0
    if mode is DepthMode.FINE:
        effects[:3, [0, 1, 4]] = [[-h, 0.0, y], [0.0, 0.0, 0.0], [y, -x, h]]
    else:  # every displaced point is continued along its ray back to the deck
        effects[:3, [0, 1, 2]] = [[-(h + y * y / h), x * y / h, y / h], [0.0, y / h, 0.0], [0.0, 0.0, 1.0]]
        effects[1, 5] = -y / h
    return effects


def _per_second(state: State, pose: Pose) -> Array:
    """How the aircraft turns about x, y, z and moves along y, z, (5,)."""
    axes = np.stack([state.along, state.right, DOWN[:3]])
    return np.concatenate([axes @ pose.turning_rad_s, axes[1:] @ pose.velocity_m_s])


def _rest(covariance: Array, shared: Array) -> Array:
    """What is left of a covariance (3, 3) when the common part, effects (3, K), is taken out of it."""
    root = np.linalg.cholesky(covariance + OWN_SIGMA**2 * np.eye(3))
    whitened = np.linalg.solve(root, shared)
    values, vectors = np.linalg.eigh(np.eye(3) - whitened @ whitened.T)
    kept = root @ vectors
    return (kept * np.maximum(values, OWN_SHARE)) @ kept.T


def _positive(matrix: Array) -> Array:
    """The nearest covariance that can be inverted."""
    scale = np.sqrt(np.diag(matrix))
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    return (vectors * np.maximum(values, 1e-6)) @ vectors.T * np.outer(scale, scale)
