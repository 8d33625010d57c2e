"""Coarse-to-fine inference with a network that knows the truth: which crops it sees and what is returned."""

from collections.abc import Callable

import numpy as np
import pytest
from anchor_logits import GRID, logits_of
from hypothesis import given, settings
from hypothesis import strategies as st

from deckline.detect.anchors import NetworkOutput
from deckline.detect.coarse_to_fine import DetectConfig, largest_collinear_subset
from deckline.detect.crop import crop_around, normalise, sample_crop
from deckline.detect.search import CropView, Search, detect_lines
from deckline.types import Detection
from deckline_lab.train.line_targets import encode, encode_region

Line = tuple[float, float, float, float]  # u0, v0, u1, v1
BLACK = np.zeros((288, 512, 3), np.uint8)  # as large as the network's own image: its pixels are the image's
NO_REGION = np.log(encode_region(None, (32, 18))[0] + 1e-12)
NONE = (np.zeros((2, 72, 129), dtype=np.float32), NO_REGION, np.zeros((4, 18, 32), dtype=np.float32))


class Oracle:
    """Finds the two brightest pixels of colour channels 0 and 1 per row: red is left, green is right."""

    def __init__(self) -> None:
        self.views: list[np.ndarray] = []

    def __call__(self, view: np.ndarray) -> NetworkOutput:
        self.views.append(view)
        lines = []
        for channel in (0, 1):
            level = view[channel] - view[2]
            rows = np.flatnonzero(level.max(axis=1) > 0.5 * level.max())
            weight = np.clip(level[rows] - 0.3 * level.max(), 0, None)
            lines.append(np.stack([(weight * np.arange(512)).sum(1) / weight.sum(1), rows], axis=1))
        points = np.concatenate(lines)
        if not len(points):
            return NetworkOutput(*NONE)
        box = np.concatenate([points.min(axis=0), points.max(axis=0)])
        classes, offsets, _ = encode_region([*box[:2], *(box[2:] + 1e-3)], (32, 18))
        cells = [encode(line, np.ones(len(line)), GRID) for line in lines]
        return NetworkOutput(np.stack([logits_of(cell) for cell in cells]), np.log(classes + 1e-12), offsets)


class ChangedAtFirst(Oracle):
    """What it gives for its first view is changed."""

    def __init__(self, change: Callable[[NetworkOutput], NetworkOutput]) -> None:
        super().__init__()
        self.change = change

    def __call__(self, view: np.ndarray) -> NetworkOutput:
        output = super().__call__(view)
        return self.change(output) if len(self.views) == 1 else output


def draw(size, left, right) -> np.ndarray:
    """Lines (u0, v0, u1, v1) three pixels wide, red and green, exact to the sub-pixel."""
    width, height = size
    image = np.zeros((height, width, 3))
    v, u = np.mgrid[0:height, 0:width]
    for channel, (u0, v0, u1, v1) in enumerate((left, right)):
        middle = u0 + (v - v0) * (u1 - u0) / (v1 - v0)
        cover = np.clip(2.0 - np.abs(u - middle), 0, 1) * ((v >= min(v0, v1)) & (v <= max(v0, v1)))
        image[..., channel] = 220 * cover
    return image.astype(np.uint8)


def check_lines(detection: Detection, left: Line, right: Line) -> None:
    """Both lines are there, to a fifth of a pixel."""
    for points, (u0, v0, u1, v1) in ((detection.left, left), (detection.right, right)):
        assert len(points) >= 3
        expected = u0 + (points.points_px[:, 1] - v0) * (u1 - u0) / (v1 - v0)
        assert np.median(np.abs(points.points_px[:, 0] - expected)) < 0.2


def count_lines(detection: Detection) -> int:
    return (len(detection.left) > 0) + (len(detection.right) > 0)


