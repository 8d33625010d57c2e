"""What is kept over frames to tell a fault from a bad frame, and the flags that follow."""

from dataclasses import dataclass, field, replace

import numpy as np

from deckline.track.config import TrackConfig
from deckline.track.extent import Extent
from deckline.track.gate import Gated
from deckline.track.integrity import Residuals, biased, restless
from deckline.track.state import ANGLE, SPACING, State
from deckline.types import Flag, RunwayLine

KNOWN_M = 1.0  # 1-sigma of a spacing that was learned
LEAST_SPACING_M = 1.0  # below this left and right are confused


@dataclass(frozen=True, eq=False)
class Watch:
    """Memory of contradictions."""

    residuals: Residuals = field(default_factory=Residuals)
    since_s: dict[str, float] = field(default_factory=dict)  # when a measurement began to be left out, until now
    known: State | None = None  # with the spacing that was learned before the track began anew

    def after(self, gate: Gated | None, time_s: float, step_s: float, config: TrackConfig) -> "Watch":
        """After one more frame; a frame without a line says nothing of those that are left out."""
        residuals = self.residuals.after(gate, step_s, config.integrity.window_s)
        if gate is None:
            return replace(self, residuals=residuals)
        since = {name: self.since_s.get(name, time_s) for name in gate.left_out}
        return replace(self, residuals=residuals, since_s=since)

    def anew(self, before: State | None) -> "Watch":
        """For a new track: what was learned of the old one is kept."""
        learned = before is not None and np.sqrt(before.covariance[SPACING, SPACING]) < KNOWN_M
        return Watch(since_s=self.since_s, known=before if learned and self.known is None else self.known)


def alarms(
    watch: Watch, gate: Gated | None, state: State | None, extent: Extent | None, time_s: float, config: TrackConfig
) -> tuple[Flag, ...]:
    """All flags of one frame."""
    found: list[Flag] = []
    if gate is not None:
        for name, why in gate.left_out.items():
            if time_s - watch.since_s.get(name, time_s) >= config.integrity.lasting_s:
                found.append(Flag(name, f"{why}, for {time_s - watch.since_s[name]:.1f} s"))
    if state is not None:
        near_m = 0.0 if extent is None else float(state.local(extent.near_m)[0])
        found += [
            flag for flag in (biased(state, near_m, config), restless(watch.residuals, config)) if flag is not None
        ]
        if watch.known is not None:
            changed = _changed(watch.known, state, config)
            found += [] if changed is None else [changed]
    return tuple(found)


def confused(lines: dict[str, RunwayLine]) -> str:
    """Why two lines cannot be left and right of one runway, or an empty text."""
    if "left" not in lines or "right" not in lines:
        return ""
    left, right = lines["left"], lines["right"]
    aside = np.array([-left.direction[1], left.direction[0], 0.0])
    spacing = float((right.point_m - left.point_m) @ aside)
    return "" if spacing > LEAST_SPACING_M else f"the right line lies {-spacing:.1f} m left of the left line"


def _changed(known: State, state: State, config: TrackConfig) -> Flag | None:
    """Whether the lines are spaced otherwise than they were before the track began anew."""
    x = float(known.local(state.point_m)[0])
    before = float(known.mean[SPACING] + known.mean[ANGLE] * x)
    move = np.zeros(len(known.mean))
    move[[SPACING, ANGLE]] = 1.0, x
    variance = float(move @ known.covariance @ move + state.covariance[SPACING, SPACING])
    away = float(state.mean[SPACING]) - before
    if abs(away) < config.integrity.alarm * np.sqrt(variance):
        return None
    return Flag("spacing", f"the lines are {state.mean[SPACING]:.1f} m apart and were {before:.1f} m apart before")
