"""The search for the runway in an image: which crops the network views, when the search ends, which lines it returns.

A view is one inference of the network on one crop. The view of the whole image proposes places; views of overlapping
tiles propose more. At each place the views become closer until the runway fills a good half of one. The closest view
decides: in the view of a whole photograph a runway is often faint. A pair of lines may be less probable where it has
the shape of a runway ahead of the camera, above all where two views show it.
"""

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from deckline.checks import check_image
from deckline.detect.anchors import NetworkOutput, Region, decode_places, decode_region
from deckline.detect.coarse_to_fine import DetectConfig, closer_crop, decode_lines, is_final
from deckline.detect.crop import Box, Crop, box_around, crop_around, full_crop, normalise, sample_crop, tile_crops
from deckline.detect.runway_shape import runway_shape
from deckline.types import Detection, LinePoints

SAME_LINE_PX = 2.0  # median distance of one detection's points from another detection's line
SAME_LINE_SHARE = 0.05  # of the runway's width near the aircraft, where that is more
# A crop that differs by less than both from a viewed one shows nothing new.
SAME_CROP_SHIFT = 0.08  # of a view's width
SAME_CROP_SCALE = 1.15  # ratio of the steps
AHEAD_BONUS = 0.2  # in probability, of a pair ahead over one that is not; chosen with the thresholds of `DetectConfig`

Float64 = NDArray[np.float64]
Infer = Callable[[NDArray[np.float32]], NetworkOutput]  # (3, height, width) normalised crop -> outputs


@dataclass(frozen=True, eq=False)
class CropView:
    """The network's output for one crop, decoded when it is read."""

    output: NetworkOutput
    crop: Crop
    config: DetectConfig
    frames: int = 1  # whose pictures the crop shows, averaged

    @cached_property
    def region(self) -> Region:
        """The most likely box of a runway, in the network's image, and the probability of a runway."""
        return decode_region(self.output.region, self.output.box)

    @cached_property
    def lines(self) -> Detection:
        """The lines in the crop, in image px."""
        return replace(decode_lines(self.output, self.crop, self.config), frames=self.frames)

    @cached_property
    def count(self) -> int:
        """How many edge lines the crop shows, 0 to 2."""
        return sum(len(points) > 0 for points in (self.lines.left, self.lines.right))

    @cached_property
    def probability(self) -> float:
        """Of the edge lines: that of the runway times the lines' mean confidence; 0 without any line."""
        confidence = [line.confidence.mean() for line in (self.lines.left, self.lines.right) if len(line)]
        return self.region.probability * float(np.mean(confidence)) if confidence else 0.0