@settings(max_examples=15, deadline=None)
@given(st.floats(100, 1100), st.floats(60, 600), st.floats(12, 90))
def test_points_are_in_full_image_pixels(u, v, width):
    height = 0.7 * width
    left = (u, v + height, u + 0.3 * width, v)
    right = (u + width, v + height, u + 0.6 * width, v)
    detection = detect_lines(draw((1280, 720), left, right), Oracle(), DetectConfig())
    check_lines(detection, left, right)
    a, b, c, d = detection.region_px
    assert a <= u and c >= u + width and b <= v and d >= v + height


def test_a_far_runway_takes_refinement_passes_and_a_near_one_none():
    far, near = Oracle(), Oracle()
    detect_lines(draw((1280, 720), (600, 340, 604, 330), (620, 340, 612, 330)), far, DetectConfig())
    detect_lines(draw((1280, 720), (200, 700, 500, 150), (1080, 700, 780, 150)), near, DetectConfig())
    assert 2 <= len(far.views) <= 3
    assert len(near.views) == 1


def test_left_right_of_right_is_not_seen():
    image = draw((640, 360), (100, 300, 200, 50), (500, 300, 400, 50))
    swapped = image[:, :, [1, 0, 2]]
    assert len(detect_lines(image, Oracle(), DetectConfig()).left) > 10
    detection = detect_lines(swapped, Oracle(), DetectConfig(tilings=()))
    assert count_lines(detection) == 0


def unsure_output(sure: float, left: float, right: float, cells: tuple[int, int] = (40, 60)) -> NetworkOutput:
    """Of a network that is so sure of a runway, and of thirty rows that upright lines cross at these cells."""
    rows = np.full((2, 72, 129), -20.0, dtype=np.float32)
    rows[:, :, -1] = 0.0  # no line on any row
    for k, (chance, cell) in enumerate(((left, cells[0]), (right, cells[1]))):
        rows[k, 20:50, cell] = np.log((chance + 1e-9) / (1 - chance))  # but on thirty
    classes, offsets, _ = encode_region([110.0, 60.0, 400.0, 230.0], (32, 18))
    region = np.log(np.append(sure * classes[:-1], 1 - sure) + 1e-12).astype(np.float32)
    return NetworkOutput(rows, region, offsets)


@pytest.mark.parametrize(
    ("runway", "left", "right", "seen"),
    [
        (0.99, 0.8, 0.8, (True, True)),  # runway and rows are probable together
        (0.8, 0.95, 0.95, (True, True)),
        (0.5, 0.7, 0.7, (False, False)),
        (0.3, 0.99, 0.99, (False, False)),
        (0.99, 0.0, 0.75, (False, False)),  # a lone line needs more
        (0.99, 0.0, 0.98, (False, True)),
        (0.99, 0.98, 0.0, (True, False)),
    ],
)
def test_thresholds_of_both_lines_and_of_a_lone_one(
    runway: float, left: float, right: float, seen: tuple[bool, bool]
) -> None:
    output = unsure_output(runway, left, right)
    found = detect_lines(np.zeros((720, 1280, 3), np.uint8), lambda view: output, DetectConfig())
    assert {len(found.left), len(found.right)} <= {0, 30}
    assert (len(found.left) > 0, len(found.right) > 0) == seen


@pytest.mark.parametrize(("tile", "whole", "counts"), [(0.99, 0.9, True), (0.5, 0.9, False), (0.99, 0.0, False)])
def test_a_pair_of_lines_of_a_small_tile_counts_where_the_picture_shows_a_runway_somewhere(tile, whole, counts):
    search = Search(BLACK, lambda view: unsure_output(whole, 0.0, 0.0), DetectConfig())
    view = CropView(unsure_output(tile, 0.95, 0.95), search.whole.crop, search.config)
    search.tile_candidates = [view]
    assert search.accepted == [view] * counts


