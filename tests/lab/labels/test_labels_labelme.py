import json

import numpy as np
import pytest

from deckline_lab.labels import LabelledImage
from deckline_lab.labels.labelme import read_labelme, write_labelme

LEFT = {"label": "Left edge", "points": [[20.0, 40.0], [40.0, 10.0]], "shape_type": "line", "group_id": None}
RIGHT = {"label": "right", "points": [[80.0, 40.0], [70.0, 25.0], [60.0, 10.0]], "shape_type": "linestrip"}
CENTRE = {"label": "centre", "points": [[50.0, 40.0], [50.0, 10.0]], "shape_type": "line"}


def labelled(tmp_path, shapes, image="..\\images\\a.jpg", name="json/a.json"):
    file = tmp_path / name
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps({"version": "5.0.1", "shapes": shapes, "imagePath": image, "imageData": None}))
    return tmp_path


def test_lines_and_line_strips_named_left_and_right_are_read_from_folder_and_file(tmp_path):
    labelled(tmp_path, [], "b.png", "b.json")
    root, (empty, image) = read_labelme(labelled(tmp_path, [CENTRE, RIGHT, LEFT]))
    assert (root, image.file) == (tmp_path, "images/a.jpg")
    np.testing.assert_array_equal(image.left_px, [[19.5, 39.5], [39.5, 9.5]])
    np.testing.assert_array_equal(image.right_px, [[79.5, 39.5], [69.5, 24.5], [59.5, 9.5]])
    assert (empty.file, empty.lines) == ("b.png", {"left": None, "right": None})
    assert [item.file for item in read_labelme(tmp_path / "b.json")[1]] == ["b.png"]


@pytest.mark.parametrize(
    ("shapes", "message"),
    [
        ("none", r"a\.json: shapes must be a list"),
        ([{"points": []}], r"shapes\[0\]: label must be a text"),
        ([LEFT, LEFT], r"shapes\[1\]: a second left line"),
        ([LEFT | {"shape_type": "polygon"}], r"shapes\[0\]: Left edge must be a line or linestrip, got 'polygon'"),
        ([LEFT | {"points": [[1, 2]]}], r"shapes\[0\]: Left edge must be two or more"),
        ([LEFT | {"points": [[1, 2], [2, 1e306]]}], r"shapes\[0\]: Left edge must be two or more .* at most 1e\+06"),
        ([CENTRE, CENTRE | {"label": "ship"}], r"a\.json: no shape is labelled left or right, but centre, ship"),
    ],
)
def test_bad_files_are_one_line_that_says_where(tmp_path, shapes, message):
    with pytest.raises(ValueError, match=message) as caught:
        read_labelme(labelled(tmp_path, shapes))
    assert "\n" not in str(caught.value)


def test_other_json_files_and_empty_folders_are_named(tmp_path):
    with pytest.raises(ValueError, match=r"no \.json files"):
        read_labelme(tmp_path)
    (tmp_path / "x.json").write_text('{"images": []}')
    with pytest.raises(ValueError, match=r"x\.json: no labelme file"):
        read_labelme(tmp_path)


def test_written_files_lie_beside_their_images(tmp_path):
    (tmp_path / "images").mkdir()
    line = np.array(LEFT["points"]) - 0.5
    write_labelme(tmp_path, [LabelledImage("images/a.png", line, None, (100, 50))], 2)
    values = json.loads((tmp_path / "images" / "a.json").read_text())
    (shape,) = values["shapes"]
    assert (shape["label"], shape["shape_type"], shape["points"]) == ("left", "linestrip", LEFT["points"])
    assert (values["imagePath"], values["imageWidth"], values["imageHeight"]) == ("a.png", 100, 50)
