"""Which of a frame's measurements the track can believe."""

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2, norm

from deckline.track.measurement import Measurement
from deckline.track.state import State

WHAT = {"left": "the left line", "right": "the right line", "height": "the deck's height"}


@dataclass(frozen=True, eq=False)
class Gated:
    """What a frame's measurement may do to the track."""

    kept: Measurement | None  # None: nothing of it
    left_out: dict[str, str]  # "left", "right", "height": why it was left out
    distance2: float  # of what was kept, squared and in standard deviations
    degrees: int  # of freedom of that


def gated(state: State, measured: Measurement, gate: float) -> Gated:
    """The largest part of a measurement that agrees with the state, by its innovation's chi-square.

    One contradiction is assumed at most: each line and the height is left out in turn, and the part that then
    agrees best is kept. When none agrees, nothing is kept.

    Args:
        gate: standard deviations of a normal error with the same chance of being exceeded.
    """
    names = [*measured.sides, "height"]
    whole = list(range(len(measured.values)))
    distance = _distance2(state, measured, whole)
    if distance <= _limit(gate, len(whole)):
        return Gated(measured, {}, distance, len(whole))
    best: Gated | None = None
    for name in names:
        rows = [row for row in whole if row not in measured.rows(name)]
        rest = _distance2(state, measured, rows)
        # A line's direction can be right where its place is not; only the rest has to agree.
        if len(rows) > 1 and rest <= _limit(gate, len(rows)) and (best is None or rest < best.distance2):
            why = f"{WHAT[name]} is {_size(state, measured, name)}"
            best = Gated(measured.take(rows), {name: why}, rest, len(rows))
    if best is not None:
        return best
    reasons = {name: f"{WHAT[name]} is {_size(state, measured, name)}" for name in names}
    return Gated(None, reasons, distance, len(whole))


def _limit(gate: float, degrees: int) -> float:
    return float(chi2.isf(2 * norm.sf(gate), degrees))


def _distance2(state: State, measured: Measurement, rows: list[int]) -> float:
    if not rows:
        return 0.0
    part = measured.take(rows)
    spread = part.design @ state.covariance @ part.design.T + part.noise
    return float(part.values @ np.linalg.solve(spread, part.values))


def _size(state: State, measured: Measurement, name: str) -> str:
    """How far off a measurement is, in words."""
    rows = measured.rows(name)
    if name == "height":
        down = measured.values[rows[0]]
        return f"{abs(down):.1f} m {'lower' if down > 0 else 'higher'} than expected"
    place, turn = measured.values[rows[0]], np.rad2deg(measured.values[rows[1]])
    return f"{abs(place):.1f} m to the {'right' if place > 0 else 'left'} and {turn:+.1f} degrees off"
