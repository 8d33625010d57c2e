"""Label files of other tools: their own files are read, written ones are read back, bad ones are named."""

import json
import tempfile
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pycocotools.coco import COCO

from deckline_lab.labels import LabelledImage, read_labels, write_labels
from deckline_lab.labels.exchange import READERS, WRITERS
from deckline_lab.labels.labelme import write_labelme
from deckline_lab.labels.lanes import write_culane, write_tusimple
from deckline_lab.labels.lines import find_side
from deckline_lab.labels.yolo_pose import read_yolo_pose, write_yolo_pose

SIZE = (640, 360)
# Of TuSimple's own kind: four rows, -2 where a lane is not.
TUSIMPLE = {"lanes": [[-2, 50, 40, 30], [-2, -2, 80, 95]], "h_samples": [160, 170, 180, 190], "raw_file": "clips/a.jpg"}
TUSIMPLE_LINES = [[50, 170], [40, 180], [30, 190]], [[80, 180], [95, 190]]
CULANE = "10 300 60.5 200 110 100 \n400 300 380 200\n"
CULANE_LINES = [[10, 300], [60.5, 200], [110, 100]], [[400, 300], [380, 200]]
CULANE_FILES = {"driver/a.jpg": None, "driver/a.lines.txt": CULANE}
KEYPOINTS = ["left_near", "left_far", "right_near", "right_far"]
COCO_VALUES = {
    "images": [{"id": 7, "file_name": "a.png", "width": 640, "height": 360}, {"id": 8, "file_name": "b.png"}],
    "annotations": [{"id": 1, "image_id": 7, "category_id": 3, "keypoints": [1, 2, 2, 3, 4, 1, 5, 6, 2, 7, 8, 2]}],
    "categories": [{"id": 1, "name": "boat"}, {"id": 3, "name": "deck", "keypoints": KEYPOINTS}],
}
UNSEEN = {"image_id": 7, "category_id": 3, "keypoints": [0] * 12}
LEFT = {"label": "Left edge", "points": [[20.0, 40.0], [40.0, 10.0]], "shape_type": "line", "group_id": None}
RIGHT = {"label": "Runway-RIGHT", "points": [[80.0, 40.0], [70.0, 25.0], [60.0, 10.0]], "shape_type": "linestrip"}
CENTRE = {"label": "centre", "points": [[50.0, 40.0], [50.0, 10.0]], "shape_type": "line"}
BOX = "0 .5 .5 .4 .4"
ROW = f"{BOX} .2 .8 .4 .2 .8 .8 .6 .2"
LINES = [[19.5, 39.5], [39.5, 9.5]], [[79.5, 39.5], [59.5, 9.5]]  # of ROW, px of 100x50


def labelme(*shapes, image="..\\images\\a.jpg") -> dict:
    return {"version": "5.0.1", "shapes": list(shapes), "imagePath": image, "imageData": None}


def yolo(row=ROW, settings=None, folder="labels/train", images="images/train") -> dict:
    files = {f"{folder}/a.txt": row, f"{folder}/classes.txt": "runway\n", f"{images}/a.jpg": None}
    return files if settings is None else files | {"data.yaml": settings}


def culane(listed: str, lines=CULANE) -> dict:
    return {"driver/a.jpg": None, "driver/a.lines.txt": lines, "list/val.txt": listed}


