import json
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from label_lines import distance_px, labelled_images

from deckline.labels import LabelledImage, read_tusimple, write_tusimple

# A row of TuSimple's own kind: four rows, -2 where a lane is not.
OFFICIAL = {"lanes": [[-2, 50, 40, 30], [-2, -2, 80, 95]], "h_samples": [160, 170, 180, 190], "raw_file": "clips/a.jpg"}


def write(tmp_path, *entries) -> Path:
    path = tmp_path / "label_data_0601.json"
    path.write_text("".join(e if isinstance(e, str) else json.dumps(e) + "\n" for e in entries))
    return path


def test_a_row_of_the_published_form_is_read(tmp_path):
    (image,) = read_tusimple(write(tmp_path, OFFICIAL)).images
    assert image.file == "clips/a.jpg"
    np.testing.assert_array_equal(image.left_px, [[50, 170], [40, 180], [30, 190]])
    np.testing.assert_array_equal(image.right_px, [[80, 180], [95, 190]])


def test_a_folder_is_searched_for_the_usual_names(tmp_path):
    write(tmp_path, OFFICIAL, "\n", OFFICIAL)
    found = read_tusimple(tmp_path)
    assert found.root == tmp_path
    assert len(found.images) == 2


def test_a_lane_that_is_absent_keeps_its_place(tmp_path):
    (image,) = read_tusimple(write(tmp_path, OFFICIAL | {"lanes": [[-2] * 4, [-2, -2, 80, 95]]})).images
    assert image.left_px is None
    assert len(image.right_px) == 2


def test_written_rows_are_the_lines_at_those_rows(tmp_path):
    path = tmp_path / "label_data.json"
    image = LabelledImage("a.png", np.array([[20.0, 40.0], [100.0, 0.0]]), None, (120, 60))
    write_tusimple(path, [image], 10)
    assert json.loads(path.read_text()) == {
        "lanes": [[100.0, 80.0, 60.0, 40.0, 20.0, -2], [-2] * 6],
        "h_samples": [0, 10, 20, 30, 40, 50],
        "raw_file": "a.png",
    }


@settings(deadline=None)
@given(labelled_images(), st.integers(1, 5))
def test_round_trip_keeps_the_lines(image, step):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "label_data.json"
        write_tusimple(path, [image], step)
        (read,) = read_tusimple(path).images
    for side, line in image.lines.items():
        again = read.lines[side]
        assert (again is None) == (line is None)
        if line is not None:
            assert distance_px(again, line).max() <= 0.005 + 1e-6
            assert again[:, 1].min() - line[:, 1].min() <= step  # equal only by rounding
            assert line[:, 1].max() - again[:, 1].max() <= step


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("{\n", "line 1: not valid JSON"),
        ([1], "line 1 must be an object with raw_file"),
        (OFFICIAL | {"raw_file": 3}, "line 1: raw_file"),
        (OFFICIAL | {"lanes": None}, "line 1: h_samples and lanes must be lists"),
        (OFFICIAL | {"lanes": [[1, 2, 3]]}, r"line 1: lanes\[0\] must hold one u for each of the 4"),
        (OFFICIAL | {"lanes": [["a", 2, 3, 4]]}, r"line 1: lanes\[0\] and h_samples must be numbers"),
        (OFFICIAL | {"lanes": [[1e999, 2, 3, 4]]}, r"line 1: lanes\[0\].*\[u, v\]"),
        (OFFICIAL | {"lanes": [[-2, -2, -2, 4], [1, 2, 3, 4]]}, r"line 1: lanes\[0\].*\[u, v\]"),
        (OFFICIAL | {"lanes": [[1, 2, 3, 4]]}, "line 1: one line alone"),
        (OFFICIAL | {"lanes": [[1, 2, 3, 4]] * 3}, "line 1: 3 lines; a runway has two"),
    ],
)
def test_bad_files_are_one_line_that_says_where(tmp_path, entry, message):
    path = write(tmp_path, entry)
    with pytest.raises(ValueError, match=message) as caught:
        read_tusimple(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_nothing_to_read_and_nothing_to_write(tmp_path):
    with pytest.raises(ValueError, match=r"no label_data\*\.json in this folder"):
        read_tusimple(tmp_path)
    with pytest.raises(ValueError, match="no labels in it"):
        read_tusimple(write(tmp_path, ""))
    with pytest.raises(ValueError, match=r"a\.png: this format needs the image's size"):
        write_tusimple(tmp_path / "x.json", [LabelledImage("a.png", None, None)])
