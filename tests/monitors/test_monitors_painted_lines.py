"""Paint under the detected lines, measured without a network."""

from dataclasses import replace

import numpy as np
import pytest

from approach_scene import STILL
from deckline.config import Tracking
from deckline.dehaze.base import IdentityDehazer
from deckline.flight import Flight
from deckline.geometry import Camera, distort
from deckline.monitors.painted_lines import PaintMonitor, find_paint
from deckline.types import (
    DepthMode,
    Detection,
    EdgeKind,
    Frame,
    LinePoints,
    LineVisibility,
    PixelLine,
    Reason,
    RunwayEstimate,
)
from detect.drawn_deck import BOTTOM, TOP, at, deck
from monitors.lenses import LENSES, through_lens
from track.steady_view import reasons

EDGES = [0.0, 1.0]
CENTRED = [0.0, 0.5, 1.0]


def line(share, near=BOTTOM, far=TOP):
    """The line of the deck at a share of the runway's width, between two rows."""
    ends = np.array([[at(near, share), near], [at(far, share), far]])
    normal = np.array([ends[0, 1] - ends[1, 1], ends[1, 0] - ends[0, 0]])
    normal = normal / np.linalg.norm(normal)
    return PixelLine(np.array([*normal, -normal @ ends[0]]), np.zeros(0, bool), ends, 0.3)


def find(stripes, left=0.0, right=1.0, haze=0.0, **kwargs):
    image = deck(stripes, **kwargs).astype(float)
    return find_paint((image * (1 - haze) + 170 * haze).astype(np.uint8), line(left), line(right))


def test_paint_is_found_under_lines_that_lie_on_it():
    found = find(CENTRED)
    assert found.left > 0.95 and found.right > 0.95
    assert found.centre == pytest.approx(0.5, abs=0.01)
    assert max(found.excess().values()) < 0


@pytest.mark.parametrize(("contrast", "is_painted"), [(0.4, True), (0.2, False)])
def test_faded_paint_counts_from_a_third_of_the_other_lines_contrast(contrast, is_painted):
    image = deck(EDGES).astype(float)
    image[:, :400] = 70.0 + contrast * (image[:, :400] - 70.0)  # the left line's half
    assert (find_paint(image.astype(np.uint8), line(0.0), line(1.0)).left > 0.5) is is_painted


@pytest.mark.parametrize(("left", "right", "side"), [(0.15, 1.0, "left"), (0.0, 0.85, "right"), (-0.1, 1.0, "left")])
def test_a_line_beside_its_paint_is_measured(left, right, side):
    excess = find(EDGES, left, right).excess()
    assert excess[side] > 0.9
    assert all(value < 0 for what, value in excess.items() if what != side)


def test_a_line_on_another_painted_line_is_shown_by_the_centre_line_alone():
    """The right edge is gone; another line lies 27 % farther out, as beside the paper's deck."""
    found = find([0.0, 0.5, 1.27], right=1.27)
    assert found.left > 0.95 and found.right > 0.95
    assert found.centre == pytest.approx(0.5 / 1.27, abs=0.015)
    assert found.excess()["centre left"] > 0.5 and found.excess()["centre right"] < 0
    assert find([-0.27, 0.5, 1.0], left=-0.27).excess()["centre right"] > 0.5


def test_what_could_be_several_lines_is_no_centre_line():
    assert find([0.0, 0.33, 0.7, 1.0]).centre is None
    assert find(EDGES).centre is None
    assert find([0.0, 0.29, 1.0]).centre is None  # too far off for the edges to be the wrong ones


def test_other_lines_beside_the_edges_change_nothing():
    excess = find([-0.28, 0.0, 0.5, 1.0, 1.27]).excess()
    assert set(excess) == {"left", "right", "centre left", "centre right"} and max(excess.values()) < 0


def test_haze_hides_paint_until_nothing_is_measured():
    assert find(CENTRED, haze=0.6).left > 0.9
    assert find(CENTRED, 0.15, haze=0.98).excess() == {}
    assert find([], 0.0, 1.0).excess() == {}


def test_lines_without_any_paint_do_not_contradict_each_other():
    """Lights in rows of their own, as along a runway at night."""
    image = deck([])
    for v in range(TOP, BOTTOM, 6):
        for share, row in ((0.0, v), (1.0, v + 3)):
            u = round(float(at(row, share)))
            image[row : row + 2, u - 1 : u + 2] = 220
    assert find_paint(image, line(0.0), line(1.0)).excess() == {}


def test_too_few_rows_or_too_narrow_a_runway_measure_nothing():
    image = deck(CENTRED)
    assert find_paint(image, line(0.0, 200, 194), line(1.0, 200, 194)).excess() == {}
    assert find_paint(image, line(0.48), line(0.51)).excess() == {}
    narrow = find_paint(deck([0.0, 0.046, 0.092]), line(0.0), line(0.092))
    assert 12 < narrow.width_px < 24 and narrow.left > 0.9 and narrow.centre is None
    assert find_paint(image, line(1.0), line(0.0)).excess() == {}
    outside = replace(line(0.0), ends_px=line(0.0).ends_px + np.array([0.0, 600.0]))
    assert find_paint(image, outside, outside).excess() == {}