@pytest.mark.parametrize(
    ("box", "is_whole"), [((10.0, 8.0, 500.0, 280.0), True), ((200.0, 100.0, 300.0, 200.0), False)]
)
def test_two_places_that_lead_to_one_view_are_one_candidate(box: Line, is_whole: bool) -> None:
    """Of a runway that fills the whole picture, and of a small one: a view cannot agree with itself."""
    output = three_lines((40.0, 480.0, 246.0))
    _, offsets, _ = encode_region(box, (32, 18))
    shares = np.full(32 * 18 + 1, 1e-9)
    shares[[100, 400]], shares[-1] = 0.41, 0.18  # every cell has the same box
    output = output._replace(region=np.log(shares).astype(np.float32), box=offsets)
    search = Search(BLACK, lambda view: output, DetectConfig())
    search.search_whole()
    assert search.accepted == search.candidates
    assert [view is search.whole for view in search.candidates] == [is_whole]
    assert search.candidates[0].count == 2
    assert not search.is_decided


def test_two_places_in_the_same_rows_are_two_candidates():
    output = three_lines((40.0, 480.0, 246.0))
    (_, left, _), (_, right, _) = (encode_region((u, 100.0, u + 100.0, 200.0), (32, 18)) for u in (60.0, 360.0))
    shares = np.full(32 * 18 + 1, 1e-9)
    shares[[100, 112]], shares[-1] = 0.41, 0.18
    output = output._replace(region=np.log(shares).astype(np.float32), box=np.where(np.arange(32) < 10, left, right))
    search = Search(BLACK, lambda view: output, DetectConfig(max_passes=2))
    search.search_whole()
    assert [view.crop.left < 120 for view in search.candidates] == [True, False]


def test_a_line_of_two_rows_is_not_returned():
    image = draw((640, 360), (100, 300, 200, 50), (500, 300, 498, 292))
    detection = detect_lines(image, Oracle(), DetectConfig())
    assert len(detection.left) > 10
    assert len(detection.right) == 0


def three_lines(x: tuple[float, float, float]) -> NetworkOutput:
    """The output of a network of three lines for upright ones at x px."""
    cells = [encode([(at, 40.0), (at, 240.0)], [True, True], GRID) for at in x]
    classes, offsets, _ = encode_region([x[0], 40.0, x[1], 240.0], (32, 18))
    return NetworkOutput(np.stack([logits_of(cell) for cell in cells]), np.log(classes + 1e-12), offsets)


def test_a_centre_line_lies_between_the_edges_or_is_not_seen():
    detection = detect_lines(BLACK, lambda view: three_lines((100.0, 400.0, 246.0)), DetectConfig(max_passes=1))
    np.testing.assert_allclose(detection.centre.points_px[:, 0], 246.0, atol=0.1)
    assert len(detection.centre) == len(detection.left) == len(detection.right) > 40
    beside = detect_lines(BLACK, lambda view: three_lines((100.0, 400.0, 446.0)), DetectConfig(max_passes=1))
    assert len(beside.centre) == 0
    assert len(beside.left) == len(beside.right) == len(detection.left)


def test_points_on_another_marking_are_left_out_and_a_line_in_halves_is_not_seen():
    y = GRID.row_y
    line, other = 100.0 + 0.5 * y, 450.0 - 0.2 * y
    even = np.ones(len(y))
    seen = largest_collinear_subset(np.where(y < 180, line, other), y, even, 8.0)
    np.testing.assert_array_equal(seen, y < 180)
    bent = line + 6.0 * ((y - y.mean()) / np.ptp(y) * 2) ** 2  # as a lens does
    assert largest_collinear_subset(bent, y, even, 8.0).all()
    for share, lines in ((0.7, 2), (0.35, 1)):
        left = np.where(
            np.arange(72) < share * 72, 30.0, np.where(np.arange(72) % 2, 60.0, 90.0) + np.arange(72) % 5 * 5
        )
        output = three_lines((120.0, 400.0, 246.0))
        output.rows[0] = logits_of(left.astype(np.float32))
        found = detect_lines(BLACK, lambda view, output=output: output, DetectConfig(max_passes=1))
        assert count_lines(found) == lines
    assert len(found.right) > 40


