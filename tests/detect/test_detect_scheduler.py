"""A bounded number of views a picture, and the search of whole pictures spread over frames."""

from dataclasses import replace
from itertools import repeat

import numpy as np
import pytest
from test_detect_coarse_to_fine import Oracle, ShortSighted, check_lines, draw

from deckline.detect import DetectConfig, OnnxDetector, SearchingDetector, SearchScheduler
from deckline.detect.scheduler import OTHER_LINES, VIEWS
from deckline.detect.search import Search, detect_lines

HERE = ((600.0, 500.0, 630.0, 400.0), (700.0, 500.0, 670.0, 400.0))
THERE = ((200.0, 500.0, 230.0, 400.0), (300.0, 500.0, 270.0, 400.0))
BESIDE = ((500.0, 500.0, 300.0, 400.0), (600.0, 500.0, 380.0, 400.0))  # the camera is 2.1 heights beside it
BESIDE_BOX = (290.0, 390.0, 610.0, 510.0)
BOX = (590.0, 390.0, 710.0, 510.0)
BLANK = np.zeros((720, 1280, 3), np.uint8)
SMALL = ((900.0, 500.0, 920.0, 460.0), (970.0, 500.0, 950.0, 460.0))


class OracleDetector(SearchingDetector):
    """An oracle as a detector; it counts its views."""

    name = "oracle"

    def __init__(self, oracle: Oracle | None = None, config: DetectConfig | None = None) -> None:
        self.oracle, self.config = oracle or Oracle(), config or DetectConfig()

    def __call__(self, image_rgb, prior_box=None):
        return detect_lines(image_rgb, self.oracle, self.config, prior_box)

    def start_search(self, image_rgb):
        return Search(image_rgb, self.oracle, self.config)

    @property
    def views(self) -> int:
        return len(self.oracle.views)


def short_sighted() -> OracleDetector:
    """Sees a small runway in close views alone."""
    return OracleDetector(ShortSighted())


def detect_at(scheduler, times, pictures, box=BOX, is_sure=True):
    """The views that every picture took until the next one, and its detection. The first is never sure."""
    detector, views, found = scheduler.detector, [], []
    for number, (time_s, picture) in enumerate(zip(times, pictures, strict=False)):
        before = detector.views
        found.append(scheduler.detect(time_s, picture, box, is_sure and number > 0))
        scheduler.search_on()
        views.append(detector.views - before)
    return views, found


def detect_all(detector, pictures, period_s=0.1, search_s=1.0, **given):
    """The scheduler after pictures at a fixed period, the views that each took, and their detections."""
    scheduler = SearchScheduler(detector, search_s)
    return scheduler, *detect_at(scheduler, period_s * np.arange(len(pictures)), pictures, **given)


def test_a_sure_track_costs_one_view_a_picture_and_two_while_a_search_runs_beside_it():
    picture = draw((1280, 720), *HERE)
    scheduler, views, found = detect_all(OracleDetector(), [picture] * 40)
    for detection in found:
        check_lines(detection, *HERE)
    assert views[0] > 1 and max(views[1:]) == 2
    assert views[1:11] == [1] * 9 + [2]  # a second after the first search
    assert sum(views[1:]) < 1.5 * len(views)
    assert scheduler.update(None, None, None) == ()


def test_no_answer_waits_for_the_search_beside_a_sure_track():
    detector = OracleDetector()
    scheduler, waiting = SearchScheduler(detector, 1.0), SearchScheduler(OracleDetector(), 1.0)
    picture, views = draw((1280, 720), *HERE), []
    for number in range(40):
        before = detector.views
        detection = scheduler.detect(0.1 * number, picture, BOX, number > 0)
        views.append(detector.views - before)
        scheduler.search_on()
        other = waiting.detect(0.1 * number, picture, BOX, number > 0)
        np.testing.assert_array_equal(detection.left.points_px, other.left.points_px)
    waiting.search_on()
    assert views[1:] == [1] * 39 and detector.views > sum(views)
    assert waiting.detector.views == detector.views


