import cv2
import numpy as np
import pytest

from deckline_lab.labels import LabelledImage
from deckline_lab.labels.yolo_pose import read_yolo_pose, write_yolo_pose

BOX = "0 .5 .5 .4 .4"
LEFT, RIGHT = [[19.5, 39.5], [39.5, 9.5]], [[79.5, 39.5], [59.5, 9.5]]  # of ROW, px of 100x50
ROW = f"{BOX} .2 .8 .4 .2 .8 .8 .6 .2"


def dataset(tmp_path, row=ROW, settings=None, labels="labels/train", images="images/train"):
    for folder in (labels, images):
        (tmp_path / folder).mkdir(parents=True, exist_ok=True)
    (tmp_path / labels / "a.txt").write_text(row)
    (tmp_path / labels / "classes.txt").write_text("runway\n")
    cv2.imwrite(str(tmp_path / images / "a.jpg"), np.zeros((50, 100, 3), np.uint8))
    if settings is not None:
        (tmp_path / "data.yaml").write_text(settings)
    return tmp_path


@pytest.mark.parametrize(("labels", "images"), [("labels/train", "images/train"), ("train/labels", "train/images")])
@pytest.mark.parametrize("row", [ROW, f"{BOX} .2 .8 2 .4 .2 1 .8 .8 2 .6 .2 2\n\n"])
def test_the_first_half_of_the_keypoints_is_left_with_and_without_visibility(tmp_path, labels, images, row):
    root, (image,) = read_yolo_pose(dataset(tmp_path, row, labels=labels, images=images))
    assert (root, image.file, image.size_px) == (tmp_path, f"{images}/a.jpg", (100, 50))
    np.testing.assert_allclose(image.left_px, LEFT)
    np.testing.assert_allclose(image.right_px, RIGHT)


def test_labels_may_lie_beside_their_images_and_an_empty_file_is_no_runway(tmp_path):
    root, (image,) = read_yolo_pose(dataset(tmp_path, "\n", labels=".", images="."))
    assert (root, image.file, image.lines) == (tmp_path, "a.jpg", {"left": None, "right": None})


@pytest.mark.parametrize(
    ("names", "settings"),
    [
        (["right", "Left_far", "left", "right", "aim"], None),
        ((), "kpt_shape: [5, 2]\nkpt_names: # in order\n  0:\n    - right_near\n    - left_far\n    - left_near\n"
             "    - right_far\n    - aim\nnames:\n  0: runway\n"),
        ((), "kpt_names: {0: [right_1, left_2, left_1, right_2, aim]}\n"),
    ],
)  # fmt: skip
def test_keypoints_are_taken_by_the_names_given_or_those_of_data_yaml(tmp_path, names, settings):
    folder = dataset(tmp_path, f"{BOX} .8 .8 .4 .2 .2 .8 .6 .2 .5 .5", settings)
    path = folder if settings is None else folder / "data.yaml"
    _, (image,) = read_yolo_pose(path, names)
    np.testing.assert_allclose(image.left_px, LEFT[::-1])
    np.testing.assert_allclose(image.right_px, RIGHT)


@pytest.mark.parametrize("row", [f"{BOX} .2 .8 .4 .2 0 0 0 0", f"{BOX} .2 .8 2 .4 .2 2 .8 .8 0 .6 .2 0"])
def test_keypoints_that_are_not_labelled_make_no_line(tmp_path, row):
    _, (image,) = read_yolo_pose(dataset(tmp_path, row))
    np.testing.assert_allclose(image.left_px, LEFT)
    assert image.right_px is None


@pytest.mark.parametrize(
    ("row", "settings", "message"),
    [
        (f"{ROW}\n{ROW}", None, r"a\.txt: 2 runways"),
        (f"{ROW} x", None, r"a\.txt: a row must hold numbers alone"),
        (BOX, None, r"a\.txt: 0 numbers after class and box"),
        (f"{ROW} .1", None, r"a\.txt: 9 numbers"),
        (f"{BOX} .1 .2 .3 .4 .5 .6", None, r"a\.txt: 6 numbers .*as many keypoints left as right"),
        (ROW, "kpt_names: {0: [left, right]}", r"a\.txt: 8 numbers .*2 keypoints \(left, right\)"),
        (ROW, "kpt_names: [a, b, c, d]", "no keypoint is named left or right, but a, b, c, d; give --keypoints"),
        (f"{BOX} .2 .8 .4 .2 .8 .8 0 0", None, r"a\.txt: right, labelled keypoints, must be two or more"),
        (f"{BOX} .2 nan .4 .2 .8 .8 .1 .1", None, r"a\.txt: left"),
    ],
)
def test_bad_files_are_one_line_that_says_where(tmp_path, row, settings, message):
    with pytest.raises(ValueError, match=message) as caught:
        read_yolo_pose(dataset(tmp_path, row, settings))
    assert "\n" not in str(caught.value)


def test_missing_labels_and_images_are_named(tmp_path):
    with pytest.raises(ValueError, match="no labels: neither labels"):
        read_yolo_pose(tmp_path)
    (dataset(tmp_path) / "images" / "train" / "a.jpg").write_bytes(b"none")
    with pytest.raises(ValueError, match=r"a\.jpg: not an image"):
        read_yolo_pose(tmp_path)
    (tmp_path / "images" / "train" / "a.jpg").unlink()
    with pytest.raises(ValueError, match=r"a\.txt: no image a\.\* in .*images/train"):
        read_yolo_pose(tmp_path)


def test_written_files_are_of_the_published_form(tmp_path):
    lines = np.array(LEFT), None
    write_yolo_pose(tmp_path, [LabelledImage("images/a.png", *lines, (100, 50))], 2)
    row = [float(word) for word in (tmp_path / "labels" / "a.txt").read_text().split()]
    np.testing.assert_allclose(row, [0, 0.3, 0.5, 0.2, 0.6, 0.2, 0.8, 2, 0.4, 0.2, 2, 0, 0, 0, 0, 0, 0])
    settings = (tmp_path / "data.yaml").read_text()
    assert "kpt_shape: [4, 3]\nflip_idx: [2, 3, 0, 1]\n" in settings
    assert "0: [left_1, left_2, right_1, right_2]" in settings


def test_a_line_that_leaves_the_picture_is_written_to_its_edge(tmp_path):
    """The left line goes on below the picture, the right one never comes into it."""
    lines = np.array([[19.5, 79.5], [39.5, 9.5]]), np.array([[120.0, 40.0], [110.0, 10.0]])
    write_yolo_pose(tmp_path, [LabelledImage("images/a.png", *lines, (100, 50))], 3)
    row = np.array((tmp_path / "labels" / "a.txt").read_text().split(), dtype=float)
    assert ((row >= 0) & (row <= 2)).all() and (row[1:5] <= 1).all()
    points = row[5:].reshape(6, 3)
    np.testing.assert_allclose(points[[0, 2], :2], [[0.2 + 0.2 * 3 / 7, 1.0], [0.4, 0.2]], atol=2e-3)
    assert points[:, 2].tolist() == [2, 2, 2, 0, 0, 0] and not points[3:].any()
