import json
from pathlib import Path

import numpy as np
import pytest
from pycocotools.coco import COCO

from deckline_lab.labels import LabelledImage
from deckline_lab.labels.formats import read_coco, read_culane, read_tusimple, write_coco, write_culane, write_tusimple

# A row of TuSimple's own kind: four rows, -2 where a lane is not.
OFFICIAL = {"lanes": [[-2, 50, 40, 30], [-2, -2, 80, 95]], "h_samples": [160, 170, 180, 190], "raw_file": "clips/a.jpg"}
TWO_LINES = "10 300 60.5 200 110 100 \n400 300 380 200\n"  # of CULane
IMAGE = LabelledImage("a.png", np.array([[20.0, 40.0], [100.0, 0.0]]), None, (120, 41))


def tusimple_file(tmp_path, *entries) -> Path:
    path = tmp_path / "label_data_0601.json"
    path.write_text("".join(e if isinstance(e, str) else json.dumps(e) + "\n" for e in entries))
    return path


def culane_folder(tmp_path, lines=TWO_LINES, listed=None) -> Path:
    (tmp_path / "driver").mkdir(exist_ok=True)
    (tmp_path / "driver" / "a.jpg").write_bytes(b"")
    (tmp_path / "driver" / "a.lines.txt").write_text(lines)
    if listed is None:
        return tmp_path
    (tmp_path / "list").mkdir(exist_ok=True)
    (tmp_path / "list" / "val.txt").write_text(listed)
    return tmp_path / "list" / "val.txt"


def test_tusimple_rows_of_the_published_form_are_read_from_a_folder(tmp_path):
    tusimple_file(tmp_path, OFFICIAL, "\n", OFFICIAL | {"lanes": [[-2] * 4, [-2, -2, 80, 95]]})
    root, (image, right_alone) = read_tusimple(tmp_path)
    assert root == tmp_path
    assert image.file == "clips/a.jpg"
    np.testing.assert_array_equal(image.left_px, [[50, 170], [40, 180], [30, 190]])
    np.testing.assert_array_equal(image.right_px, [[80, 180], [95, 190]])
    assert right_alone.left_px is None
    assert len(right_alone.right_px) == 2


def test_written_tusimple_rows_are_the_lines_at_those_rows(tmp_path):
    path = tmp_path / "label_data.json"
    write_tusimple(path, [IMAGE], 10)
    assert json.loads(path.read_text()) == {
        "lanes": [[100.0, 80.0, 60.0, 40.0, 20.0], [-2] * 5],
        "h_samples": [0, 10, 20, 30, 40],
        "raw_file": "a.png",
    }


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("{\n", "line 1: .*JSON"),
        ([1], "line 1 .*raw_file"),
        (OFFICIAL | {"raw_file": 3}, "line 1: raw_file"),
        (OFFICIAL | {"lanes": None}, "line 1: .*lanes"),
        (OFFICIAL | {"lanes": [[1, 2, 3]]}, r"line 1: lanes\[0\] .* 4 h_samples"),
        (OFFICIAL | {"lanes": [["a", 2, 3, 4]]}, r"line 1: lanes\[0\]"),
        (OFFICIAL | {"lanes": [[1e999, 2, 3, 4]]}, r"line 1: lanes\[0\]"),
        (OFFICIAL | {"lanes": [[-2, -2, -2, 4], [1, 2, 3, 4]]}, r"line 1: lanes\[0\].* -2"),
        (OFFICIAL | {"lanes": [[1, 2, 3, 4]]}, "line 1: one line"),
        (OFFICIAL | {"lanes": [[1, 2, 3, 4]] * 3}, "line 1: 3 lines"),
        ("", "no labels"),
    ],
)
def test_bad_tusimple_files_are_one_line_that_says_where(tmp_path, entry, message):
    path = tusimple_file(tmp_path, entry)
    with pytest.raises(ValueError, match=message) as caught:
        read_tusimple(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "listed", [None, "/driver/a.jpg\n", "/driver/a.jpg 1 1\n", "/driver/a.jpg /laneseg_label_w16/driver/a.png 1 1\n\n"]
)
def test_culane_files_of_the_published_form_are_read_from_folder_and_list(tmp_path, listed):
    root, (image,) = read_culane(culane_folder(tmp_path, listed=listed))
    assert root == tmp_path
    assert image.file == "driver/a.jpg"
    np.testing.assert_array_equal(image.left_px, [[10, 300], [60.5, 200], [110, 100]])
    np.testing.assert_array_equal(image.right_px, [[400, 300], [380, 200]])


