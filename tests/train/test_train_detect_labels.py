"""Labelled pictures as training views: targets on the labelled lines, and never any haze added."""

import cv2
import numpy as np
import pytest

from clear_scene import clear_recording
from deckline.detect import OnnxDetector
from deckline.detect.anchors import RowGrid, decode_region
from deckline.labels import LabelledImage, write_labels
from deckline.train.detect import DetectTrainConfig, train_detect
from deckline.train.detect_augment import DetectAugmentation
from deckline.train.detect_samples import make_sample
from deckline.train.detect_validation import validate
from deckline.train.detect_views import is_labelled_folder, open_line_views
from deckline.train.line_networks import PyramidConfig, Ufld

GRID = RowGrid()
PLAIN = {name: 0.0 for name in vars(DetectAugmentation()) if name.endswith("_share")}
LEFT = np.array([[250.0, 300.0], [262.0, 264.0], [290.0, 180.0]])
RIGHT = np.array([[420.0, 305.0], [350.0, 185.0]])


def picture() -> np.ndarray:
    """A red left line and a green right one, 4 px wide, on dark grey."""
    v, u = np.mgrid[0:360, 0:640]
    image = np.full((360, 640, 3), 40.0)
    for channel, line in enumerate((LEFT, RIGHT)):
        (u0, v0), (u1, v1) = line[0], line[-1]
        middle = u0 + (v - v0) * (u1 - u0) / (v1 - v0)
        image[..., channel] += 200 * np.clip(2.5 - np.abs(u - middle), 0, 1) * ((v >= v1) & (v <= v0))
    return image.astype(np.uint8)


@pytest.fixture
def folder(tmp_path):
    """Eight labelled pictures, both lines, one or none, and one that nobody labelled."""
    path = tmp_path / "mine"
    path.mkdir()
    for k in range(9):
        cv2.imwrite(str(path / f"{k}.png"), picture()[:, :, ::-1])
    sides = [(LEFT, RIGHT)] * 6 + [(LEFT, None), (None, None)]
    write_labels(path / "labels.json", [LabelledImage(f"{k}.png", *lines) for k, lines in enumerate(sides)])
    return path


def test_views_hold_the_pictures_and_their_lines(folder):
    views = open_line_views([folder], 0.0)
    assert len(views) == 8
    both, one, none = views[0], views[6], views[7]
    np.testing.assert_array_equal(both.image_rgb, picture())
    assert both.lines_px.shape == (3, 257, 2)
    assert np.isnan(both.lines_px[2]).all()  # nobody labels the centre line
    np.testing.assert_allclose(both.lines_px[0, [0, -1]], LEFT[[0, -1]])
    assert np.isnan(one.lines_px[1]).all() and np.isfinite(one.lines_px[0]).all()
    assert none.lines_px is None


@pytest.mark.parametrize("shares", [{}, {"close_share": 1.0}, {"close_share": 1.0, "flip_share": 1.0}])
def test_targets_lie_on_the_labelled_lines(folder, shares):
    view, augment = open_line_views([folder], 0.0)[0], DetectAugmentation(**(PLAIN | shares))
    errors = []
    for seed in range(4):
        sample = make_sample(view, GRID, augment, np.random.default_rng(seed))
        for line in (0, 1):
            channel = 1 - line if shares.get("flip_share") else line
            for row in np.flatnonzero(np.isfinite(sample.cell[line]))[2:-2:3]:
                y = int(GRID.row_y[row])
                level = sample.image[channel, y : y + 2].mean(axis=0) - sample.image[2, y : y + 2].mean(axis=0)
                level = np.where(level > 0.25 * level.max(), level, 0)
                errors.append(
                    (level * np.arange(GRID.width)).sum() / level.sum() - GRID.x_from_cell(sample.cell[line, row])
                )
    assert len(errors) > 30
    assert abs(np.median(errors)) < 0.15
    assert np.quantile(np.abs(errors), 0.9) < 0.6


def test_no_haze_is_added_and_the_contrast_is_left(folder):
    view = open_line_views([folder], 0.0)[0]
    hazy = DetectAugmentation(**(PLAIN | {"haze_share": 1.0, "fade_share": 1.0}))
    for seed in range(3):
        one, other = (
            make_sample(view, GRID, a, np.random.default_rng(seed)) for a in (hazy, DetectAugmentation(**PLAIN))
        )
        for first, second in zip(one, other, strict=True):
            np.testing.assert_array_equal(first, second)


def test_one_line_is_taught_alone_and_none_as_no_runway(folder):
    views, augment = open_line_views([folder], 0.0), DetectAugmentation(**(PLAIN | {"close_share": 1.0}))
    one = make_sample(views[6], GRID, augment, np.random.default_rng(0))
    assert np.isfinite(one.cell[0]).sum() > 10 and np.isnan(one.cell[1]).all()
    assert decode_region(np.log(one.region + 1e-12), one.box).probability > 0.9
    none = make_sample(views[7], GRID, augment, np.random.default_rng(0))
    assert np.isnan(none.cell).all() and none.region[-1] == 1.0


def test_labelled_folders_and_recordings_are_drawn_together(folder, tmp_path):
    recording = clear_recording(tmp_path / "sim", 3)
    views = open_line_views([recording, folder, folder], 0.0)
    assert [views[index].clear is None for index in range(len(views))] == [False] * 3 + [True] * 16
    assert not is_labelled_folder(recording) and is_labelled_folder(folder)


def test_training_on_labelled_pictures_alone_exports_a_detector(folder, tmp_path):
    config = DetectTrainConfig(
        steps=1,
        minutes=None,
        batch=2,
        held_out=0.25,
        threads=1,
        network="ufld",
        shape=PyramidConfig(channels=16, pretrained=False),
    )
    figures = train_detect(config, [folder], tmp_path / "out")
    assert figures["views"] == 2.0  # the last two: one line alone, which is no clear case, and none
    assert figures["false_alarms.clear"] in (0.0, 1.0)
    assert OnnxDetector(tmp_path / "out" / "detect.onnx").config.grid == GRID


def test_held_out_pictures_are_measured_as_they_are(folder):
    model = Ufld(PyramidConfig(channels=16, pretrained=False))
    figures = validate(model, open_line_views([folder], 0.375, train=False), DetectAugmentation(), 0)
    for name in ("both_found", "false_alarms"):
        assert figures[f"{name}.clear"] == figures[f"{name}.thick_haze"]


def test_a_label_without_its_picture_and_a_damaged_picture_are_named(folder):
    (folder / "3.png").write_bytes((folder / "3.png").read_bytes()[:200])
    with pytest.raises(ValueError, match=r"mine/3\.png: damaged or cut short"):
        open_line_views([folder], 0.0)[3]
    (folder / "3.png").unlink()
    with pytest.raises(ValueError, match=r"labels\.json: there is no image 3\.png in "):
        open_line_views([folder], 0.0)