@pytest.mark.parametrize(
    ("form", "files", "source", "expected"),
    [
        ("tusimple", {"label_data_0601.json": f"{json.dumps(TUSIMPLE)}\n\n"}, "", {"clips/a.jpg": TUSIMPLE_LINES}),
        ("tusimple", {"label_data.json": TUSIMPLE | {"lanes": [[-2] * 4, [-2, -2, 80, 95]]}}, "",
         {"clips/a.jpg": (None, TUSIMPLE_LINES[1])}),
        ("culane", CULANE_FILES, "", {"driver/a.jpg": CULANE_LINES}),
        ("culane", culane("/driver/a.jpg\n"), "list/val.txt", {"driver/a.jpg": CULANE_LINES}),
        ("culane", culane("/driver/a.jpg /laneseg_label_w16/driver/a.png 1 1\n\n"), "list/val.txt",
         {"driver/a.jpg": CULANE_LINES}),
        ("culane", culane("/driver/a.jpg 1 0\n", "1 2 3 4\n"), "list/val.txt",
         {"driver/a.jpg": ([[1, 2], [3, 4]], None)}),
        ("culane", culane("/driver/a.jpg 0 1\n", "1 2 3 4\n"), "list/val.txt",
         {"driver/a.jpg": (None, [[1, 2], [3, 4]])}),
        ("culane", culane("/driver/a.jpg 0 0\n", ""), "list/val.txt", {"driver/a.jpg": (None, None)}),
        ("coco", {"person_keypoints.json": COCO_VALUES}, "",
         {"a.png": ([[1, 2], [3, 4]], [[5, 6], [7, 8]]), "b.png": (None, None)}),
        ("labelme", {"json/a.json": labelme(CENTRE, RIGHT, LEFT), "b.json": labelme(image="b.png")}, "",
         {"b.png": (None, None), "images/a.jpg": (LINES[0], [[79.5, 39.5], [69.5, 24.5], [59.5, 9.5]])}),
        ("labelme", {"b.json": labelme(image="b.png")}, "b.json", {"b.png": (None, None)}),
        ("yolo-pose", yolo(), "", {"images/train/a.jpg": LINES}),
        ("yolo-pose", yolo(f"{BOX} .2 .8 2 .4 .2 1 .8 .8 2 .6 .2 2\n\n", folder="train/labels", images="train/images"),
         "", {"train/images/a.jpg": LINES}),
        ("yolo-pose", yolo("\n", folder=".", images="."), "", {"a.jpg": (None, None)}),
        ("yolo-pose", yolo(f"{BOX} .2 .8 .4 .2 0 0 0 0"), "", {"images/train/a.jpg": (LINES[0], None)}),
        ("yolo-pose", yolo(f"{BOX} .2 .8 2 .4 .2 2 .8 .8 0 .6 .2 0"), "", {"images/train/a.jpg": (LINES[0], None)}),
    ],
)  # fmt: skip
def test_files_of_the_published_form_are_read(lay, form, files, source, expected):
    root = lay(files)
    found, images = READERS[form](root / source)
    assert found == root
    assert [image.file for image in images] == list(expected)
    for image in images:
        for line, wanted in zip(image.lines.values(), expected[image.file], strict=True):
            assert (line is None) == (wanted is None)
            if line is not None:
                np.testing.assert_allclose(line, wanted)


@pytest.mark.parametrize(
    ("names", "settings"),
    [
        (["right", "Left_far", "left", "right", "aim"], None),
        ((), "kpt_shape: [5, 2]\nkpt_names: # in order\n  0:\n    - right_near\n    - left_far\n    - left_near\n"
             "    - right_far\n    - aim\nnames:\n  0: runway\n"),
        ((), "kpt_names: {0: [right_1, left_2, left_1, right_2, aim]}\n"),
    ],
)  # fmt: skip
def test_keypoints_are_taken_by_the_names_given_or_those_of_data_yaml(lay, names, settings):
    folder = lay(yolo(f"{BOX} .8 .8 .4 .2 .2 .8 .6 .2 .5 .5", settings))
    _, (image,) = read_yolo_pose(folder if settings is None else folder / "data.yaml", names)
    np.testing.assert_allclose(image.left_px, LINES[0][::-1])
    np.testing.assert_allclose(image.right_px, LINES[1])


@pytest.mark.parametrize(
    ("name", "side"),
    [("Runway right", "right"), ("LEFT", "left"), ("left-edge", "left"), ("edge_Right1", "right"),
     ("rwyLeft", "left"), ("leftmost", "left"), ("upright", None), ("centre", None), ("", None)],
)  # fmt: skip
def test_a_side_is_a_word_of_a_label(name, side):
    assert find_side(name, "a.json") == side


