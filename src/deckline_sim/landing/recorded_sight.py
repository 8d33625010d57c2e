"""A sight that also records what a film and a report of the landing show."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deckline.dehaze import dehaze_for_display
from deckline.recording.images import decode_image, encode_image
from deckline.report.overlay import Panels, draw_panels
from deckline.types import Guidance
from deckline_sim.landing.rendered_sight import RenderedSight
from deckline_sim.landing.sight import Closing, Moment, Sight

JPEG_QUALITY = 90  # of recorded pictures: about 30 KB each


@dataclass(frozen=True, eq=False)
class PilotPicture:
    """One picture of the camera, hazy and dehazed with the lines found, as small JPEG files."""

    time_s: float
    """Of the exposure, s."""
    hazy: bytes
    """JPEG file, at most 640x360 px."""
    marked: bytes
    """JPEG file of the same size."""

    def images(self) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Both pictures (h, w, 3), RGB."""
        hazy, marked = (decode_image(data) for data in (self.hazy, self.marked))
        return hazy, marked


class RecordedSight:
    """Passes moments on to a sight and records its answers, and the pictures of a rendered one; a `Sight`.

    Args:
        sight: what answers.
    """

    def __init__(self, sight: Sight) -> None:
        self.sight = sight
        self.answers: list[Guidance] = []
        self.last_s = 0.0  # of the last moment
        self.pictures: list[PilotPicture] = []

    def see(self, moment: Moment) -> Guidance | None:
        """The sight's answer."""
        answer = self.sight.see(moment)
        self.last_s = moment.time_s
        if answer is not None:
            self.answers.append(answer)
        if isinstance(self.sight, RenderedSight):
            panels = _draw(self.sight)
            hazy, marked = (encode_image(image, "jpg", JPEG_QUALITY) for image in (panels.hazy, panels.marked))
            self.pictures.append(PilotPicture(moment.time_s, hazy, marked))
        return answer

    def close(self) -> None:
        """End the sight's threads and its renderer."""
        if isinstance(self.sight, Closing):
            self.sight.close()


def _draw(sight: RenderedSight) -> Panels:
    """The last picture of a sight as its pilot sees it."""
    result, flight = sight.result, sight.flight
    if result is None:
        raise AssertionError("unreachable: a sight that has answered has a result")
    dehazed = result.dehazed or dehaze_for_display(result.frame, flight.dehazer, flight.config.models)
    return draw_panels(result, dehazed)
