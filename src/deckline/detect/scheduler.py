"""Detection over the pictures of one flight: one view a picture where the track is sure, a whole search beside it.

A track must not confirm itself. Every `search_s` a picture is searched as if nothing were known, one view a frame, and
compared with the lines that the track's box gave in the same picture. While they differ, every picture is searched
whole; from the second such search on the track is flagged.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray

from deckline.detect.crop import Box
from deckline.detect.search import CropView, Search, search_lines
from deckline.types import Detection, Diagnostic, Diagnostics, Frame, Reason, RunwayEstimate

DONE = object()
OTHER_LINES = Diagnostic(Reason.OTHER_LINES, "a search of the whole picture sees other lines than the track")


ViewJoined = Callable[[Search, Box], CropView | None]  # of a picture whose box was searched, and that box


class SearchingDetector(ABC):
    """Base class of detectors whose search can be done one view at a time.

    A detector states that it can by inheriting from this class. A `Flight` then computes one view a frame where its
    track is sure. A detector that does not inherit searches every picture whole, whatever methods it has.
    """

    @abstractmethod
    def start_search(self, image_rgb: NDArray[np.uint8]) -> Search:
        """A search of an image (H, W, 3) in which no view has been computed yet."""


@dataclass(frozen=True, eq=False)
class BackgroundSearch:
    """A search under way, and the lines that the track's box gave in its picture."""

    search: Search
    steps: Iterator[None]
    detection: Detection


class SearchScheduler:
    """Detects the lines in every picture of a flight, in their order; a `Monitor` of the track.

    Args:
        detector: finds the lines.
        search_s: from the end of one search beside the track to the next, s. A picture that comes later than that after
            the one before is searched whole; 0: every picture is.
    """

    def __init__(self, detector: SearchingDetector, search_s: float) -> None:
        self.detector = detector
        self.search_s = search_s
        self.reset()

    def reset(self) -> None:
        """Forget all pictures, and the search under way."""
        self._contradictions = 0  # searches in a row that found other lines than the track's box
        self._background: BackgroundSearch | None = None
        self._last_s = -np.inf  # when a search ended
        self._seen_s = -np.inf  # the last picture's time

    def close(self) -> None:
        """No threads to end."""

    def update(self, frame: Frame, estimate: RunwayEstimate, detection: Detection | None) -> Diagnostics:
        """A flag where two searches in a row found other lines than the track's box."""
        return (OTHER_LINES,) if self._contradictions > 1 else ()

    def detect(
        self,
        time_s: float,
        image_rgb: NDArray[np.uint8],
        box: Box | None,
        is_sure: bool,
        view_joined: ViewJoined | None = None,
    ) -> Detection:
        """Lines in the next picture.

        Args:
            time_s: of the picture.
            image_rgb: (H, W, 3).
            box: where the runway should be; None: not known.
            is_sure: the pictures before confirm the box.
            view_joined: one view of several pictures, where this one alone does not surely show both lines in the box.
        """
        search, roi_search = (self.detector.start_search(image_rgb) for _ in range(2))  # the box is no place searched
        view_roi = None if box is None else cache(partial(search_box, roi_search, box, view_joined))
        follows, self._seen_s = 0 < time_s - self._seen_s <= self.search_s, time_s
        roi_view = view_roi() if view_roi is not None and is_sure and follows else None
        least = roi_search.config.agreeing_probability
        if roi_view is not None and roi_view.probability >= least and not self._contradictions:
            self._search_beside(time_s, image_rgb, roi_view.lines)
            return roi_view.lines
        detection = search_lines(search, view_roi)
        self._background, self._last_s = None, time_s
        self._compare(search, detection if roi_view is None else roi_view.lines)
        return detection

    def _search_beside(self, time_s: float, image_rgb: NDArray[np.uint8], detection: Detection) -> None:
        """One view of the search of this picture, or of the search under way."""
        if self._background is None:
            if 0 <= time_s - self._last_s < self.search_s:
                return
            search = self.detector.start_search(image_rgb)
            self._background = BackgroundSearch(search, search.steps(), detection)
        if next(self._background.steps, DONE) is DONE:
            self._compare(self._background.search, self._background.detection)
            self._background, self._last_s = None, time_s

    def _compare(self, search: Search, detection: Detection) -> None:
        self._contradictions = self._contradictions + 1 if search.contradicts(detection) else 0


def search_box(search: Search, box: Box, view_joined: ViewJoined | None) -> CropView | None:
    """The view of a box: of its picture alone, or of several pictures where that one is not sure and they are surer."""
    alone = search.search_prior(box)
    if view_joined is None or (alone is not None and alone.probability >= search.config.agreeing_probability):
        return alone
    joined = view_joined(search, box)
    return max((view for view in (alone, joined) if view is not None), key=lambda view: view.probability, default=None)