BAD = {
    "tusimple": [
        ("{\n", ["line 1:", "JSON"]),
        ("[1]", ["line 1", "raw_file"]),
        (TUSIMPLE | {"raw_file": 3}, ["line 1: raw_file"]),
        (TUSIMPLE | {"lanes": None}, ["line 1:", "lanes"]),
        (TUSIMPLE | {"lanes": [[1, 2, 3]]}, ["line 1: lanes[0]", "4 h_samples"]),
        (TUSIMPLE | {"lanes": [["a", 2, 3, 4]]}, ["line 1: lanes[0]"]),
        (TUSIMPLE | {"lanes": [[-2, -2, -2, 4], [1, 2, 3, 4]]}, ["line 1: lanes[0]", "-2"]),
        (TUSIMPLE | {"lanes": [[1, 2, 3, 4]]}, ["line 1: one line"]),
        (TUSIMPLE | {"lanes": [[1, 2, 3, 4]] * 3}, ["line 1: 3 lines"]),
        ("", ["label_data.json", "no labels"]),
    ],
    "coco": [
        ("{", ["JSON"]),
        ("[]", ["images, annotations, categories"]),
        (COCO_VALUES | {"images": [], "annotations": []}, ["no images"]),
        (COCO_VALUES | {"images": [{"id": 1}], "annotations": []}, ["images[0]: file_name"]),
        (COCO_VALUES | {"categories": [{"id": 1, "keypoints": ["nose"]}]}, ["category", "left_1"]),
        (COCO_VALUES | {"categories": [{"id": 1, "keypoints": "nose"}]}, ["categories[0]: keypoints"]),
        (COCO_VALUES | {"annotations": [3]}, ["annotations[0]"]),
        (COCO_VALUES | {"annotations": [UNSEEN] * 2}, ["annotations[1]:", "image 7"]),
        (COCO_VALUES | {"annotations": [UNSEEN | {"image_id": "7"}]}, ["annotations:", "image_id '7'"]),
        (COCO_VALUES | {"images": [{"id": 7, "file_name": "a.png"}] * 2}, ["images: 2", "id 7"]),
        (COCO_VALUES | {"annotations": [UNSEEN | {"keypoints": [1]}]}, ["annotations[0]: keypoints", "3"]),
        (COCO_VALUES | {"annotations": [UNSEEN | {"keypoints": [1, 2, 2, 3, 4, 2, 5, 6, 2, 0, 0, 0]}]},
         ["annotations[0]: right", "[u, v]"]),
    ],
    "labelme": [
        (labelme() | {"shapes": "none"}, ["a.json: shapes"]),
        (labelme({"points": []}), ["shapes[0]: label"]),
        (labelme(LEFT, LEFT | {"label": "left 2"}), ["shapes[1]: left 2", "second left line"]),
        (labelme(LEFT | {"label": "left and right"}), ["shapes[0]: 'left and right'"]),
        (labelme(LEFT | {"shape_type": "polygon"}), ["shapes[0]: Left edge", "linestrip", "'polygon'"]),
        (labelme(LEFT | {"points": [[1, 2]]}), ["shapes[0]: Left edge"]),
        (labelme(LEFT | {"points": [[1, 2], [2, 1e306]]}), ["shapes[0]: Left edge", "1e+06"]),
        (labelme(CENTRE, CENTRE | {"label": "ship"}), ["a.json:", "left or right", "centre, ship"]),
        ({"images": []}, ["a.json", "shapes, imagePath"]),
    ],
}  # fmt: skip
BAD_NAMES = {"tusimple": "label_data.json", "coco": "annotations.json", "labelme": "json/a.json"}


@pytest.mark.parametrize(("form", "content", "words"), [(form, *case) for form, cases in BAD.items() for case in cases])
def test_bad_json_is_one_line_that_names_file_and_place(lay, missing_words, form, content, words):
    name = BAD_NAMES[form]
    root = lay({name: content})
    assert missing_words([str(root / name), *words], READERS[form], root) == []


@pytest.mark.parametrize(
    ("form", "files", "source", "words"),
    [
        ("culane", CULANE_FILES | {"driver/a.lines.txt": "1 2 3\n"}, "", ["a.lines.txt: line 1", "[u, v]"]),
        ("culane", CULANE_FILES | {"driver/a.lines.txt": "1 2 3 4\nu v w x\n"}, "", ["a.lines.txt: line 2"]),
        ("culane", CULANE_FILES | {"driver/a.lines.txt": "1 2 3 4\n"}, "", ["a.lines.txt: one line"]),
        ("culane", CULANE_FILES | {"driver/a.lines.txt": "1 2 3 4\n" * 4}, "", ["a.lines.txt: 4 lines"]),
        ("culane", culane("/driver/a.jpg 0 1 1 0\n"), "list/val.txt", ["val.txt: line 1: 4 flags"]),
        ("culane", culane("\n/driver/a.jpg 0 1\n"), "list/val.txt", ["val.txt: line 2: flags 0 1", "2 lines"]),
        ("culane", culane("/driver/b.jpg\n"), "list/val.txt", ["b.lines.txt"]),
        ("culane", culane("\n"), "list/val.txt", ["val.txt: no labels"]),
        ("culane", {"driver/a.lines.txt": CULANE}, "", ["a.lines.txt: no image a.*"]),
        ("tusimple", {}, "", ["label_data*.json"]),
        ("coco", {}, "", ["annotations.json"]),
        ("coco", {"a.json": COCO_VALUES, "b.json": COCO_VALUES}, "", ["2 files *.json"]),
        ("labelme", {}, "", [".json"]),
        ("yolo-pose", {}, "", ["labels/*.txt"]),
        ("yolo-pose", yolo(f"{ROW}\n{ROW}"), "", ["a.txt: 2 runways"]),
        ("yolo-pose", yolo(f"{ROW} x"), "", ["a.txt:", f"'{ROW} x'"]),
        ("yolo-pose", yolo(BOX), "", ["a.txt: 0 numbers"]),
        ("yolo-pose", yolo(f"{ROW} .1"), "", ["a.txt: 9 numbers"]),
        ("yolo-pose", yolo(ROW, "kpt_names: {0: [left, right]}"), "", ["a.txt: 8 numbers", "2", "(left, right)"]),
        ("yolo-pose", yolo(ROW, "kpt_names: [a, b, c, d]"), "", ["a, b, c, d", "--keypoints"]),
        ("yolo-pose", yolo(f"{BOX} .2 .8 .4 .2 .8 .8 0 0"), "", ["a.txt: right"]),
        ("yolo-pose", yolo(f"{BOX} .2 nan .4 .2 .8 .8 .1 .1"), "", ["a.txt: left"]),
        ("yolo-pose", yolo() | {"images/train/a.jpg": "none"}, "", ["a.jpg:"]),
        ("yolo-pose", {"labels/train/a.txt": ROW}, "", ["a.txt: no image a.* in", "images/train"]),
    ],
)  # fmt: skip
def test_bad_files_and_missing_ones_are_named_in_one_line(lay, missing_words, form, files, source, words):
    assert missing_words(words, READERS[form], lay(files) / source) == []


