"""Independent checks of a flight's pictures: whatever contradicts the lines or the pose without using the track.

A new monitor is one file, one line in `build_monitors`, a `Reason`, and its advice in `deckline.report.advice`.
"""

from typing import Protocol

from deckline.config import Tracking
from deckline.monitors.attitude import AttitudeMonitor
from deckline.monitors.frozen_image import FrozenImageMonitor
from deckline.monitors.painted_lines import PaintMonitor
from deckline.types import Detection, Diagnostics, Frame, RunwayEstimate

__all__ = ["AttitudeMonitor", "FrozenImageMonitor", "Monitor", "PaintMonitor", "build_monitors"]


class Monitor(Protocol):
    """Updated with every frame of one flight, in their order; returns the flags that are active after it."""

    def update(self, frame: Frame, estimate: RunwayEstimate, detection: Detection | None) -> Diagnostics:
        """The active flags after one more frame.

        Args:
            frame: the next one of the flight.
            estimate: lines of this frame alone.
            detection: what the detector found in the frame's picture; None: the points were given, and the picture
                may show nothing.
        """
        ...

    def reset(self) -> None:
        """Start another flight: forget all frames."""
        ...

    def close(self) -> None:
        """End the monitor's threads."""
        ...


def build_monitors(tracking: Tracking) -> tuple[Monitor, ...]:
    """The monitors of a flight, in the order of their flags."""
    return FrozenImageMonitor(), AttitudeMonitor(tracking.horizon_s), PaintMonitor(tracking.paint_s)
