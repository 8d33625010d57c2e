"""Where the runway was in the last picture of a flight."""

from dataclasses import dataclass

import numpy as np

from deckline.detect.looks import Box
from deckline.types import SIDES, Detection, Frame, RunwayEstimate, Status

IMAGE_MARGIN = 0.5  # of the last picture's box on every side: what an aircraft turns between frames


@dataclass(frozen=True, eq=False)
class _Seen:
    """The lines of one good estimate."""

    time_s: float
    size_px: tuple[int, int]  # of the image
    box: Box  # around the points of both lines


class LastSeen:
    """Carries the last picture's lines forward, for frames of one flight in their order that no tracker can follow.

    Without a pose nothing better is known; with one a tracker says more. Constant memory.

    Args:
        max_age_s: a picture older than this is forgotten; so it is when time runs backwards.
    """

    def __init__(self, max_age_s: float = 5.0) -> None:
        self.max_age_s = max_age_s
        self._seen: _Seen | None = None

    def image_box(self, frame: Frame) -> Box | None:
        """Where the runway was in the last picture, with a margin; None when it was not seen lately."""
        if self._seen is not None and not 0 <= frame.time_s - self._seen.time_s <= self.max_age_s:
            self._seen = None
        if self._seen is None or self._seen.size_px != (frame.camera.width, frame.camera.height):
            return None
        u0, v0, u1, v1 = self._seen.box
        aside = IMAGE_MARGIN * max(u1 - u0, v1 - v0)
        return u0 - aside, v0 - aside, u1 + aside, v1 + aside

    def update(self, frame: Frame, detection: Detection, estimate: RunwayEstimate) -> None:
        """Remember what was seen in a frame, if both lines were and agree."""
        if estimate.status is not Status.OK:
            return
        corners = np.concatenate([getattr(detection, side).points_px for side in SIDES])
        (u0, v0), (u1, v1) = corners.min(axis=0), corners.max(axis=0)
        box = (float(u0), float(v0), float(u1), float(v1))
        self._seen = _Seen(frame.time_s, (frame.camera.width, frame.camera.height), box)