IMAGE = LabelledImage("a.png", np.array([[20.0, 40.0], [100.0, 0.0]]), None, (120, 41))


def test_lanes_are_written_at_rows_in_the_published_form(tmp_path, missing_words):
    write_tusimple(tmp_path / "label_data.json", [IMAGE], 10)
    assert json.loads((tmp_path / "label_data.json").read_text()) == {
        "lanes": [[100.0, 80.0, 60.0, 40.0, 20.0], [-2] * 5],
        "h_samples": [0, 10, 20, 30, 40],
        "raw_file": "a.png",
    }
    write_culane(tmp_path, [IMAGE], 20)
    assert (tmp_path / "a.lines.txt").read_text() == "20.000 40 60.000 20 100.000 0\n"
    assert (tmp_path / "list" / "train.txt").read_text() == "/a.png\n"
    assert (tmp_path / "list" / "train_gt.txt").read_text() == "/a.png /laneseg_label/a.png 1 0\n"
    unknown = [LabelledImage("a.png", None, None)]
    assert missing_words(["a.png", "size"], write_tusimple, tmp_path / "x.json", unknown) == []
    assert missing_words(["a b.png"], write_culane, tmp_path, [LabelledImage("a b.png", None, None, (9, 9))]) == []


def test_cocos_own_reader_reads_what_is_written(tmp_path, missing_words):
    left, right = np.array([[100.0, 300.0], [200.0, 100.0]]), np.array([[500.0, 300.0], [400.0, 100.0]])
    lines = {"a.png": (left, right), "b.png": (None, None), "c.png": (None, right)}
    WRITERS["coco"](tmp_path, [LabelledImage(file, *sides, SIZE) for file, sides in lines.items()], 1, 3)
    coco = COCO(str(tmp_path / "annotations.json"))
    assert [image["file_name"] for image in coco.loadImgs(coco.getImgIds())] == list(lines)
    (category,) = coco.loadCats(coco.getCatIds(catNms=["runway"]))
    assert category["keypoints"] == ["left_1", "left_2", "left_3", "right_1", "right_2", "right_3"]
    assert category["skeleton"] == [[1, 2], [2, 3], [4, 5], [5, 6]]
    (both,), none, (one,) = (coco.loadAnns(coco.getAnnIds(imgIds=[k])) for k in (1, 2, 3))
    assert both["keypoints"][:9] == [100.0, 300.0, 2, 150.0, 200.0, 2, 200.0, 100.0, 2]
    assert (both["bbox"], both["area"]) == ([100.0, 100.0, 400.0, 200.0], 80000.0)
    assert none == []
    assert (one["num_keypoints"], one["keypoints"][:9]) == (3, [0.0, 0.0, 0] * 3)
    assert missing_words(["2", "1"], WRITERS["coco"], tmp_path, [], 1, 1) == []


def test_labelme_files_are_written_beside_their_images(tmp_path):
    (tmp_path / "images").mkdir()
    write_labelme(tmp_path, [LabelledImage("images/a.png", np.array(LINES[0]), None, (100, 50))], 2)
    values = json.loads((tmp_path / "images" / "a.json").read_text())
    shape = {"label": "left", "points": LEFT["points"], "group_id": None, "shape_type": "linestrip", "flags": {}}
    expected = {"shapes": [shape], "imagePath": "a.png", "imageWidth": 100, "imageHeight": 50}
    assert {key: values[key] for key in expected} == expected