@dataclass(eq=False)
class Search:
    """The search of one image.

    Raises:
        ValueError: an array that is no image.
    """

    image_rgb: NDArray[np.uint8]
    """(H, W, 3)."""
    infer: Infer
    """The network."""
    config: DetectConfig
    """Crops and thresholds."""
    crops: list[Crop] = field(default_factory=list)
    """All that were viewed, in order."""
    candidates: list[CropView] = field(default_factory=list)
    """The closest view of every place of the whole image and of its largest tiles."""
    tile_candidates: list[CropView] = field(default_factory=list)
    """The closest view of every place of a smaller tile."""

    def __post_init__(self) -> None:
        self._second: dict[CropView, float] = {}  # of every pair, the probability of the best other view of its lines
        check_image(self.image_rgb)
        self.image_size = (self.image_rgb.shape[1], self.image_rgb.shape[0])

    @cached_property
    def whole(self) -> CropView:
        """The view of the whole image, inferred once."""
        return self.view_crop(full_crop(self.image_size, self.config.grid.size))

    def view_crop(self, crop: Crop) -> CropView:
        """One inference: the network's output for a crop."""
        return self.view_pixels(normalise(sample_crop(self.image_rgb, crop, self.config.grid.size)), crop)

    def view_pixels(self, pixels: NDArray[np.float32], crop: Crop, frames: int = 1) -> CropView:
        """One inference: the network's output for what so many frames show in a crop, (3, height, width)."""
        self.crops.append(crop)
        return CropView(self.infer(pixels), crop, self.config, frames)

    def search_whole(self) -> None:
        """View the likeliest places of the whole image, until the lines are beyond doubt."""
        _exhaust(self._search_places())

    def search_tiles(self) -> None:
        """View the image's tiles, and closer the likeliest place of each tile that may show a runway."""
        _exhaust(self._search_tiles())

    def steps(self, tilings: int | None = None) -> Iterator[None]:
        """The whole search in steps of one view each. All places are viewed, also when lines are beyond doubt.

        Args:
            tilings: how many of the configuration's; None: all.
        """
        yield from self._search_places(all_places=True)
        if not self.is_settled:
            yield from self._search_tiles(tilings)

    def _search_places(self, all_places: bool = False) -> Iterator[None]:
        places = decode_places(self.whole.output.region, self.whole.output.box, self.config.places)
        yield
        for place in places:
            if place.probability >= self.config.min_place_probability and (all_places or not self.is_decided):
                yield from self._approach(self.whole, place.box, self.candidates)

    def _search_tiles(self, tilings: int | None = None) -> Iterator[None]:
        for number, (count, share) in enumerate(self.config.tilings[:tilings]):
            candidates = self.tile_candidates if number else self.candidates
            for crop in tile_crops(self.image_size, self.config.grid.size, count, share):
                if self.is_decided:
                    return
                tile = self.view_crop(crop)
                yield
                if tile.region.probability >= self.config.min_tile_probability:
                    yield from self._approach(tile, tile.region.box, candidates)

    def _approach(self, view: CropView, box: Float64, candidates: list[CropView]) -> Iterator[None]:
        """Ever closer views of a box of a view; the last one becomes a candidate, unless a view shows no runway."""
        for _ in range(self.config.max_passes - 1):
            crop = closer_crop(box, view.crop, self.image_size, self.config)
            unsure = view is self.whole and view.probability < self.config.sure_probability
            if is_final(crop, view.crop, self.config) and not unsure:
                break
            if any(_shows_the_same(crop, seen, self.config.grid.width) for seen in self.crops):
                if view is self.whole and _shows_the_same(crop, view.crop, self.config.grid.width):
                    break
                return
            view = self.view_crop(crop)
            yield
            if view.region.probability < self.config.min_view_probability:
                return
            box = view.region.box
        if view not in candidates:  # by identity: two places may end at the whole, which cannot agree with itself
            candidates.append(view)
            self._confirm(view)

    def _confirm(self, view: CropView) -> None:
        """Note which of the pairs so far a view's pair of lines confirms."""
        if view.count < 2 or view in self._second:
            return
        same = [other for other in self._second if agree(view.lines, other.lines)]
        for other in same:
            self._second[other] = max(self._second[other], view.probability)
        self._second[view] = max((other.probability for other in same), default=0.0)

    def search_prior(self, box: Box) -> CropView | None:
        """The closest view of a box in the image, with both lines about its middle; None where they are not seen."""
        view = self.view_prior(box, self.config.max_passes)
        return view if self.shows_pair(view, box) else None

    def view_prior(self, box: Box, passes: int) -> CropView:
        """The closest view of a box in the image, after so many views at most."""
        view = self.view_crop(
            crop_around(box, self.image_size, self.config.grid.size, self.config.fill, self.config.min_width_px)
        )
        for _ in range(passes - 1):
            crop = closer_crop(view.region.box, view.crop, self.image_size, self.config)
            if view.region.probability < self.config.min_prior_probability or is_final(crop, view.crop, self.config):
                break
            view = self.view_crop(crop)
        return view

    def shows_pair(self, view: CropView, box: Box) -> bool:
        """Whether a view of a box where the runway should be shows both lines, about the middle of the box."""
        is_seen = view.count == 2 and view.probability >= self.config.min_prior_probability
        return is_seen and _is_centred_in(view.lines, box)

    def contradicts(self, detection: Detection) -> bool:
        """Whether clear pairs of lines were found, and no pair that counts is this detection's."""
        pairs = [view for view in self.accepted if view.count == 2]
        return any(map(self._is_clear, pairs)) and not any(agree(view.lines, detection) for view in pairs)

    @property
    def accepted(self) -> list[CropView]:
        """Candidates whose lines count."""
        clear = [view for view in self.candidates if self._is_clear(view) or self._is_ahead(view)]
        return clear + [view for view in self.tile_candidates if self._is_clear_tile(view) or self._is_ahead(view)]

    def _is_clear(self, view: CropView) -> bool:
        if view.count < 2:
            return view.count == 1 and self.clear_probability(view) >= self.config.min_lone_probability
        return (
            view.probability >= self.config.min_close_probability
            or self.clear_probability(view) >= self.config.min_probability
        )

    def _is_clear_tile(self, view: CropView) -> bool:
        """Whether a pair of lines of a small tile's place counts: the whole image shows a runway somewhere."""
        whole = self.whole.region.probability
        close = view.probability >= self.config.min_close_probability
        return view.count == 2 and close and whole >= self.config.min_view_probability

    def _is_ahead(self, view: CropView) -> bool:
        """Whether views show a pair of lines, probable enough for a runway that lies ahead."""
        both = view.probability * self._second.get(view, 0.0)
        alone = view.probability >= self.config.min_ahead_alone_probability
        if both < self.config.min_ahead_probability and not alone:
            return False
        shape = runway_shape(view.lines)
        return shape is not None and shape.is_ahead(self.image_size[0])

    def clear_probability(self, view: CropView) -> float:
        """Of a view's lines, times the runway's in the whole image."""
        return view.probability if view is self.whole else view.probability * self.whole.region.probability

    @property
    def is_sure(self) -> bool:
        """Whether a candidate's pair of lines is beyond doubt."""
        whole = self.whole.region.probability
        sure, clear = self.config.sure_probability, self.config.sure_clear_probability
        return any(
            view.probability >= sure or view.probability * whole >= clear for view in self.accepted if view.count == 2
        )

    @property
    def is_settled(self) -> bool:
        """Whether tiles could find nothing better: a pair lies ahead, or is clear in the whole image too."""
        clear = self.config.sure_clear_probability
        pairs = [view for view in self.accepted if view.count == 2]
        return any(self._is_ahead(view) or self.clear_probability(view) >= clear for view in pairs)

    @property
    def is_decided(self) -> bool:
        """Whether a pair is beyond doubt, or two candidates agree on one, and tiles could find nothing better."""
        likely = [view for view in self.accepted if view.probability >= self.config.agreeing_probability]
        pairs = combinations([view.lines for view in likely if view.count == 2], 2)
        return self.is_settled and (self.is_sure or any(agree(one, other) for one, other in pairs))

    def choose(self) -> CropView | None:
        """The candidate whose lines count: the likeliest pair, above all one ahead, else the likeliest lone line."""
        return max(self.accepted, key=self._rank, default=None)

    def _rank(self, view: CropView) -> tuple[int, float]:
        return view.count, view.probability + (AHEAD_BONUS if self._is_ahead(view) else 0.0)


