"""One frame's lines as the filter takes them: what was measured, what the state does to it, and its noise.

Errors that all frames have in common - attitude, deck height, depth scale, a late pose - are states of the filter.
What they add to a line's covariance is taken out of it again, so that only the rest is averaged over frames.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deckline.geometry import wrap_angle
from deckline.track.config import TrackConfig
from deckline.track.state import (
    ANGLE,
    AZIMUTH,
    DELAY,
    HEIGHT,
    LEFT,
    OFFSET,
    RIGHT,
    ROLL,
    SIGN,
    SIZE,
    SPACING,
    Pose,
    State,
    error_sigmas,
)
from deckline.types import SIDES, DepthMode, RunwayLine

Array = NDArray[np.float64]
OWN_SHARE = 0.02  # of a measurement's variance, at least, that is its own and not common to all frames
MIN_HEIGHT_M = 0.5  # of the camera above the deck, below which sensitivities are not believed
ERRORS = slice(ROLL, DELAY)  # the common errors that localization knows and counts


@dataclass(frozen=True, eq=False)
class Measurement:
    """Rows of a filter update: offset and azimuth of each line that was seen, and the height of the deck once."""

    sides: tuple[str, ...]
    values: Array  # (m,) measured minus predicted: offset, m, and azimuth, rad, of every side; z, m
    design: Array  # (m, 14)
    noise: Array  # (m, m)
    x_m: float  # mean place along the line where it was measured

    def rows(self, name: str) -> list[int]:
        """Rows of "left", "right" or "height"."""
        return [2 * len(self.sides)] if name == "height" else [2 * self.sides.index(name) + i for i in (0, 1)]

    def take(self, rows: list[int]) -> "Measurement":
        """The measurement without the rows that are not named; `sides` stay as they were."""
        return Measurement(
            self.sides, self.values[rows], self.design[rows], self.noise[np.ix_(rows, rows)], self.x_m
        )  # fmt: skip


def measure(
    state: State, lines: dict[str, RunwayLine], mode: DepthMode, pose: Pose, frame_s: float, config: TrackConfig
) -> Measurement | None:
    """Rows of the edge lines among `lines`; None where there are none.

    Args:
        state: predicted to the frame's time.
        lines: world, as localization gives them.
        mode: FINE or COARSE: decides how common errors act.
        pose: of the aircraft in this frame.
        frame_s: time between frames: an error that lasts longer than that is averaged less.
    """
    sides = tuple(side for side in SIDES if side in lines)
    if not sides:
        return None
    parts = [_line_rows(state, lines[side], side, mode, pose, config) for side in sides]
    n = len(sides)
    values, design, own = np.zeros(2 * n + 1), np.zeros((2 * n + 1, SIZE)), np.zeros((2 * n + 1, 2 * n + 1))
    white = np.zeros((2 * n + 1, 6))
    slower = max(1.0, 2 * config.noise_correlation_s / max(frame_s, 1e-3))
    for i, (value, rows, noise, moved) in enumerate(parts):
        mine = slice(2 * i, 2 * i + 2)
        values[mine], design[mine], white[mine] = value[:2], rows[:2], moved[:2]
        own[mine, mine] = slower * noise[:2, :2]
        own[mine, -1] = own[-1, mine] = slower * noise[:2, 2] / n
        values[-1] += value[2] / n
        design[-1] += rows[2] / n
        white[-1] += moved[2] / n
        own[-1, -1] += (
            slower * noise[2, 2] / n
        )  # all points of a frame decide one height: not better by the second line
    x_m = float(np.mean([state.local(lines[side].point_m)[0] for side in sides]))
    return Measurement(sides, values, design, _positive(own) + white @ white.T, x_m)


def _line_rows(
    state: State, line: RunwayLine, side: str, mode: DepthMode, pose: Pose, config: TrackConfig
) -> tuple[Array, Array, Array, Array]:
    """Residual (3,), design (3, 14), own noise (3, 3) and the pose's white noise (3, 6) of one line."""
    sign = SIGN[side]
    x, y, z = state.local(line.point_m)
    expected = sign / 2 * (state.mean[SPACING] + state.mean[ANGLE] * x)
    residual = np.array(
        [y - expected, float(wrap_angle(line.azimuth_rad - state.azimuth_rad - sign / 2 * state.mean[ANGLE])), z]
    )
    design = np.zeros((3, SIZE))
    design[0, [OFFSET, AZIMUTH, SPACING, ANGLE]] = 1.0, x, sign / 2, sign / 2 * x
    design[1, [AZIMUTH, ANGLE]] = 1.0, sign / 2
    design[2, HEIGHT] = 1.0
    # Effects are taken at the predicted line: at the measured one they would hang together with its noise.
    place = state.point_m + x * state.along + expected * state.right
    away = np.array([(place - pose.position_m) @ axis for axis in (state.along, state.right, [0.0, 0.0, 1.0])])
    away[2] = max(away[2], MIN_HEIGHT_M)
    effects = _effects(away, mode)
    design[:, ERRORS] = effects[:, :4]
    design[:, DELAY] = _late(state, effects, pose)
    design[0, LEFT if side == "left" else RIGHT] = 1.0
    residual = residual - design[:, ROLL:] @ state.mean[ROLL:]
    known = line.covariance if line.relative_covariance is None else line.relative_covariance
    shared = effects[:, :4] * error_sigmas(config)[:4]
    e = config.errors
    # Turns about x, y, z and shifts along y, z; a shift along x moves no line.
    white = np.column_stack([effects[:, [0, 1, 4]] * e.attitude_white_rad, effects[:, 5:7] * e.position_white_m])
    return residual, design, _own(known, shared), np.column_stack([white, np.zeros(3)])