def test_yolo_rows_are_shares_of_the_picture_and_end_at_its_edge(tmp_path):
    """The second image's left line goes on below the picture, its right one never comes into it."""
    lines = np.array([[19.5, 79.5], [39.5, 9.5]]), np.array([[120.0, 40.0], [110.0, 10.0]])
    images = [("a", (np.array(LINES[0]), None), 2), ("b", lines, 3)]
    rows = []
    for name, sides, count in images:
        write_yolo_pose(tmp_path, [LabelledImage(f"images/{name}.png", *sides, (100, 50))], count)
        rows.append(np.array((tmp_path / "labels" / f"{name}.txt").read_text().split(), dtype=float))
        settings = (tmp_path / "data.yaml").read_text()
        assert f"kpt_shape: [{2 * count}, 3]\n" in settings
        assert f"flip_idx: {[*range(count, 2 * count), *range(count)]}\n" in settings
    assert "0: [left_1, left_2, left_3, right_1, right_2, right_3]" in settings
    np.testing.assert_allclose(rows[0], [0, 0.3, 0.5, 0.2, 0.6, 0.2, 0.8, 2, 0.4, 0.2, 2, 0, 0, 0, 0, 0, 0])
    assert ((rows[1] >= 0) & (rows[1] <= 2)).all() and (rows[1][1:5] <= 1).all()
    points = rows[1][5:].reshape(6, 3)
    np.testing.assert_allclose(points[[0, 2], :2], [[0.2 + 0.2 * 3 / 7, 1.0], [0.4, 0.2]], atol=2e-3)
    assert points[:, 2].tolist() == [2, 2, 2, 0, 0, 0] and not points[3:].any()


def distance_px(points, line) -> np.ndarray:
    """Distance of points (N, 2) to the nearest spot of a polyline (M, 2), by projection onto its segments."""
    start, along = line[:-1], np.diff(line, axis=0)
    share = ((points[:, None] - start) * along).sum(axis=2) / np.maximum((along**2).sum(axis=1), 1e-30)
    nearest = start + np.clip(share, 0, 1)[..., None] * along
    return np.linalg.norm(points[:, None] - nearest, axis=2).min(axis=1)


@st.composite
def labelled_images(draw) -> LabelledImage:
    """Left of u = 300 and right of 340: straight or bent lines, at least 20 rows high, or none."""
    lines = []
    for low_u, high_u in ((0.0, 300.0), (340.0, 639.0)):
        if draw(st.booleans()):
            v = sorted(draw(st.lists(st.floats(0.0, 359.0), min_size=2, max_size=6, unique=True)), reverse=True)
            v[0], v[-1] = max(v[0], 200.0), min(v[-1], 180.0)
            u = draw(st.lists(st.floats(low_u, high_u), min_size=len(v), max_size=len(v)))
            lines.append(np.stack([u, v], axis=1))
        else:
            lines.append(None)
    return LabelledImage("images/a.png", *lines, SIZE)


ROUNDING_PX = {"tusimple": 0.005, "culane": 0.0005, "yolo-pose": 0.001}  # of a written point; all others write 0.001 px


@pytest.mark.parametrize("form", [*READERS, "own"])
@settings(deadline=None, max_examples=40)
@given(image=labelled_images(), step=st.integers(1, 5))
def test_what_is_written_is_read_back(form, image, step):
    """Steps are rows between points, or points of a line less one; formats with rows lose up to one at each end."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "images").mkdir()
        if form == "own":
            write_labels(folder / "labels.json", [image])
            lines = read_labels(folder / "labels.json")[image.file]
        else:
            if form == "yolo-pose":  # its reader needs the picture's size
                cv2.imwrite(str(folder / image.file), np.zeros((SIZE[1], SIZE[0]), np.uint8))
            WRITERS[form](folder, [image], step, step + 1)
            _, (read,) = READERS[form](folder)
            lines = read.lines
            assert read.file == image.file
    lost = 2 * step + 2 if form in ("tusimple", "culane") else 0
    for side, line in image.lines.items():
        assert (lines[side] is None) == (line is None)
        if line is not None:
            assert distance_px(lines[side], line).max() <= ROUNDING_PX.get(form, 0.0005 * 2**0.5) + 1e-6
            assert abs(np.ptp(lines[side][:, 1]) - np.ptp(line[[0, -1], 1])) <= lost + 0.002