def detect_lines(
    image_rgb: NDArray[np.uint8], infer: Infer, config: DetectConfig, prior_box: Box | None = None
) -> Detection:
    """`search_lines` of an image (H, W, 3), and of a box in it where the runway should be.

    Raises:
        ValueError: anything but such an image, or a box that is empty or not finite.
    """
    search = Search(image_rgb, infer, config)
    return search_lines(search, None if prior_box is None else partial(search.search_prior, prior_box))


def search_lines(search: Search, search_prior: Callable[[], CropView | None] | None = None) -> Detection:
    """Both runway lines of a search, in the image's pixels; a line that is not seen has no points.

    The whole image is always searched, so that a wrong prior hides no certain lines. Where no lines are certain, the
    prior's box is viewed. A pair of lines counts there if it lies about the middle of the box and agrees with a lone
    line of the search. It replaces a pair of the search that is less probable, or any pair if it would be accepted
    without a prior. Tiles are searched while no pair lies ahead or is clear.

    Args:
        search_prior: views the prior's box; None: there is no prior.
    """
    search.search_whole()
    found = search.choose()
    if search_prior is not None and not search.is_sure:
        at_prior = search_prior()
        if at_prior is not None and (found is None or _is_better(at_prior, found, search.config)):
            return at_prior.lines
    if not search.is_settled:
        search.search_tiles()
        found = search.choose()
    return Detection(LinePoints.empty(), LinePoints.empty()) if found is None else found.lines


def _exhaust(steps: Iterator[None]) -> None:
    deque(steps, maxlen=0)


def _is_better(at_prior: CropView, found: CropView, config: DetectConfig) -> bool:
    """Whether both lines of a prior's box replace what a search found: an unsure pair, or one line of them."""
    if found.count == 2:
        return at_prior.probability >= min(found.probability, config.min_close_probability)
    pairs = ((found.lines.left, at_prior.lines.left), (found.lines.right, at_prior.lines.right))
    return all(_distance_px(one.points_px, other.points_px) <= SAME_LINE_PX for one, other in pairs if len(one))


def _is_centred_in(detection: Detection, box: Box) -> bool:
    u0, v0, u1, v1 = box_around(detection.left, detection.right)
    return box[0] <= (u0 + u1) / 2 <= box[2] and box[1] <= (v0 + v1) / 2 <= box[3]


def agree(one: Detection, other: Detection) -> bool:
    """Whether two detections have the same two lines."""
    pairs = ((one.left.points_px, other.left.points_px), (one.right.points_px, other.right.points_px))
    near = [points[points[:, 1].argmax()] for points, _ in pairs]
    least = max(SAME_LINE_PX, SAME_LINE_SHARE * float(np.linalg.norm(near[0] - near[1])))
    return all(max(_distance_px(a, b), _distance_px(b, a)) <= least for a, b in pairs)


def _distance_px(points_px: Float64, line_px: Float64) -> float:
    """Median distance of points (N, 2) from the straight line through others (M, 2); infinite for M < 2."""
    if len(line_px) < 2:
        return float("inf")
    middle = line_px.mean(axis=0)
    _, _, axes = np.linalg.svd(line_px - middle)
    return float(np.median(np.abs((points_px - middle) @ axes[1])))


def _shows_the_same(one: Crop, other: Crop, width: int) -> bool:
    """Whether two crops, width px wide in the network's image, show nearly the same."""
    shift_px = max(abs(one.left - other.left), abs(one.top - other.top))
    scale = max(one.step / other.step, other.step / one.step)
    return shift_px <= SAME_CROP_SHIFT * width * other.step and scale <= SAME_CROP_SCALE