def flat_line(slope: float, sides: tuple[float, float] = (60.0, 140.0)) -> NetworkOutput:
    """A hybrid network's output for two lines v = side + slope u that only its columns see."""
    turned = GRID.transposed
    columns = [logits_of(turned.cell_from_x(side + slope * turned.row_y), turned) for side in sides]
    classes, offsets, _ = encode_region([1.0, 55.0, 510.0, 200.0], (32, 18))
    rows = np.stack([logits_of(np.full(GRID.rows, np.nan))] * 2)
    return NetworkOutput(rows, np.log(classes + 1e-12), offsets, np.stack(columns))


def test_flat_lines_come_from_columns():
    detection = detect_lines(BLACK, lambda view: flat_line(0.1), DetectConfig(max_passes=1))
    for points, side in ((detection.left, 60.0), (detection.right, 140.0)):
        assert len(points) == GRID.cells
        u, v = points.points_px.T
        np.testing.assert_allclose(v, side + 0.1 * u, atol=0.02)
        # 0.12 cells of 4 px along v are ten times as much along u.
        np.testing.assert_allclose(points.sigma_px, 0.12 * 4 / 0.1, rtol=0.02)
    rows_alone = detect_lines(BLACK, lambda view: flat_line(0.1)._replace(columns=None), DetectConfig(max_passes=1))
    assert len(rows_alone.left) == len(rows_alone.right) == 0


FAR = ((600.0, 340.0, 604.0, 330.0), (620.0, 340.0, 612.0, 330.0))  # a dozen pixels of 1280
WRONG = [
    (50.0, 60.0, 130.0, 100.0),
    (560.0, 300.0, 660.0, 360.0),
    (-30.0, -20.0, 1400.0, 900.0),
    (595.0, 0.0, 603.0, 719.0),
]


class ShortSighted(Oracle):
    """Sees no runway that is narrower than 40 px of its view."""

    def __call__(self, view: np.ndarray) -> NetworkOutput:
        coloured = np.flatnonzero(np.abs(view[:2] - view[2]).max(axis=(0, 1)) > 1.0)
        if len(coloured) and np.ptp(coloured) >= 40:
            return super().__call__(view)
        self.views.append(view)
        return NetworkOutput(*NONE)


@pytest.mark.parametrize("box", WRONG)
def test_a_prior_changes_nothing_where_the_search_sees_both_lines(box):
    image = draw((1280, 720), *FAR)
    searched = detect_lines(image, Oracle(), DetectConfig())
    with_prior = detect_lines(image, Oracle(), DetectConfig(), box)
    assert len(searched.left) > 5
    np.testing.assert_array_equal(searched.left.points_px, with_prior.left.points_px)
    np.testing.assert_array_equal(searched.right.points_px, with_prior.right.points_px)
    assert searched.region_px == with_prior.region_px


@pytest.mark.parametrize("box", [(595.0, 325.0, 625.0, 345.0), (540.0, 300.0, 640.0, 380.0)])
def test_where_the_search_is_too_short_sighted_the_prior_box_is_searched(box):
    image = draw((1280, 720), *FAR)
    assert len(detect_lines(image, ShortSighted(), DetectConfig()).left) == 0
    network = ShortSighted()
    detection = detect_lines(image, network, DetectConfig(), box)
    check_lines(detection, *FAR)
    assert len(network.views) <= 4


@pytest.mark.parametrize("box", [*WRONG[:1], (700.0, 300.0, 760.0, 360.0)])
def test_a_prior_beside_the_runway_ends_not_seen_after_two_passes(box):
    network = ShortSighted()
    assert count_lines(detect_lines(draw((1280, 720), *FAR), network, DetectConfig(tilings=()), box)) == 0
    assert len(network.views) == 2


def test_the_search_wins_over_something_plausible_in_the_prior_box():
    true = ((900.0, 500.0, 960.0, 400.0), (1060.0, 500.0, 1020.0, 400.0))
    decoy = draw((1280, 720), (200.0, 500.0, 260.0, 400.0), (360.0, 500.0, 320.0, 400.0)) // 3
    box = (190.0, 390.0, 370.0, 510.0)
    alone = detect_lines(decoy, Oracle(), DetectConfig(), box)
    assert alone.left.points_px[:, 0].max() < 300  # plausible it is
    detection = detect_lines(decoy + draw((1280, 720), *true), Oracle(), DetectConfig(), box)
    assert detection.left.points_px[:, 0].min() > 890