@pytest.mark.parametrize(
    ("lines", "flags", "sides"), [("1 2 3 4\n", "1 0", ["left"]), ("1 2 3 4\n", "0 1", ["right"]), ("", "0 0", [])]
)
def test_culane_flags_say_which_line_a_single_one_is(tmp_path, lines, flags, sides):
    _, (image,) = read_culane(culane_folder(tmp_path, lines, f"/driver/a.jpg {flags}\n"))
    assert [name for name, line in image.lines.items() if line is not None] == sides


def test_written_culane_files_are_of_the_published_form(tmp_path):
    write_culane(tmp_path, [IMAGE], 20)
    assert (tmp_path / "a.lines.txt").read_text() == "20.000 40 60.000 20 100.000 0\n"
    assert (tmp_path / "list" / "train.txt").read_text() == "/a.png\n"
    assert (tmp_path / "list" / "train_gt.txt").read_text() == "/a.png /laneseg_label/a.png 1 0\n"


@pytest.mark.parametrize(
    ("lines", "listed", "message"),
    [
        ("1 2 3\n", None, r"a\.lines\.txt: line 1 .*\[u, v\]"),
        ("1 2 3 4\nu v w x\n", None, r"a\.lines\.txt: line 2"),
        ("1 2\n", None, r"a\.lines\.txt: line 1"),
        ("1 2 3 4\n", None, r"a\.lines\.txt: one line"),
        ("1 2 3 4\n" * 4, None, r"a\.lines\.txt: 4 lines"),
        (TWO_LINES, "/driver/a.jpg 0 1 1 0\n", r"val\.txt: line 1: 4 flags"),
        (TWO_LINES, "\n/driver/a.jpg 0 1\n", r"val\.txt: line 2: flags 0 1, .* 2 lines"),
        (TWO_LINES, "/driver/b.jpg\n", r"b\.lines\.txt"),
        (TWO_LINES, "\n", r"val\.txt: no labels"),
    ],
)
def test_bad_culane_files_are_one_line_that_says_where(tmp_path, lines, listed, message):
    with pytest.raises(ValueError, match=message) as caught:
        read_culane(culane_folder(tmp_path, lines, listed))
    assert "\n" not in str(caught.value)


def test_what_cannot_be_found_or_written_is_named(tmp_path):
    with pytest.raises(ValueError, match=r"label_data\*\.json"):
        read_tusimple(tmp_path)
    with pytest.raises(ValueError, match=r"a\.png: .*size"):
        write_tusimple(tmp_path / "x.json", [LabelledImage("a.png", None, None)])
    with pytest.raises(ValueError, match=r"a b\.png"):
        write_culane(tmp_path, [LabelledImage("a b.png", None, None, (9, 9))])
    culane_folder(tmp_path)
    (tmp_path / "driver" / "a.jpg").unlink()
    with pytest.raises(ValueError, match=r"a\.lines\.txt: no image a\.\*"):
        read_culane(tmp_path)


SIZE = (640, 360)
LEFT, RIGHT = np.array([[100.0, 300.0], [200.0, 100.0]]), np.array([[500.0, 300.0], [400.0, 100.0]])
EMPTY = {"image_id": 7, "category_id": 3, "keypoints": [0] * 12}


