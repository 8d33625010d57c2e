"""A track's close looks, and the search of the whole picture beside them."""

import numpy as np
import pytest
from test_detect_coarse_to_fine import Oracle, check_lines, draw

from deckline.detect import DetectConfig, SearchScheduler
from deckline.detect.search import Search, detect_lines

HERE = ((600.0, 500.0, 630.0, 400.0), (700.0, 500.0, 670.0, 400.0))
THERE = ((200.0, 500.0, 230.0, 400.0), (300.0, 500.0, 270.0, 400.0))
BOX = (590.0, 390.0, 710.0, 510.0)


class Looking:
    """The oracle as a detector; a close look of up to `near_px` px a network pixel sees what `looks_like` shows."""

    def __init__(self, looks_like=None, near_px: float = 1.5) -> None:
        self.oracle = Oracle()
        self.looks_like = looks_like
        self.near_px = near_px

    def __call__(self, image_rgb, prior_box=None):
        return detect_lines(image_rgb, self.oracle, DetectConfig(), prior_box)

    def start_search(self, image_rgb):
        return Search(image_rgb, self.oracle, DetectConfig())

    @property
    def looks(self) -> int:
        return len(self.oracle.views)


def watch_over(detector, pictures, period_s=0.1, search_s=1.0, tracked=True):
    """SearchScheduler pictures at a fixed period; returns the watch, and the looks that each took."""
    watch, looks, found = SearchScheduler(detector, search_s), [], []
    for number, picture in enumerate(pictures):
        before = detector.looks
        found.append(watch(number * period_s, picture, BOX, tracked and number > 0))
        looks.append(detector.looks - before)
    return watch, looks, found


def test_a_sure_track_costs_one_look_a_picture_and_two_while_a_search_runs_beside_it():
    picture = draw((1280, 720), *HERE)
    watch, looks, found = watch_over(Looking(), [picture] * 40)
    for detection in found:
        check_lines(detection, *HERE)
    assert looks[0] > 1 and max(looks[1:]) == 2
    assert looks[1:11] == [1] * 9 + [2]  # a second after the first search
    assert sum(looks[1:]) < 1.5 * len(looks)
    assert not watch.is_contradicted


@pytest.mark.parametrize(("search_s", "tracked", "period_s"), [(0.0, True, 0.1), (1.0, False, 0.1), (1.0, True, 1.5)])
def test_without_a_track_or_when_told_so_or_after_a_gap_every_picture_is_searched_whole(search_s, tracked, period_s):
    _, looks, _ = watch_over(Looking(), [draw((1280, 720), *HERE)] * 5, period_s, search_s, tracked)
    assert min(looks) > 1


def test_a_runway_that_is_gone_is_searched_at_once():
    pictures = [draw((1280, 720), *HERE)] * 3 + [draw((1280, 720), *THERE)] * 2
    _, _, found = watch_over(Looking(), pictures)
    check_lines(found[3], *THERE)


class Deluded(Looking):
    """Sees a runway wherever it is told to look closely."""

    def start_search(self, image_rgb):
        search = super().start_search(image_rgb)
        true = search.infer
        delusion = Search(draw((1280, 720), *HERE), self.oracle, DetectConfig()).search_prior(BOX)

        def infer(view):
            crop = search.crops[-1]
            near = abs(crop.left - delusion.crop.left) < 30 and crop.step == pytest.approx(delusion.crop.step, rel=0.2)
            return delusion.output if near else true(view)

        search.infer = infer
        return search


def test_a_track_cannot_hold_itself_up():
    pictures = [draw((1280, 720), *HERE)] + [draw((1280, 720), *THERE)] * 30
    watch, _, found = watch_over(Deluded(), pictures)
    taken = [detection.left.points_px[:, 0].mean() > 500 for detection in found]
    assert taken[1:10] == [True] * 9  # the close look is believed for a second
    assert not any(taken[20:])  # then every picture is searched whole, and its runway is beyond doubt
    assert watch.is_contradicted  # as long as the close look differs


def test_a_picture_is_checked():
    with pytest.raises(ValueError, match="uint8"):
        SearchScheduler(Looking(), 1.0)(0.0, np.zeros((5, 5, 3)), BOX, True)