def test_what_contradicts_the_one_line_that_the_search_saw_does_not_count():
    """The search sees a left line alone; the crop shows a runway elsewhere, or the same line and its right one."""
    left, right = (600.0, 400.0, 606.0, 370.0), (640.0, 400.0, 622.0, 370.0)

    def one_eyed():
        no_line = logits_of(np.full(GRID.rows, np.nan))
        return ChangedAtFirst(lambda output: output._replace(rows=np.stack([output.rows[0], no_line])))

    box, once = (595.0, 365.0, 645.0, 405.0), DetectConfig(max_passes=1, tilings=())
    image = draw((1280, 720), left, right)
    one = detect_lines(image, one_eyed(), once)
    assert len(one.left) > 0 and len(one.right) == 0
    assert count_lines(detect_lines(image, one_eyed(), once, box)) == 2
    shifted = draw((1280, 720), (612.0, 400.0, 616.0, 370.0), right)
    other = normalise(sample_crop(shifted, crop_around(box, (1280, 720), (512, 288), 0.6, 72.0), (512, 288)))
    network = one_eyed()
    one = detect_lines(image, lambda view: network(other if network.views else view), once, box)
    assert len(network.views) == 2 and len(one.left) > 0 and len(one.right) == 0


@pytest.mark.parametrize(
    ("call", "named"),
    [
        (lambda: detect_lines(np.zeros((5, 5, 3)), Oracle(), DetectConfig()), r"\(5, 5, 3\) of float64"),
        (lambda: DetectConfig(max_passes=0), r"max_passes.*0"),
        (lambda: DetectConfig(tilings=[(2, 0.5), (3, 1.5)]), r"tilings.*1\.5"),
        (lambda: detect_lines(BLACK, Oracle(), DetectConfig(), (5.0, 5.0, 5.0, 9.0)), r"box .*5\.0, 5\.0, 5\.0"),
        (lambda: detect_lines(BLACK, Oracle(), DetectConfig(), (np.nan, 0.0, 5.0, 5.0)), r"box .*nan"),
    ],
)
def test_wrong_use_is_refused(call, named):
    with pytest.raises(ValueError, match=named):
        call()


@pytest.mark.parametrize("shape", [(1, 1), (2, 900), (333, 77), (720, 1280)])
def test_any_image_size_can_be_searched(shape):
    image = np.random.default_rng(0).integers(0, 256, (*shape, 3), dtype=np.uint8)

    def everywhere(view):
        classes, offsets, _ = encode_region([100.0, 100.0, 110.0, 104.0], (32, 18))
        return NetworkOutput(np.zeros((2, 72, 129), np.float32), np.log(classes + 1e-12), offsets)

    detection = detect_lines(image, everywhere, DetectConfig())
    assert np.isfinite(detection.left.points_px).all()


def test_tiles_find_a_runway_that_the_whole_picture_is_too_coarse_for():
    lines = ((900.0, 500.0, 920.0, 460.0), (970.0, 500.0, 950.0, 460.0))
    network = ShortSighted()
    check_lines(detect_lines(draw((1280, 720), *lines), network, DetectConfig()), *lines)
    assert len(network.views) <= 1 + 9 + 1
    assert count_lines(detect_lines(draw((1280, 720), *lines), ShortSighted(), DetectConfig(tilings=()))) == 0


def test_a_runway_that_is_faint_in_the_whole_picture_counts_if_the_closer_view_is_sure():
    def make_faint(output):
        shares = 0.1 * np.exp(output.region)
        shares[-1] += 0.9
        return output._replace(region=np.log(shares))

    check_lines(detect_lines(draw((1280, 720), *FAR), ChangedAtFirst(make_faint), DetectConfig()), *FAR)
