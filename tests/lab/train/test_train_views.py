"""Views: how recordings are split and drawn from, ranges along the ray, true and labelled lines, what is refused."""

import re
from dataclasses import replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
from line_scene import LINES_PX, line_frame, two_lines

from clear_scene import CAMERA, clear_frame, clear_recording, hazy_frame, pair_folder
from deckline.geometry import Camera
from deckline.recording import FrameError
from deckline.types import Truth
from deckline_lab.labels import LabelledImage, write_labels
from deckline_lab.train.clear_views import horizon_colour, make_clear_view
from deckline_lab.train.line_views import make_line_view, open_line_views
from deckline_lab.train.pair_views import open_clear_views
from deckline_lab.train.view_sets import Views, make_ahead

A, B = Path("a"), Path("b")


def letters(texts: dict[Path, str], recordings: list[Path], held_out: float, train: bool = True) -> Views[str]:
    """Views of texts, in which a dash is a damaged frame and a question mark one without depth."""

    def load(text: str, index: int) -> str:
        if text[index] == "?":
            raise ValueError("no depth")
        if text[index] == "-":
            raise FrameError(f"{index}.png", "damaged")
        return text[index]

    parts = {path: (len(text), partial(load, text)) for path, text in texts.items()}
    return Views(parts, recordings, held_out, train)


def test_the_end_of_every_recording_is_held_out():
    sources = {A: "abcd", B: "ef"}
    training, held_out = letters(sources, [A, B, B], 0.5), letters(sources, [A, B, B], 0.5, False)
    assert [training[k] for k in range(len(training))] == ["a", "b", "e", "e"]
    assert [held_out[k] for k in range(len(held_out))] == ["c", "d", "f"]


@pytest.mark.parametrize(
    ("counts", "held_out", "train", "words"),
    [
        ({A: 9}, 0.05, False, ["held-out", "got 0 of 9 in a", "--held-out 0.05", "give --held-out 0.2"]),
        ({A: 3, B: 4}, 0.0, False, ["held-out", "got 0 of 7 in a, b", "--held-out 0;", "give --held-out 0.3"]),
        ({A: 3}, 1.0, True, ["training", "got 0 of 3 in a", "--held-out 1;", "less"]),
        ({A: 1}, 0.2, False, ["held-out", "got 0 of 1 in a", "2 or more"]),
        ({}, 0.2, True, ["training", "got 0 of 0"]),
    ],
)
def test_a_part_without_views_is_named_with_its_remedy(counts, held_out, train, words):
    with pytest.raises(ValueError) as caught:
        letters({path: "x" * count for path, count in counts.items()}, list(counts), held_out, train)
    assert [word for word in words if word not in str(caught.value)] == [], caught.value
    if remedy := re.search(r"give --held-out ([\d.]+)", str(caught.value)):
        assert len(letters({path: "x" * n for path, n in counts.items()}, list(counts), float(remedy[1]), False))


def test_damaged_frames_are_noted_and_others_drawn():
    views = letters({A: "a-b"}, [A], 0.0)
    rng = np.random.default_rng(0)
    assert {views.draw(rng) for _ in range(20)} == {"a", "b"}
    assert views.skipped == {"1.png": "damaged"}
    assert views.get_usable(1) is None and views.get_usable(2) == "b"
    with pytest.raises(ValueError, match=r"20.*0\.png.*damaged"):
        letters({A: "-"}, [A], 0.0).draw(rng)
    with pytest.raises(ValueError, match="no depth"):  # that a whole recording lacks it ends a training
        letters({A: "?"}, [A], 0.0).draw(rng)


def test_batches_come_in_the_order_of_their_steps():
    assert list(make_ahead(lambda step: 10 * step, 3, 7)) == [30, 40, 50, 60, 70]


def test_a_clear_view_holds_ranges_along_the_ray():
    frame = clear_frame(0)
    view = make_clear_view(frame, 640)
    np.testing.assert_allclose(view.range_m[40], frame.depth_m[40] * CAMERA.ray_lengths()[40], rtol=1e-3)  # half floats
    assert np.isinf(view.range_m[:16]).all()
    np.testing.assert_allclose(view.horizon_rgb, (150, 170, 200))
    large = make_clear_view(clear_frame(0, Camera.from_fov(192, 128, 1.2)), 96)
    assert (large.clear_rgb.shape, large.range_m.shape) == ((64, 96, 3), (64, 96))