@pytest.mark.parametrize(("row", "expected"), [(350, True), (160, False)])
def test_rows_without_deck_beside_a_line_are_not_sampled(row, expected):
    """The left line leaves the picture at a row; a line that is cut off has no side that is darker."""
    cut = int(at(row, 0.0))
    moved = [
        replace(one, coefficients=one.coefficients + np.array([0.0, 0.0, cut * one.coefficients[0]]))
        for one in (line(0.0), line(1.0))
    ]
    found = find_paint(deck(EDGES)[:, cut:], *moved)
    assert (found.left is not None and found.left > 0.95) is expected
    assert expected or found.excess() == {}


def test_the_picture_is_left_as_it_is_and_odd_sizes_are_seen():
    image = deck(CENTRED, size=(479, 801))
    before = image.copy()
    assert find_paint(image, line(0.0), line(1.0)).left > 0.9
    assert np.array_equal(image, before)


def shown(index, stripes, left=0.0, right=1.0, step_s=0.5):
    image = deck(stripes)
    image[0, 0] = index
    frame = Frame(f"{index}.png", step_s * index, image, Camera.from_fov(800, 480, 1.0))
    return frame, RunwayEstimate(LineVisibility.BOTH, DepthMode.NONE, {"left": line(left), "right": line(right)}, {})


def flags(views, every_s=0.5, edge=None, monitor=None):
    """Whether each frame is flagged."""
    monitor, detection = monitor or PaintMonitor(every_s), Detection(LinePoints.empty(), LinePoints.empty(), edge=edge)
    found = [monitor.update(frame, estimate, detection) for frame, estimate in views]
    assert {flag.reason for flags in found for flag in flags} <= {Reason.PAINT}
    return [bool(flags) for flags in found]


def test_only_what_lasts_is_flagged_until_it_is_over():
    wrong = [shown(k, EDGES, left=0.15) for k in range(5)]
    assert flags(wrong) == [False, False, True, True, True]
    right = [shown(k, CENTRED) for k in range(5, 9)]
    assert not flags([*wrong, *right])[-1]
    assert not any(flags([shown(k, CENTRED, left=0.15 * (k % 3 == 0)) for k in range(12)]))


def test_rare_contradictions_between_pictures_without_paint_are_not_flagged():
    """Haze in all pictures but every fourth."""
    views = [shown(k, EDGES if k % 4 == 0 else [], left=0.15) for k in range(24)]
    assert not any(flags(views))


def test_painted_lines_are_checked_at_the_rate():
    wrong = [shown(k, EDGES, left=0.15, step_s=0.1) for k in range(16)]
    seen = flags(wrong)
    assert seen.index(True) == 10  # the third check
    assert not any(flags(wrong, every_s=0.0))
    assert flags(wrong, edge=EdgeKind.PAINT)[-1]
    assert not any(flags(wrong, edge=EdgeKind.LIGHTS))
    assert not any(flags([(frame, replace(estimate, pixel_lines={})) for frame, estimate in wrong]))


@pytest.mark.parametrize("lens", LENSES)
def test_a_distorted_picture_is_checked_without_its_distortion(lens):
    for left, is_wrong in ((0.15, True), (0.0, False)):
        views = []
        for k in range(8):
            frame, estimate = shown(k, EDGES, left=left)
            bent = through_lens(frame, lens)
            lines = {
                side: replace(line, ends_px=distort(line.ends_px, bent.camera))
                for side, line in estimate.pixel_lines.items()
            }
            views.append((bent, replace(estimate, pixel_lines=lines)))
        assert flags(views)[-1] is is_wrong


def test_another_flight_begins_without_a_flag():
    monitor = PaintMonitor(0.5)
    assert flags([shown(k, EDGES, left=0.15) for k in range(4)], monitor=monitor)[3]
    monitor.reset()
    assert not flags([shown(0, CENTRED)], monitor=monitor)[0]


def detector(left):
    """A detector that sees these lines in every picture."""
    v = np.linspace(TOP + 1, BOTTOM - 1, 30)
    sides = [LinePoints(np.column_stack([at(v, share), v]), np.ones(30), np.full(30, 0.3)) for share in (left, 1.0)]
    return lambda image_rgb, prior_box=None: Detection(*sides)


@pytest.mark.parametrize(
    ("left", "paint_s", "expected"), [(0.15, 0.5, [Reason.PAINT]), (0.0, 0.5, []), (0.15, 0.0, [])]
)
def test_a_flight_flags_what_its_detector_takes_for_a_line(left, paint_s, expected):
    flight = Flight(replace(STILL, tracking=Tracking(paint_s=paint_s)), IdentityDehazer(), detector(left))
    results = [flight(shown(k, EDGES)[0]) for k in range(4)]
    assert reasons(results[-1].track.flags) == expected
    given = Flight(STILL, IdentityDehazer(), detector(left))
    results = [given(shown(k, EDGES)[0], detection=detector(left)(None)) for k in range(4)]
    assert not results[-1].track.flags