@pytest.mark.parametrize(("search_s", "period_s"), [(0.0, 0.1), (1.0, 1.5)])
def test_without_a_period_or_after_a_gap_every_picture_is_searched_whole(search_s, period_s):
    _, views, found = detect_all(OracleDetector(), [draw((1280, 720), *HERE)] * 5, period_s, search_s)
    assert min(views) > 1
    for detection in found:
        check_lines(detection, *HERE)


@pytest.mark.parametrize("is_sure", [True, False])
@pytest.mark.parametrize("picture", [draw((1280, 720), *HERE), BLANK])
def test_after_the_first_no_picture_takes_more_than_three_views(picture, is_sure):
    _, views, _ = detect_all(short_sighted(), [picture] * 40, 1 / 30, is_sure=is_sure)
    assert max(views[1:]) <= VIEWS


def test_in_live_flight_no_picture_is_searched_whole_unless_all_come_slowly():
    quick = [number / 30 for number in range(40)]
    times = quick + [time_s + 5.0 for time_s in quick]
    slow = [times[-1] + 1.5 * number for number in range(1, 4)]
    scheduler = SearchScheduler(short_sighted(), 1.0, first_at_once=False)
    views, _ = detect_at(scheduler, times + slow, repeat(BLANK), None, False)
    assert max(views[: len(times) + 1]) <= VIEWS < min(views[len(times) + 1 :])


def test_a_runway_that_is_elsewhere_is_found_in_two_frames():
    pictures = [draw((1280, 720), *HERE)] * 3 + [draw((1280, 720), *THERE)] * 3
    _, _, found = detect_all(OracleDetector(), pictures)
    for detection in found[4:]:
        check_lines(detection, *THERE)


def test_a_small_runway_is_found_over_frames_while_the_picture_turns():
    """Tiles of a held picture find it; it has moved by more than its own size when the search ends."""
    rng = np.random.default_rng(3)
    ground = np.repeat(np.repeat(rng.integers(0, 40, (100, 200, 1), dtype=np.uint8), 10, axis=0), 10, axis=1)
    pictures, truth = [BLANK], [None]
    for number in range(60):
        shift = 4.0 * number
        truth.append([(u0 - shift, v0, u1 - shift, v1) for u0, v0, u1, v1 in SMALL])
        picture = np.repeat(ground[:720, int(shift) : int(shift) + 1280], 3, axis=2)
        pictures.append(np.maximum(picture, draw((1280, 720), *truth[-1])))
    _, views, found = detect_all(short_sighted(), pictures, 1 / 30, box=None, is_sure=False)
    assert max(views[1:]) <= VIEWS
    seen = [number for number, detection in enumerate(found) if len(detection.left)]
    assert seen and seen == list(range(seen[0], len(found)))  # once found it is followed
    assert seen[0] <= 45  # some 35 views at one a frame
    for number in seen:
        check_lines(found[number], *truth[number])


def make_doubtful(output, sure):
    """The output of a network that is so sure of a runway."""
    region = output.region.copy()
    region[-1] = np.logaddexp.reduce(region[:-1]) + np.log((1 - sure) / sure)
    return output._replace(region=region)


class DoubtfulDetector(OracleDetector):
    """Its views of a runway of so many px and more are sure to 0.7 alone."""

    def __init__(self, width_px):
        super().__init__()
        self.width_px = width_px

    def infer(self, view):
        output = self.oracle(view)
        lit = np.flatnonzero((view[:2] - view[2]).max(axis=(0, 1)) > 0)
        if len(lit) == 0 or np.ptp(lit) < self.width_px:
            return output
        return make_doubtful(output, 0.7)

    def start_search(self, image_rgb):
        return Search(image_rgb, self.infer, DetectConfig())


