"""Views with their lines: true ones projected into clear frames, labelled ones read with their pictures."""

import cv2
import numpy as np
import pytest
from line_scene import LINES_PX, line_frame, two_lines

from clear_scene import clear_recording
from deckline.labels import LabelledImage, write_labels
from deckline.train.views import is_labelled_folder, make_line_view, open_line_views


@pytest.fixture
def folder(tmp_path):
    """Eight labelled pictures, both lines, one or none, and one that nobody labelled."""
    path = tmp_path / "mine"
    path.mkdir()
    for k in range(9):
        cv2.imwrite(str(path / f"{k}.png"), two_lines()[:, :, ::-1])
    left, right = LINES_PX
    sides = [(left, right)] * 6 + [(left, None), (None, None)]
    write_labels(path / "labels.json", [LabelledImage(f"{k}.png", *lines) for k, lines in enumerate(sides)])
    return path


def test_true_lines_are_projected_onto_the_paint():
    view = make_line_view(line_frame(1))
    assert view.lines_px is not None and view.ranges_m is not None and view.clear is not None
    for points, ranges in zip(view.lines_px[:2], view.ranges_m[:2], strict=True):
        inside = np.all((points > 1) & (points < [318, 178]), axis=1)
        u, v = np.rint(points[inside]).astype(int).T
        assert (view.image_rgb[v, u, 0] == 220).mean() > 0.9
        np.testing.assert_allclose(view.clear.range_m[v, u], ranges[inside], rtol=0.05)
    left, right, centre = view.lines_px
    assert left[:, 0].mean() < right[:, 0].mean()
    np.testing.assert_allclose(centre[0, 0], (left[0, 0] + right[0, 0]) / 2, atol=1.0)  # seen from straight behind
    assert view.centre_painted is None  # this recording does not say
    assert make_line_view(line_frame(3, runway=False)).lines_px is None


def test_labelled_views_hold_the_pictures_and_their_lines(folder):
    views = open_line_views([folder], 0.0)
    assert len(views) == 8
    both, one, none = views[0], views[6], views[7]
    np.testing.assert_array_equal(both.image_rgb, two_lines())
    assert both.lines_px.shape == (3, 257, 2)
    assert np.isnan(both.lines_px[2]).all()  # nobody labels the centre line
    np.testing.assert_allclose(both.lines_px[:2, [0, -1]], LINES_PX)
    assert np.isnan(one.lines_px[1]).all() and np.isfinite(one.lines_px[0]).all()
    assert none.lines_px is None


def test_labelled_folders_and_recordings_are_drawn_together(folder, tmp_path):
    recording = clear_recording(tmp_path / "sim", 3)
    views = open_line_views([recording, folder, folder], 0.0)
    assert [views[index].clear is None for index in range(len(views))] == [False] * 3 + [True] * 16
    assert not is_labelled_folder(recording) and is_labelled_folder(folder)
    assert len(open_line_views([recording, recording], 0.34)) == 4
    assert len(open_line_views([recording, recording], 0.34, train=False)) == 1


def test_a_label_without_its_picture_and_a_damaged_picture_are_named(folder):
    (folder / "3.png").write_bytes((folder / "3.png").read_bytes()[:200])
    with pytest.raises(ValueError, match=r"mine/3\.png"):
        open_line_views([folder], 0.0)[3]
    (folder / "3.png").unlink()
    with pytest.raises(ValueError, match=r"labels\.json.*3\.png"):
        open_line_views([folder], 0.0)