@pytest.mark.parametrize(
    ("parts", "message"),
    [({"depth_m": None}, "depth"), ({"truth": Truth(visibility_m=900.0)}, "clear"), ({"truth": None}, "clear")],
)
def test_frame_without_depth_or_clear_image_is_refused(parts, message):
    with pytest.raises(ValueError, match=rf"000\.png.*{message}"):
        make_clear_view(replace(clear_frame(0), **parts), 640)


def test_recorded_clear_image_is_preferred():
    clear = np.full_like(clear_frame(0).image_rgb, 7)
    frame = replace(clear_frame(0), truth=Truth(visibility_m=900.0, clear_rgb=clear))
    view = make_clear_view(frame, 640)
    np.testing.assert_array_equal(view.clear_rgb, clear)
    np.testing.assert_array_equal(view.hazy_rgb, frame.image_rgb)
    assert view.visibility_m == 900.0


def test_pairs_of_a_labelled_folder_are_views_without_depth(tmp_path):
    folder = pair_folder(tmp_path, 3)
    views = open_clear_views([folder], 640, 0.34)
    assert len(views) == 2
    np.testing.assert_array_equal(views[1].hazy_rgb, hazy_frame(1).image_rgb)
    np.testing.assert_array_equal(views[1].clear_rgb, clear_frame(1).image_rgb)
    half = open_clear_views([folder], 48, 0.0)[0]
    blocks = hazy_frame(0).image_rgb.reshape(32, 2, 48, 2, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(half.hazy_rgb, blocks, atol=0.51)
    assert half.clear_rgb.shape == (32, 48, 3)
    (folder / "labels.json").write_text('{"frames": [{"file": "0_hazy.png"}]}')
    with pytest.raises(ValueError, match=r"0_clear\.png.*pair_of"):
        open_clear_views([folder], 640, 0.0)[0]


def test_horizon_colour_is_the_lowest_sky():
    image, ranges = np.zeros((20, 10, 3), dtype=np.uint8), np.full((20, 10), 100.0)
    assert horizon_colour(image, ranges) is None
    image[:8], image[8:10], ranges[:10] = 30, 200, np.inf
    np.testing.assert_allclose(horizon_colour(image, ranges), 200)


@pytest.fixture
def folder(tmp_path):
    """Eight labelled pictures, both lines, one or none, and one that nobody labelled."""
    path = tmp_path / "mine"
    path.mkdir()
    for k in range(9):
        cv2.imwrite(str(path / f"{k}.png"), two_lines()[:, :, ::-1])
    sides = [LINES_PX] * 6 + [(LINES_PX[0], None), (None, None)]
    write_labels(path / "labels.json", [LabelledImage(f"{k}.png", *lines) for k, lines in enumerate(sides)])
    return path


def test_true_lines_are_projected_onto_the_paint():
    view = make_line_view(line_frame(1))
    for points, ranges in zip(view.lines_px[:2], view.ranges_m[:2], strict=True):
        inside = np.all((points > 1) & (points < [318, 178]), axis=1)
        u, v = np.rint(points[inside]).astype(int).T
        assert (view.image_rgb[v, u, 0] == 220).mean() > 0.9
        np.testing.assert_allclose(view.clear.range_m[v, u], ranges[inside], rtol=0.05)
    left, right, centre = view.lines_px
    assert left[:, 0].mean() < right[:, 0].mean()
    np.testing.assert_allclose(centre[0, 0], (left[0, 0] + right[0, 0]) / 2, atol=1.0)  # seen from straight behind
    assert view.centre_painted is None  # not recorded
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
    assert [len(open_line_views([recording, recording], 0.34, train)) for train in (True, False)] == [4, 1]


def test_a_label_without_its_picture_and_a_damaged_picture_are_named(folder):
    (folder / "3.png").write_bytes((folder / "3.png").read_bytes()[:200])
    with pytest.raises(ValueError, match=r"mine/3\.png"):
        open_line_views([folder], 0.0)[3]
    (folder / "3.png").unlink()
    with pytest.raises(ValueError, match=r"labels\.json.*3\.png"):
        open_line_views([folder], 0.0)