def coco_example() -> dict:
    return {
        "images": [{"id": 7, "file_name": "a.png", "width": 640, "height": 360}, {"id": 8, "file_name": "b.png"}],
        "annotations": [{"id": 1, "image_id": 7, "category_id": 3, "keypoints": [1, 2, 2, 3, 4, 1, 5, 6, 2, 0, 0, 0]}],
        "categories": [
            {"id": 1, "name": "boat"},
            {"id": 3, "name": "deck", "keypoints": ["left_near", "left_far", "right_near", "right_far"]},
        ],
    }


def test_keypoints_are_read_by_their_names(tmp_path):
    values, path = coco_example(), tmp_path / "person_keypoints.json"
    values["annotations"][0]["keypoints"][9:] = [7, 8, 2]
    path.write_text(json.dumps(values))
    root, (first, second) = read_coco(tmp_path)
    assert root == tmp_path
    np.testing.assert_array_equal(first.left_px, [[1, 2], [3, 4]])
    np.testing.assert_array_equal(first.right_px, [[5, 6], [7, 8]])
    assert first.size_px == (640, 360)
    assert (second.left_px, second.right_px, second.size_px) == (None, None, None)


def test_cocos_own_reader_reads_what_is_written(tmp_path):
    path = tmp_path / "annotations.json"
    images = [LabelledImage("a.png", LEFT, RIGHT, SIZE), LabelledImage("b.png", None, None, SIZE)]
    write_coco(path, [*images, LabelledImage("c.png", None, RIGHT, SIZE)], 3)
    coco = COCO(str(path))
    assert [image["file_name"] for image in coco.loadImgs(coco.getImgIds())] == ["a.png", "b.png", "c.png"]
    (category,) = coco.loadCats(coco.getCatIds(catNms=["runway"]))
    assert category["keypoints"] == ["left_1", "left_2", "left_3", "right_1", "right_2", "right_3"]
    assert category["skeleton"] == [[1, 2], [2, 3], [4, 5], [5, 6]]
    (both,) = coco.loadAnns(coco.getAnnIds(imgIds=[1]))
    assert both["keypoints"][:9] == [100.0, 300.0, 2, 150.0, 200.0, 2, 200.0, 100.0, 2]
    assert both["bbox"] == [100.0, 100.0, 400.0, 200.0]
    assert both["area"] == 80000.0
    assert coco.getAnnIds(imgIds=[2]) == []
    (one,) = coco.loadAnns(coco.getAnnIds(imgIds=[3]))
    assert one["num_keypoints"] == 3
    assert one["keypoints"][:9] == [0.0, 0.0, 0] * 3


def coco_text(**changes) -> str:
    return json.dumps(coco_example() | changes)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "not valid JSON"),
        ("[]", "images, annotations, categories"),
        (coco_text(images=[], annotations=[]), "it names no images"),
        (coco_text(images=[{"id": 1}], annotations=[]), r"images\[0\]: file_name"),
        (coco_text(categories=[{"id": 1, "keypoints": ["nose"]}]), "no category has keypoints named left_1"),
        (coco_text(categories=[{"id": 1, "keypoints": "nose"}]), r"categories\[0\]: keypoints"),
        (coco_text(annotations=[3]), r"annotations\[0\] must be an object"),
        (coco_text(annotations=[EMPTY] * 2), r"annotations\[1\]: .* image 7"),
        (coco_text(annotations=[EMPTY | {"keypoints": [1]}]), r"annotations\[0\]: keypoints must be 3 numbers"),
        (coco_text(), r"annotations\[0\]: right must be two or more \[u, v\]"),
    ],
)
def test_bad_coco_files_are_one_line_that_says_where(tmp_path, text, message):
    path = tmp_path / "a.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=message) as caught:
        read_coco(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_folder_must_hold_one_coco_file(tmp_path):
    with pytest.raises(ValueError, match=r"annotations\.json"):
        read_coco(tmp_path)
    for name in ("a.json", "b.json"):
        (tmp_path / name).write_text(coco_text())
    with pytest.raises(ValueError, match=r"2 files \*\.json"):
        read_coco(tmp_path)
    with pytest.raises(ValueError, match=r"2 keypoints.*1"):
        write_coco(tmp_path / "x.json", [], 1)
