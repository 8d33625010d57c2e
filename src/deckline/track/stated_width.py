"""The stated width against the first frame of a track."""

from dataclasses import dataclass

import numpy as np

from deckline.config import RunConfig
from deckline.track.measurement import Measurement
from deckline.track.states import FilterState, States
from deckline.types import SIDES, DepthMode, Diagnostic, Reason


@dataclass(frozen=True, eq=False)
class WidthTest:
    """Spacing of both lines of a track's first frame against the stated width."""

    spacing_m: float  # as depth or the stated deck height scales it
    stated_m: float
    sigma_m: float  # of the difference, if what was stated is true
    mode: DepthMode  # of the frame

    def flag(self, alarm_sigma: float) -> Diagnostic | None:
        """A flag where the difference is larger than so many sigmas."""
        if abs(self.spacing_m - self.stated_m) <= alarm_sigma * self.sigma_m:
            return None
        return spacing_contradiction(self.spacing_m, self.stated_m, self.mode)


def compare_width(state: FilterState, measurement: Measurement, mode: DepthMode, config: RunConfig) -> WidthTest | None:
    """The stated width against the lines of a track's first frame; None without a stated width or a line.

    Args:
        state: the initial one.
        mode: of the frame: whether depth or the stated deck height scales the lines.
    """
    if config.deck.width_m is None or len(measurement.sides) < len(SIDES):
        return None
    row = np.zeros(len(measurement.innovation))
    (left, left_azimuth), (right, right_azimuth) = measurement.rows("left"), measurement.rows("right")
    row[[left, right]] = -1.0, 1.0
    # The lines' points lie not abreast of each other: the measured azimuth takes out what the unknown one adds.
    row[[left_azimuth, right_azimuth]] = -float(row @ measurement.design[:, States.AZIMUTH]) / 2
    design = row @ measurement.design
    sigma_m = float(np.sqrt(design @ state.covariance @ design + row @ measurement.noise @ row))
    spacing_m = float(state.mean[States.SPACING] + row @ measurement.innovation)
    return WidthTest(spacing_m, config.deck.width_m, sigma_m, mode)


def spacing_contradiction(spacing_m: float, stated_m: float, mode: DepthMode = DepthMode.COARSE) -> Diagnostic:
    by = "depth camera" if mode is DepthMode.FINE else "stated deck height"
    message = f"the lines are {spacing_m:.1f} m apart by the {by}; {stated_m:.1f} m is stated"
    return Diagnostic(Reason.SPACING, message)
