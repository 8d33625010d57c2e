"""Lines in the pictures of one flight: one close look where the track is sure, a search of the whole beside it.

A track must not hold itself up: every second a picture is searched as if nothing were known, one look a frame, and
compared with what the close look said of the same picture. Where they differ, every picture is searched whole again
until they agree, and from the second such search on the track is flagged.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, partial
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from deckline.detect.crop import Box
from deckline.detect.search import Search, search_lines
from deckline.types import Detection

DONE = object()


@runtime_checkable
class SearchingDetector(Protocol):
    """A detector whose search can be done look by look."""

    def __call__(self, image_rgb: NDArray[np.uint8], prior_box: Box | None = None) -> Detection: ...

    def start_search(self, image_rgb: NDArray[np.uint8]) -> Search: ...


@dataclass(frozen=True, eq=False)
class Background:
    """A search under way, and what the close look said of its picture."""

    search: Search
    steps: Iterator[None]
    detection: Detection


class SearchScheduler:
    """Called with every picture of a flight, in their order.

    Args:
        detector: finds the lines.
        search_s: from the end of one search beside the track to the next, s. A picture that comes later than that after
            the one before is searched whole; 0: every picture is.
    """

    def __init__(self, detector: SearchingDetector, search_s: float) -> None:
        self.detector = detector
        self.search_s = search_s
        self._contradictions = 0  # searches in a row that saw other lines than the close look
        self._background: Background | None = None
        self._last_s = -np.inf  # when a search ended
        self._seen_s = -np.inf  # the last picture's time

    @property
    def is_contradicted(self) -> bool:
        """Whether two searches in a row saw other lines than the close look."""
        return self._contradictions > 1

    def __call__(self, time_s: float, image_rgb: NDArray[np.uint8], box: Box | None, is_tracked: bool) -> Detection:
        """Lines in an image (H, W, 3). `box`: where the runway should be; `is_tracked`: the pictures before say so."""
        search, close = (self.detector.start_search(image_rgb) for _ in range(2))  # a close look is no place searched
        look = None if box is None else cache(partial(close.search_prior, box))
        follows, self._seen_s = 0 < time_s - self._seen_s <= self.search_s, time_s
        told = look() if look is not None and is_tracked and follows else None
        if told is not None and told.probability >= close.config.agreeing_probability and not self._contradictions:
            self._search_beside(time_s, image_rgb, told.lines)
            return told.lines
        detection = search_lines(search, look)
        self._background, self._last_s = None, time_s
        self._compare(search, detection if told is None else told.lines)
        return detection

    def _search_beside(self, time_s: float, image_rgb: NDArray[np.uint8], detection: Detection) -> None:
        """One look of the search of this picture, or of the one that is under way."""
        if self._background is None:
            if 0 <= time_s - self._last_s < self.search_s:
                return
            search = self.detector.start_search(image_rgb)
            self._background = Background(search, search.steps(), detection)
        if next(self._background.steps, DONE) is DONE:
            self._compare(self._background.search, self._background.detection)
            self._background, self._last_s = None, time_s

    def _compare(self, search: Search, detection: Detection) -> None:
        self._contradictions = self._contradictions + 1 if search.contradicts(detection) else 0
