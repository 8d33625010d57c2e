"""Detection over the pictures of one flight: a bounded number of views a frame, the search spread over frames.

One view a frame is of the track's box. Beside it a picture is searched as if nothing were known, while later frames
come: one view a frame where the track is sure. Where it is not, three views a frame, or a hundred a second if that is
more, are shared between the likeliest places of the frame itself and the search of all small tiles of the picture that
is held. Where that search finds a runway, the next frame is viewed there, moved as the picture has moved since.

A track must not confirm itself: every `search_s` such a search is compared with the lines that the track's box gave in
the same picture. While they differ, one search follows the other, and both places are viewed in every frame; from the
second such search on the track is flagged.

The search of the picture that is held goes on between two frames: no answer waits for it.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from deckline.detect.crop import Box, box_around
from deckline.detect.prior import widen
from deckline.detect.registration import move_box, picture_shift, small_grey
from deckline.detect.runway_shape import runway_shape
from deckline.detect.search import CropView, Search, agree, search_lines
from deckline.types import Detection, Diagnostic, Diagnostics, Frame, LinePoints, Reason, RunwayEstimate

SURE_VIEWS = 2  # of a picture at most where the track is sure
VIEWS = 3  # of any other picture at most,
VIEWS_PER_S = 100.0  # or of pictures that come slowly
MIN_FAINT_SHARED_ROWS = 0.5  # of a pair in joined pictures, of the rows of both lines together
HELD_SHARE = 3  # of these one in so many is of the held picture
QUICK_TILINGS = 1  # that are searched in every frame that shows nothing else
DONE = object()
NOTHING = Detection(LinePoints.empty(), LinePoints.empty())
OTHER_LINES = Diagnostic(Reason.OTHER_LINES, "a search of the whole picture sees other lines than the track")


ViewJoined = Callable[[Search, Box], CropView | None]  # of a picture whose box was searched, and that box


class SearchingDetector(ABC):
    """Base class of detectors whose search can be done one view at a time.

    A detector states that it can by inheriting from this class. A `Flight` then spreads the search over the frames. A
    detector that does not inherit searches every picture whole, whatever methods it has.
    """

    @abstractmethod
    def start_search(self, image_rgb: NDArray[np.uint8]) -> Search:
        """A search of an image (H, W, 3) in which no view has been computed yet."""


@dataclass(frozen=True, eq=False)
class HeldSearch:
    """A search under way, of a picture that is held meanwhile."""

    search: Search
    steps: Iterator[None]
    grey: NDArray[np.float32]
    """The picture, small."""
    reference: Detection | None
    """What other views gave in the same picture; None: nothing."""


@dataclass(frozen=True, eq=False)
class FoundPlace:
    """Where a search, or a view after it, saw a runway."""

    box: Box
    grey: NDArray[np.float32]
    """The picture in which it was there, small."""
    is_faint: bool = False
    """Only joined pictures showed it, once: it counts where the next picture shows it too."""


class SearchScheduler:
    """Detects the lines in every picture of a flight, in their order; a `Monitor` of the track.

    Args:
        detector: finds the lines.
        search_s: from the end of one search beside the track to the next, s; 0: every picture is searched whole.
        first_at_once: so is a picture that comes later than that after the one before; else only from the second such
            picture in a row on, and no box is sure until the search after the gap has ended.
    """

    def __init__(self, detector: SearchingDetector, search_s: float, first_at_once: bool = True) -> None:
        self.detector = detector
        self.search_s, self.first_at_once = search_s, first_at_once
        self.reset()

    def reset(self) -> None:
        """Forget all pictures, and the search under way."""
        self._contradictions = 0  # searches in a row that found other lines than the track's box
        self._held: HeldSearch | None = None
        self._coming: Callable[[], None] | None = None  # views of the held picture, before the next picture
        self._place: FoundPlace | None = None
        self._last_s = -np.inf  # when a search ended; infinite: none has since the last gap, so that no box is sure
        self._seen_s = -np.inf  # the last picture's time
        self._passed_s = 0.0  # from the one before to it

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
        view_place_joined: ViewJoined | None = None,
        is_wide: bool = False,
    ) -> Detection:
        """Lines in the next picture.

        Args:
            image_rgb: (H, W, 3).
            box: where the runway should be; None: not known.
            is_sure: the pictures before confirm the box.
            view_joined: one view of several pictures, where this one alone does not surely show both lines in the box.
            view_place_joined: the same of a place that a search found, where nothing else is known of the runway.
            is_wide: the box has a margin; it is viewed once more, closer, before pictures are joined.
        """
        self.search_on()
        before_s, passed_s = self._passed_s, time_s - self._seen_s
        self._passed_s, self._seen_s = passed_s, time_s
        if passed_s > self.search_s:
            if self.first_at_once or before_s > self.search_s or not self.search_s:
                return self._search_at_once(time_s, image_rgb, box)
            self._held, self._place, passed_s = None, None, 0.0  # what was seen so long ago is elsewhere
            self._last_s = -np.inf
        search = self.detector.start_search(image_rgb)
        at_box = None if box is None else self._view_box(search, box, view_joined, is_wide)
        is_checked = np.isfinite(self._last_s)
        is_sure = is_sure and is_checked and not self._contradictions
        if at_box is not None and is_sure and _is_sure_pair(search, at_box):
            self._place = None
            if self._held is not None or time_s - self._last_s >= self.search_s:
                views = SURE_VIEWS - len(search.crops)
                self._coming = partial(self._search_held, time_s, image_rgb, at_box.lines, views)
            return at_box.lines
        at_place = None
        if self._place and len(search.crops) < VIEWS:
            at_place = self._view_place(search, self._place, view_place_joined)
        seen = _choose(search, at_box, at_place)
        views = max(VIEWS, round(VIEWS_PER_S * passed_s)) - len(search.crops)
        held_views = min(max(1, views // HELD_SHARE), views)
        found = seen
        if seen is None or seen.count < 2:
            found = self._search_quickly(image_rgb, views - held_views, view_place_joined) or seen
        elif not is_checked and self._held is not None:  # a search's first step may take a view more
            held_views = views  # the track may follow what it found before the gap: the sooner this shows the better
        compared = at_box or found
        reference = None if compared is None else compared.lines
        self._coming = partial(self._search_held, time_s, image_rgb, reference, held_views)
        return NOTHING if found is None else found.lines

    def search_on(self) -> None:
        """View what is to be viewed of the held picture before the next one comes; `detect` does so if nobody has."""
        coming, self._coming = self._coming, None
        if coming is not None:
            coming()

    def _search_at_once(self, time_s: float, image_rgb: NDArray[np.uint8], box: Box | None) -> Detection:
        search, beside = (self.detector.start_search(image_rgb) for _ in range(2))  # the box is no place searched
        detection = search_lines(search, None if box is None else partial(beside.search_prior, box))
        self._held, self._place, self._last_s = None, None, time_s
        self._contradictions = self._contradictions + 1 if search.contradicts(detection) else 0
        return detection

    def _view_box(self, search: Search, box: Box, view_joined: ViewJoined | None, is_wide: bool) -> CropView | None:
        """The view of the box where the runway should be, of several pictures where this one is not sure.

        None where it shows neither both lines nor a clear one.
        """
        is_only = self._place is None and self._held is None and (view_joined is None or is_wide)
        view = search.view_prior(box, passes=2 if is_only else 1)
        if search.shows_pair(view, box):
            if view_joined is None or _is_sure_pair(search, view):
                return view
            joined = view_joined(search, box)
            return view if joined is None or joined.probability < view.probability else joined
        joined = None if view_joined is None else view_joined(search, box)
        is_line = view.count == 1 and view.probability >= search.config.min_lone_probability
        return joined or (view if is_line else None)

    def _view_place(self, search: Search, place: FoundPlace, view_place_joined: ViewJoined | None) -> CropView | None:
        """The view of where the runway was found, moved as the picture has moved; followed as long as it shows."""
        grey = small_grey(search.image_rgb)
        shift = picture_shift(place.grey, grey)
        moved = place.box if shift is None else move_box(place.box, shift, search.image_size[0])
        box = widen(moved)
        if place.is_faint:
            view = None if view_place_joined is None else view_place_joined(search, moved)
            is_seen = view is not None and _is_faint_pair(search, view)
        else:
            view, is_seen = search.view_prior(box, passes=max(VIEWS - 1 - len(search.crops), 1)), True
        view = view if view is not None and is_seen and search.shows_pair(view, box) else None
        self._place = None if view is None else FoundPlace(box_around(view.lines.left, view.lines.right), grey)
        return view

    def _search_quickly(
        self, image_rgb: NDArray[np.uint8], views: int, view_place_joined: ViewJoined | None
    ) -> CropView | None:
        """What so many views of a new search of this picture find, its small tiles left out.

        A pair that is not sure must lie where an approach can see it. Where they find no pair, the last view is of the
        joined pictures at the likeliest place.
        """
        search = self.detector.start_search(image_rgb)
        steps = search.steps(QUICK_TILINGS)
        alone = views if view_place_joined is None else views - 1
        while len(search.crops) < alone and next(steps, DONE) is not DONE and not search.is_decided:
            pass
        found = search.choose() if search.crops else None
        if found is not None and found.count == 2 and (_is_sure_pair(search, found) or _is_approached(found)):
            return found
        if search.crops and view_place_joined is not None and self._place is None:
            self._place = _find_faint_place(search, view_place_joined)
        return None if found is None or found.count == 2 else found

    def _search_held(
        self, time_s: float, image_rgb: NDArray[np.uint8], reference: Detection | None, views: int
    ) -> None:
        """So many views of the search under way, or of a new one of this picture, to compare with a reference."""
        if self._held is None:
            search = self.detector.start_search(image_rgb)
            self._held = HeldSearch(search, search.steps(), small_grey(image_rgb), reference)
        held = self._held
        most = len(held.search.crops) + views
        while len(held.search.crops) < most:
            if next(held.steps, DONE) is DONE or (held.reference is None and held.search.is_decided):
                return self._end_search(time_s, held)

    def _end_search(self, time_s: float, held: HeldSearch) -> None:
        self._held, self._last_s = None, time_s
        found, reference = held.search.choose(), held.reference
        has_pair = reference is not None and min(len(reference.left), len(reference.right)) > 0
        differs = reference is not None and has_pair and held.search.contradicts(reference)
        self._contradictions = self._contradictions + 1 if differs else 0
        if found is not None and found.count == 2 and (differs or not has_pair):
            self._place = FoundPlace(box_around(found.lines.left, found.lines.right), held.grey)


def _is_sure_pair(search: Search, view: CropView) -> bool:
    return view.count == 2 and view.probability >= search.config.agreeing_probability


def _is_approached(view: CropView) -> bool:
    shape = runway_shape(view.lines)
    return shape is not None and shape.is_approached


def _is_faint_pair(search: Search, view: CropView) -> bool:
    """Whether joined pictures surely show a pair that an approach can see."""
    if not _is_sure_pair(search, view):
        return False
    shape = runway_shape(view.lines)
    return shape is not None and shape.is_approached and shape.shared_rows >= MIN_FAINT_SHARED_ROWS


def _find_faint_place(search: Search, view_place_joined: ViewJoined) -> FoundPlace | None:
    """Where joined pictures show a pair, at the likeliest place of a search that has viewed the whole picture."""
    place = max(search.candidates, key=lambda view: view.region.probability, default=search.whole)
    view = view_place_joined(search, _region_box(place))
    if view is None or not _is_faint_pair(search, view):
        return None
    return FoundPlace(_region_box(view), small_grey(search.image_rgb), is_faint=True)


def _region_box(view: CropView) -> Box:
    u0, v0, u1, v1 = view.crop.to_image(view.region.box.reshape(2, 2)).ravel().tolist()
    return u0, v0, u1, v1


def _choose(search: Search, at_box: CropView | None, at_place: CropView | None) -> CropView | None:
    """Which of two views of a picture counts: the box's, unless another place is beyond doubt or more probable."""
    if at_place is None or at_box is None or at_box.count < 2:
        return at_place or at_box
    config = search.config
    doubtless = at_place.probability >= config.sure_probability and not agree(at_box.lines, at_place.lines)
    likelier = at_box.probability < min(at_place.probability, config.min_close_probability)
    return at_place if doubtless or likelier else at_box
