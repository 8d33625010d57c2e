import json

import numpy as np
import pytest
from pycocotools.coco import COCO

from deckline.labels import LabelledImage
from deckline.labels.formats import read_coco, write_coco

SIZE = (640, 360)
LEFT, RIGHT = np.array([[100.0, 300.0], [200.0, 100.0]]), np.array([[500.0, 300.0], [400.0, 100.0]])
EMPTY = {"image_id": 7, "category_id": 3, "keypoints": [0] * 12}


def example() -> dict:
    return {
        "images": [{"id": 7, "file_name": "a.png", "width": 640, "height": 360}, {"id": 8, "file_name": "b.png"}],
        "annotations": [{"id": 1, "image_id": 7, "category_id": 3, "keypoints": [1, 2, 2, 3, 4, 1, 5, 6, 2, 0, 0, 0]}],
        "categories": [
            {"id": 1, "name": "boat"},
            {"id": 3, "name": "deck", "keypoints": ["left_near", "left_far", "right_near", "right_far"]},
        ],
    }


def test_keypoints_are_read_by_their_names(tmp_path):
    values, path = example(), tmp_path / "person_keypoints.json"
    values["annotations"][0]["keypoints"][9:] = [7, 8, 2]
    path.write_text(json.dumps(values))
    found = read_coco(tmp_path)
    assert found.root == tmp_path
    first, second = found.images
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


def broken(**changes) -> str:
    return json.dumps(example() | changes)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "not valid JSON"),
        ("[]", "images, annotations, categories"),
        (broken(images=[], annotations=[]), "it names no images"),
        (broken(images=[{"id": 1}], annotations=[]), r"images\[0\]: file_name"),
        (broken(categories=[{"id": 1, "keypoints": ["nose"]}]), "no category has keypoints named left_1"),
        (broken(categories=[{"id": 1, "keypoints": "nose"}]), r"categories\[0\]: keypoints"),
        (broken(annotations=[3]), r"annotations\[0\] must be an object"),
        (broken(annotations=[EMPTY] * 2), r"annotations\[1\]: .* image 7"),
        (broken(annotations=[EMPTY | {"keypoints": [1]}]), r"annotations\[0\]: keypoints must be 3 numbers"),
        (broken(), r"annotations\[0\]: right must be two or more \[u, v\]"),
    ],
)
def test_bad_files_are_one_line_that_says_where(tmp_path, text, message):
    path = tmp_path / "a.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=message) as caught:
        read_coco(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_folder_must_hold_one_file_of_labels(tmp_path):
    with pytest.raises(ValueError, match=r"annotations\.json"):
        read_coco(tmp_path)
    for name in ("a.json", "b.json"):
        (tmp_path / name).write_text(broken())
    with pytest.raises(ValueError, match=r"2 files \*\.json"):
        read_coco(tmp_path)
    with pytest.raises(ValueError, match=r"2 keypoints.*1"):
        write_coco(tmp_path / "x.json", [], 1)
