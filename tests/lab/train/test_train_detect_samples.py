"""Samples: picture and targets agree to the sub-pixel after every augmentation."""

from dataclasses import replace

import numpy as np
import pytest
from line_scene import LINES_PX, two_lines

from deckline.detect.anchors import EDGES, RowGrid, decode_region
from deckline.geometry import Camera
from deckline.types import EdgeKind
from deckline_lab.train.clear_views import ClearView
from deckline_lab.train.detect_samples import DetectAugmentation, blur, compress, make_sample
from deckline_lab.train.line_views import LineView
from deckline_sim.camera.foreground import Foreground
from deckline_sim.camera.sensor import jpeg

GRID = RowGrid()
SHARES = [name for name in vars(DetectAugmentation()) if name.endswith("_share")]


def certain(*names: str, **values: float) -> DetectAugmentation:
    """What is named happens to every view, nothing else to any."""
    return DetectAugmentation(**{share: float(share.removesuffix("_share") in names) for share in SHARES} | values)


@pytest.fixture(scope="module")
def view() -> LineView:
    """Two lines 300 m away."""
    clear = ClearView(two_lines(), np.full((360, 640), 300.0, np.float16), None, Camera.from_fov(640, 360, 1.2))
    left, right = np.linspace(LINES_PX[:, 0], LINES_PX[:, 1], 257, axis=1)
    points = np.stack([left, right, (left + right) / 2])
    return LineView("drawn", clear.clear_rgb, points, clear, np.full((3, 257), 300.0), True)


@pytest.fixture(scope="module")
def labelled(view) -> LineView:
    """The same picture, labelled by a person."""
    lines = np.concatenate([view.lines_px[:2], np.full((1, 257, 2), np.nan)])
    return LineView("labelled", view.image_rgb, lines)