def join_views(pairs, infer):
    """A stand-in for joined pictures: one view each call, of a picture with these lines; None: of nothing."""
    rest = iter(pairs)

    def view_place_joined(search, box):
        pair = next(rest, None)
        if pair is None:
            return None
        sharp = Search(draw((1280, 720), *pair), infer, DetectConfig())
        return replace(sharp.view_prior(BESIDE_BOX if pair is BESIDE else BOX, 1), frames=8)

    return view_place_joined


@pytest.mark.parametrize(
    ("pairs", "infer", "first"),
    [
        ([HERE] * 9, Oracle(), 2),
        ([HERE] * 9, DoubtfulDetector(100).infer, None),
        ([HERE, None] * 4, Oracle(), None),
        ([BESIDE] * 9, Oracle(), None),
        ([HERE, THERE] * 4, Oracle(), None),
    ],
)
def test_a_faint_pair_of_joined_pictures_counts_where_two_in_a_row_surely_show_it_ahead(pairs, infer, first):
    scheduler, joined = SearchScheduler(OracleDetector(), 1.0), join_views(pairs, infer)
    found = [scheduler.detect(0.1 * k, BLANK, None, False, None, joined) for k in range(5)]
    seen = [k for k, detection in enumerate(found) if len(detection.left)]
    assert seen[:1] == ([] if first is None else [first])
    if seen:
        assert found[first].frames == 8
        check_lines(found[first], *HERE)


@pytest.mark.parametrize(("pair", "count"), [(HERE, 1), (BESIDE, 0)])
def test_an_unsure_pair_counts_where_an_approach_can_see_it(pair, count):
    _, _, found = detect_all(DoubtfulDetector(180), [BLANK, draw((1280, 720), *pair)], box=None, is_sure=False)
    assert (len(found[1].left) > 0) == count


def test_a_pair_ahead_goes_before_a_likelier_one_beside():
    places = ((BESIDE, BESIDE_BOX, 0.9), (HERE, BOX, 0.83))
    views = [Search(draw((1280, 720), *pair), Oracle(), DetectConfig()).view_prior(box, 1) for pair, box, _ in places]
    search = Search(BLANK, Oracle(), DetectConfig())
    search.candidates = [
        replace(view, output=make_doubtful(view.output, sure)) for view, (*_, sure) in zip(views, places, strict=True)
    ]
    assert search.accepted == search.candidates
    assert search.choose() is search.candidates[1]


class DeludedDetector(OracleDetector):
    """Sees a runway in every view of the track's box."""

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


def test_a_track_cannot_confirm_itself():
    pictures = [draw((1280, 720), *HERE)] + [draw((1280, 720), *THERE)] * 30
    scheduler, _, found = detect_all(DeludedDetector(), pictures)
    taken = [detection.left.points_px[:, 0].mean() > 500 for detection in found]
    assert taken[1:10] == [True] * 9  # the view of the box counts for a second
    assert not any(taken[20:])  # then the other place is beyond doubt
    assert scheduler.update(None, None, None) == (OTHER_LINES,)  # as long as the view of the box differs
    scheduler.reset()
    assert scheduler.update(None, None, None) == ()


def test_after_a_gap_in_live_flight_no_track_is_sure_before_the_picture_is_searched():
    scheduler = SearchScheduler(DeludedDetector(), 1.0, first_at_once=False)
    times = [*(number / 30 for number in range(40)), *(10.0 + number / 30 for number in range(60))]
    views = detect_at(scheduler, times, [*[draw((1280, 720), *HERE)] * 40, *[BLANK] * 60])[0][40:]
    searched = views.index(1)
    assert searched < 20 and max(views) == VIEWS  # pictures: two thirds of a second
    assert views[: searched - 1] == [VIEWS] * (searched - 1)
    assert views[searched : searched + 20] == [1] * 20


def test_a_detector_states_that_it_can_search_view_by_view():
    assert issubclass(OnnxDetector, SearchingDetector)
    with pytest.raises(TypeError):  # without a search of its own
        SearchingDetector()
