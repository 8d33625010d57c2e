import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from label_lines import distance_px, labelled_images

from deckline.labels import LabelledImage, read_culane, write_culane

TWO_LINES = "10 300 60.5 200 110 100 \n400 300 380 200\n"


def folder_with(tmp_path, lines=TWO_LINES, listed=None) -> Path:
    (tmp_path / "driver").mkdir(exist_ok=True)
    (tmp_path / "driver" / "a.jpg").write_bytes(b"")
    (tmp_path / "driver" / "a.lines.txt").write_text(lines)
    if listed is not None:
        (tmp_path / "list").mkdir(exist_ok=True)
        (tmp_path / "list" / "val.txt").write_text(listed)
    return tmp_path / "list" / "val.txt" if listed is not None else tmp_path


@pytest.mark.parametrize(
    "listed", [None, "/driver/a.jpg\n", "/driver/a.jpg 1 1\n", "/driver/a.jpg /laneseg_label_w16/driver/a.png 1 1\n\n"]
)
def test_a_file_of_the_published_form_is_read_from_folder_and_list(tmp_path, listed):
    found = read_culane(folder_with(tmp_path, listed=listed))
    (image,) = found.images
    assert found.root == tmp_path
    assert image.file == "driver/a.jpg"
    np.testing.assert_array_equal(image.left_px, [[10, 300], [60.5, 200], [110, 100]])
    np.testing.assert_array_equal(image.right_px, [[400, 300], [380, 200]])


def test_flags_say_which_line_a_single_one_is(tmp_path):
    for flags, side in (("1 0", "left"), ("0 1", "right")):
        (image,) = read_culane(folder_with(tmp_path, "1 2 3 4\n", f"/driver/a.jpg {flags}\n")).images
        assert [name for name, line in image.lines.items() if line is not None] == [side]
    (image,) = read_culane(folder_with(tmp_path, "", "/driver/a.jpg 0 0\n")).images
    assert image.left_px is None and image.right_px is None


def test_written_files_are_of_the_published_form(tmp_path):
    write_culane(tmp_path, [LabelledImage("a.png", np.array([[20.0, 40.0], [100.0, 0.0]]), None, (120, 41))], 20)
    assert (tmp_path / "a.lines.txt").read_text() == "20.000 40 60.000 20 100.000 0\n"
    assert (tmp_path / "list" / "train.txt").read_text() == "/a.png\n"
    assert (tmp_path / "list" / "train_gt.txt").read_text() == "/a.png /laneseg_label/a.png 1 0\n"


@settings(deadline=None)
@given(labelled_images(), st.integers(1, 5))
def test_round_trip_keeps_the_lines(image, step):
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "images").mkdir()
        write_culane(folder, [image], step)
        (read,) = read_culane(folder).images
    for side, line in image.lines.items():
        again = read.lines[side]
        assert (again is None) == (line is None)
        if line is not None:
            assert distance_px(again, line).max() <= 0.0005 + 1e-6
            assert again[:, 1].min() - line[:, 1].min() < step + 1
            assert line[:, 1].max() - again[:, 1].max() < step + 1


@pytest.mark.parametrize(
    ("lines", "listed", "message"),
    [
        ("1 2 3\n", None, r"a\.lines\.txt: line 1 must be two or more \[u, v\]"),
        ("1 2 3 4\nu v w x\n", None, r"a\.lines\.txt: line 2 must be two or more"),
        ("1 2\n", None, r"a\.lines\.txt: line 1 must be two or more"),
        ("1 2 3 4\n", None, r"a\.lines\.txt: one line alone"),
        ("1 2 3 4\n" * 4, None, r"a\.lines\.txt: 4 lines; a runway has two"),
        (TWO_LINES, "/driver/a.jpg 0 1 1 0\n", r"val\.txt: line 1: 4 flags"),
        (TWO_LINES, "\n/driver/a.jpg 0 1\n", r"val\.txt: line 2: flags 0 1, but .* holds 2 lines"),
        (TWO_LINES, "/driver/b.jpg\n", r"b\.lines\.txt: cannot be read: No such file"),
        (TWO_LINES, "\n", r"val\.txt: no labels"),
    ],
)
def test_bad_files_are_one_line_that_says_where(tmp_path, lines, listed, message):
    with pytest.raises(ValueError, match=message) as caught:
        read_culane(folder_with(tmp_path, lines, listed))
    assert "\n" not in str(caught.value)


def test_lines_without_their_image_and_names_with_spaces_are_refused(tmp_path):
    folder_with(tmp_path)
    (tmp_path / "driver" / "a.jpg").unlink()
    with pytest.raises(ValueError, match=r"a\.lines\.txt: no image a\.\* beside it"):
        read_culane(tmp_path)
    with pytest.raises(ValueError, match="cannot hold a file name with spaces"):
        write_culane(tmp_path, [LabelledImage("a b.png", None, None, (9, 9))])
