from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from approach_scene import CAMERA, chain, frame
from deckline.report import draw
from deckline.report.annotators import (
    COLOURS,
    INSET_PX,
    LineAnnotator,
    MagnifierAnnotator,
    NeedleAnnotator,
    PointAnnotator,
    find_corner,
    project_centre_line,
    resize,
)
from deckline.report.instrument import draw_indicator
from deckline.report.overlay import PANEL_PX

ALL = (MagnifierAnnotator(), PointAnnotator(), LineAnnotator(), NeedleAnnotator())


def far_result():
    """A deck 600 m away in a picture of 1280x720 px, with a chequered background."""
    camera = CAMERA.resized(1280, 720)
    tiles = np.indices((720, 1280)).sum(axis=0) // 8 % 2 * 40 + 100
    image = np.repeat(tiles[..., None], 3, axis=2).astype(np.uint8)
    return chain(replace(frame(range_m=600.0), camera=camera, image_rgb=image))


@pytest.mark.parametrize("annotator", ALL, ids=lambda a: type(a).__name__)
@pytest.mark.parametrize("size", [(320, 180), (1280, 720), (31, 17), (1, 1)])
@pytest.mark.parametrize("sides", [(), ("left", "right")])
def test_a_picture_of_any_size_gets_a_new_picture(annotator, size, sides):
    image = np.full((size[1], size[0], 3), 90, dtype=np.uint8)
    shown = annotator.annotate(image, chain(frame(), sides))
    assert shown.shape == image.shape and shown.dtype == np.uint8
    assert (image == 90).all()


@pytest.mark.parametrize("annotator", ALL, ids=lambda a: type(a).__name__)
def test_what_is_no_picture_is_refused(annotator):
    with pytest.raises(ValueError, match=r"uint8.*\(4, 5\).*float64"):
        annotator.annotate(np.zeros((4, 5)), chain(frame()))


def test_lines_lie_where_they_were_seen_whatever_the_pictures_size():
    result = chain(frame())
    black = np.zeros((2 * CAMERA.height, 2 * CAMERA.width, 3), dtype=np.uint8)
    image = LineAnnotator().annotate(black, result)
    for side, line in result.estimate.pixel_lines.items():
        rows, columns = np.nonzero((image == COLOURS[side]).all(axis=2))
        a, b, c = line.coefficients
        small = (np.array([columns, rows]) + 0.5) / 2 - 0.5
        assert len(rows) > 50
        assert np.abs(a * small[0] + b * small[1] + c).max() / np.hypot(a, b) < 1.5


def test_points_that_no_line_took_are_rings():
    result = chain(frame())
    image = np.zeros((8 * CAMERA.height, 8 * CAMERA.width, 3), dtype=np.uint8)
    filled = PointAnnotator().annotate(image, result)
    nothing = replace(result, estimate=replace(result.estimate, pixel_lines={}))
    rings = PointAnnotator().annotate(image, nothing)
    assert 0 < np.count_nonzero(rings.any(axis=2)) < np.count_nonzero(filled.any(axis=2))


def test_the_magnifier_shows_the_frames_own_pixels_in_the_pictures_contrast():
    result = far_result()
    dark = resize(result.frame.image_rgb, PANEL_PX) // 2
    magnifier = MagnifierAnnotator(marks=())
    (u0, v0, u1, v1), (left, top) = magnifier.find_place(dark, result)
    inset = magnifier.annotate(dark, result)[top : top + INSET_PX[1], left : left + INSET_PX[0]]
    expected = resize(result.frame.image_rgb[v0:v1, u0:u1], INSET_PX) / 2.0
    assert np.abs(inset - expected).mean() < 2.0
    with_lines = MagnifierAnnotator().annotate(dark, result)[top : top + INSET_PX[1], left : left + INSET_PX[0]]
    assert (with_lines != inset).any()


def test_the_needles_are_those_of_the_instrument():
    result = chain(frame())
    image = np.zeros((400, 500, 3), dtype=np.uint8)
    shown = NeedleAnnotator(224).annotate(image, result)
    np.testing.assert_array_equal(shown[400 - 10 - 224 : 390, 10:234], draw_indicator(result.guidance))
    assert not shown[:, 234:].any()
    unseen = NeedleAnnotator(224).annotate(image, chain(frame(), ()))
    assert (unseen == draw.FLAG).all(axis=2).any()


def test_the_centre_line_is_projected_between_its_edge_lines():
    result = chain(frame())
    near, far = project_centre_line(result.frame, result.estimate)
    truth = result.frame.camera.project(
        result.frame.world_from_camera.inv().apply([[0.0, 0.0, -20.0], [200.0, 0.0, -20.0]])
    )
    assert np.allclose([near, far], truth, atol=0.2)
    unplaced = chain(frame(pose=False))
    assert project_centre_line(unplaced.frame, unplaced.estimate) is None


@given(u=st.integers(0, 600), v=st.integers(0, 330), width=st.integers(4, 200))
def test_the_magnified_view_never_hides_what_it_magnifies(u, v, width):
    window = (u, v, u + width, v + width // 2)
    corner = find_corner(PANEL_PX, window)
    if corner is None:
        return
    left, top = corner
    assert left >= 0 and top >= 0
    assert left + INSET_PX[0] <= PANEL_PX[0] and top + INSET_PX[1] <= PANEL_PX[1]
    apart_u = left + INSET_PX[0] <= window[0] or left >= window[2] - 1
    apart_v = top + INSET_PX[1] <= window[1] or top >= window[3] - 1
    assert apart_u or apart_v


def test_a_far_runway_is_magnified_and_a_small_panel_has_no_room():
    assert find_corner(PANEL_PX, (300, 170, 340, 190)) is not None
    assert find_corner((200, 100), (90, 40, 110, 50)) is None