def _effects(away_m: Array, mode: DepthMode) -> Array:
    """What errors add to a measured line: (3, 7), rows offset, azimuth, z.

    Columns: attitude about x and y, rad; deck z, m; depth, share; attitude about z, rad; position along y and z, m.

    Args:
        away_m: (3,) from the camera to the line's measured point, along, right, down.
    """
    x, y, h = away_m
    if mode is DepthMode.FINE:
        return np.array(
            [
                [-h, 0.0, 0.0, y, x, 1.0, 0.0],
                [0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
                [y, -x, 0.0, h, 0.0, 0.0, 1.0],
            ]
        )
    # On the plane every displaced point is continued along its ray back to the deck.
    return np.array(
        [
            [-(h + y * y / h), x * y / h, y / h, 0.0, x, 1.0, -y / h],
            [0.0, y / h, 0.0, 0.0, 1.0, 0.0, 0.0],
            [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
        ]
    )


def _late(state: State, effects: Array, pose: Pose) -> Array:
    """What one second of delay of the pose adds to a measured line, (3,)."""
    _, v_right, v_down = (pose.velocity_m_s @ axis for axis in (state.along, state.right, np.array([0.0, 0.0, 1.0])))
    turn_x, turn_y, turn_z = (
        pose.turning_rad_s @ axis for axis in (state.along, state.right, np.array([0.0, 0.0, 1.0]))
    )
    return -(effects[:, [0, 1, 4, 5, 6]] @ np.array([turn_x, turn_y, turn_z, v_right, v_down]))


def _own(covariance: Array, shared: Array) -> Array:
    """What is left of a covariance (3, 3) when the common part, 1-sigma effects (3, 4), is taken out of it."""
    root = np.linalg.cholesky(covariance + 1e-12 * np.eye(3))
    whitened = np.linalg.solve(root, shared)
    values, vectors = np.linalg.eigh(np.eye(3) - whitened @ whitened.T)
    kept = root @ vectors
    return (kept * np.maximum(values, OWN_SHARE)) @ kept.T


def _positive(matrix: Array) -> Array:
    """The nearest covariance: the parts of two lines, put together, may contradict each other."""
    scale = np.sqrt(np.diag(matrix))
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    return (vectors * np.maximum(values, OWN_SHARE)) @ vectors.T * np.outer(scale, scale)