def rng(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


def brightest(image: np.ndarray, channel: int, row: int) -> float:
    """Column of the line of one colour in a row, by its centroid."""
    level = np.clip(image[channel, row] - image[2, row], 0, None)
    level = np.where(level > 0.25 * level.max(), level, 0)
    return float((level * np.arange(GRID.width)).sum() / level.sum())


@pytest.mark.parametrize(
    "shares",
    ["", "close", "close flip", "close rotate", "close rotate flip", "flip", "haze close", "blur vertical_blur close"],
)
@pytest.mark.parametrize("kind", ["view", "labelled"])
def test_targets_lie_on_the_drawn_lines(kind, shares, request):
    view = request.getfixturevalue(kind)
    augment = certain(*shares.split(), optical_depth_max=1.0)
    errors = []
    for seed in range(6):
        sample = make_sample(view, GRID, augment, rng(seed))
        for line in (0, 1):
            channel = 1 - line if "flip" in shares else line  # mirrored, the red line is the right one
            rows = np.flatnonzero(np.isfinite(sample.cell[line]))
            for row in rows[2:-2:3]:
                y = int(GRID.row_y[row])
                seen = (brightest(sample.image, channel, y) + brightest(sample.image, channel, y + 1)) / 2
                errors.append(seen - GRID.x_from_cell(sample.cell[line, row]))
    assert len(errors) > 40
    assert abs(np.median(errors)) < 0.15
    assert np.quantile(np.abs(errors), 0.9) < 0.6


@pytest.mark.parametrize(("painted", "known", "seen"), [(True, True, True), (False, True, False), (None, False, False)])
def test_a_centre_line_is_taught_where_it_is_painted_and_left_open_where_nobody_knows(view, painted, known, seen):
    sample = make_sample(replace(view, centre_painted=painted), GRID, certain(), rng(2))
    assert sample.known.tolist() == [True, True, known]
    assert np.isfinite(sample.cell[2]).any() == seen
    assert np.isfinite(sample.cell[:2]).any(axis=1).all()
    assert sample.edge == -1


def test_region_box_is_around_both_lines(view):
    sample = make_sample(view, GRID, certain("close"), rng(1))
    region = decode_region(np.log(sample.region + 1e-12), sample.box)
    rows = np.flatnonzero(np.isfinite(sample.cell).any(axis=0))
    x = GRID.x_from_cell(sample.cell[np.isfinite(sample.cell)])
    assert region.box[[0, 2]] == pytest.approx([x.min(), x.max()], abs=3)
    assert region.box[[1, 3]] == pytest.approx(GRID.row_y[rows[[0, -1]]], abs=5)


def test_thick_haze_leaves_no_runway(view):
    far = replace(view, centre_painted=None)
    augment = certain("haze", optical_depth_max=40.0)
    samples = [make_sample(far, GRID, augment, rng(seed)) for seed in range(12)]
    hidden = [s for s in samples if s.region[-1] == 1.0]
    assert len(hidden) >= 6
    assert all(np.isnan(s.cell).all() and s.box_weight.sum() == 0 for s in hidden)


def test_same_seed_same_sample(view):
    for one, other in zip(*(make_sample(view, GRID, DetectAugmentation(), rng(5)) for _ in range(2)), strict=True):
        np.testing.assert_array_equal(one, other)


def test_no_haze_is_added_to_labelled_pictures_and_the_contrast_is_left(labelled):
    hazy = certain("haze", "fade")
    for seed in range(3):
        for first, second in zip(*(make_sample(labelled, GRID, a, rng(seed)) for a in (hazy, certain())), strict=True):
            np.testing.assert_array_equal(first, second)


def test_one_labelled_line_is_taught_alone_and_none_as_no_runway(labelled):
    augment, lines = certain("close"), labelled.lines_px.copy()
    lines[1] = np.nan
    one = make_sample(replace(labelled, lines_px=lines), GRID, augment, rng(0))
    assert np.isfinite(one.cell[0]).sum() > 10 and np.isnan(one.cell[1]).all()
    assert decode_region(np.log(one.region + 1e-12), one.box).probability > 0.9
    none = make_sample(replace(labelled, lines_px=None), GRID, augment, rng(0))
    assert np.isnan(none.cell).all() and none.region[-1] == 1.0


@pytest.mark.parametrize(("quality", "scale"), [(25, 2.0), (50, 1.0), (90, 0.2)])
def test_compression_is_jpeg_at_the_scale_of_its_tables(quality: int, scale: float) -> None:
    image = rng(0).normal(100, 20, (33, 50, 1)).repeat(3, axis=2)
    levels = np.rint(image).clip(0, 255).astype(np.uint8)
    np.testing.assert_array_equal(compress(image.astype(np.float32), scale), jpeg(levels, quality))


def test_blur_keeps_the_mean_and_its_axis():
    image = np.zeros((41, 41, 3), np.float32)
    image[20, 20] = 100.0
    tall = blur(image, 2.0, 0.0)
    assert tall.sum() == pytest.approx(image.sum(), rel=1e-4)
    assert (tall[:, 19] == 0).all() and tall[23, 20, 0] > 1


def test_shares_are_probabilities():
    with pytest.raises(ValueError, match=r"haze_share.*1\.5"):
        DetectAugmentation(haze_share=1.5)


def test_without_a_runway_close_crops_are_at_objects(view):
    """A white box, nearer than all around it, is in most of them, and larger than crops of the whole image show it."""
    image, ranges = view.image_rgb.copy(), view.clear.range_m.copy()
    image[:] = 0
    image[200:216, 100:120], ranges[200:216, 100:120] = 255, 100.0
    clear = replace(view.clear, clear_rgb=image, range_m=ranges)
    augment = certain("close", "object", flip_share=0.5)
    samples = [make_sample(LineView("box", image, None, clear), GRID, augment, rng(seed)) for seed in range(30)]
    reds = [sample.image[0] for sample in samples]
    white = [int((red > red.mean() + 0.5 * np.ptp(red)).sum()) for red in reds]
    assert np.mean(np.array(white) > 0) > 0.8
    whole_px = 20 * 16 * (GRID.width / image.shape[1]) ** 2
    assert np.median(white) > 3 * whole_px
    assert all(sample.region[-1] == 1.0 for sample in samples)


STRIPES = np.zeros((360, 640, 3), np.uint8)
STRIPES[:, np.arange(640) % 80 < 40] = 255
WHOLE = {"wide_scale": (1.0, 1.0)}  # crops of the whole image


@pytest.fixture
def below_sky(view) -> LineView:
    """The two lines with sky above row 160, 128 of the network's."""
    ranges = view.clear.range_m.copy()
    ranges[:160] = np.inf
    return replace(view, clear=replace(view.clear, range_m=ranges))


def test_a_photograph_takes_the_skys_place_alone(below_sky):
    bare = make_sample(below_sky, GRID, certain(**WHOLE), rng(0))
    shown = make_sample(below_sky, GRID, certain("backdrop", **WHOLE), rng(0), [STRIPES])
    ground, same = ((level - level.mean()) / level.std() for level in (bare.image[:, 132:], shown.image[:, 132:]))
    np.testing.assert_allclose(same, ground, atol=1e-3)
    np.testing.assert_array_equal(bare.cell, shown.cell)
    assert bare.image[0, :124].std() < 0.01 < 1.0 < shown.image[0, :124].std()


def test_a_picture_upside_down_has_no_runway(view):
    seen = replace(view, edge=EdgeKind.PAINT)
    one, turned = (make_sample(seen, GRID, certain(*name, **WHOLE), rng(0)) for name in ((), ("upside_down",)))
    np.testing.assert_allclose(turned.image, one.image[:, ::-1, ::-1], atol=0.05)
    assert turned.region[-1] == 1.0 and turned.edge == -1 and np.isnan(turned.cell).all()


def test_what_a_foreground_hides_is_not_seen(view, monkeypatch):
    """One that hides most above row 240, 192 of the network's, and less below."""
    cover = np.where(np.arange(360)[:, None] < 240, 0.6, 0.4) * np.ones((360, 640), np.float32)
    foreground = Foreground(np.zeros((360, 640, 3), np.float32), cover.astype(np.float32))
    monkeypatch.setattr("deckline_lab.train.detect_samples.draw_foreground", lambda *args: foreground)
    rows = np.flatnonzero(np.isfinite(make_sample(view, GRID, certain("foreground", **WHOLE), rng(0)).cell).any(axis=0))
    assert 190 < GRID.row_y[rows[0]] < 200
    assert GRID.row_y[rows[-1]] > 235


@pytest.mark.parametrize("kind", EdgeKind)
def test_the_kind_of_edge_is_taught(view, kind):
    assert EDGES[make_sample(replace(view, edge=kind), GRID, certain(), rng(0)).edge] == kind
