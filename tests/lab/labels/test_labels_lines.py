import json
import tempfile
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deckline_lab.labels import LabelledImage, read_labels
from deckline_lab.labels.coco import read_coco
from deckline_lab.labels.lanes import read_culane, read_tusimple
from deckline_lab.labels.lines import assign_sides, interpolate_rows, resample

PLAIN = st.none() | st.booleans() | st.integers(-5, 700) | st.floats() | st.text(max_size=4) | st.just(10**400)
ANYTHING = st.recursive(PLAIN, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=3), inner))
NUMBERS = st.lists(st.integers(-2, 300), min_size=2, max_size=4)
ONE = st.just(1) | ANYTHING


def list_of(**fields):
    """Lists of objects with these fields, and of anything."""
    return st.lists(st.fixed_dictionaries(fields) | ANYTHING)


TUSIMPLE = st.fixed_dictionaries(
    {"raw_file": st.just("a.png") | ANYTHING, "h_samples": NUMBERS | ANYTHING, "lanes": st.lists(NUMBERS) | ANYTHING}
)
SIX = st.lists(st.integers(0, 9), min_size=6, max_size=6) | ANYTHING
COCO = st.fixed_dictionaries(
    {
        "images": list_of(id=ONE, file_name=ANYTHING),
        "categories": list_of(id=ONE, keypoints=st.just(["left_1", "left_2"]) | ANYTHING),
        "annotations": list_of(image_id=ONE, category_id=ONE, keypoints=SIX),
    }
)
OWN = st.fixed_dictionaries({"frames": list_of(file=ANYTHING, left_px=ANYTHING, right_px=ANYTHING) | ANYTHING})


def line(*points):
    return np.array(points, dtype=float)


def refusal_of(read, name: str, content: bytes) -> str:
    """The error about a file, with FOLDER for its folder; empty where the file is read."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_bytes(content)
        (Path(folder) / "a.png").write_bytes(b"")
        try:
            read(path if not name.endswith(".lines.txt") else Path(folder))
        except ValueError as error:
            return str(error).replace(folder, "FOLDER")
        return ""


def is_one_line(refusal: str) -> bool:
    return "\n" not in refusal and "FOLDER" in refusal


@pytest.mark.parametrize(("read", "values"), [(read_tusimple, TUSIMPLE), (read_coco, COCO), (read_labels, OWN)])
@settings(deadline=None, max_examples=40)
@given(data=st.data())
def test_any_json_gives_labels_or_one_line_about_it(read, values, data):
    refusal = refusal_of(read, "a.json", json.dumps(data.draw(values | ANYTHING)).encode())
    assert not refusal or is_one_line(refusal)


@settings(deadline=None, max_examples=40)
@given(st.text(alphabet="0123456789.-e \nnaif", max_size=60) | st.text(max_size=20))
def test_any_text_gives_labels_or_one_line_about_it(text):
    for name in ("a.lines.txt", "train.txt"):
        refusal = refusal_of(read_culane, name, text.encode("utf-8", "replace"))
        assert not refusal or is_one_line(refusal)


@pytest.mark.parametrize("read", [read_tusimple, read_coco, read_labels])
@pytest.mark.parametrize("content", [b"\xff\xfe\x00", b"[" * 100_000, b"", b"\x00"])
def test_no_text_and_bottomless_json(read, content):
    assert is_one_line(refusal_of(read, "a.json", content))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", []),
        ("[]", ["frames"]),
        ('{"frames": []}', ["frames"]),
        ('{"frames": [{"left_px": null}]}', ["frames[0]: file"]),
        ('{"frames": [{"file": "a.png", "left_px": [[1, 2]]}]}', ["a.png left_px", "[u, v]"]),
        ('{"frames": [{"file": "a.png", "left_px": [[1, 2], [NaN, 2]]}]}', ["a.png left_px"]),
    ],
)
def test_bad_own_labels_are_named(tmp_path, missing_words, text, words):
    (tmp_path / "labels.json").write_text(text)
    assert missing_words([str(tmp_path / "labels.json"), *words], read_labels, tmp_path / "labels.json") == []
    assert missing_words(["gone.json"], read_labels, tmp_path / "gone.json") == []


def test_rows_are_crossed_where_the_line_is_and_nowhere_else():
    bent = line((100, 300), (200, 200), (200, 100))
    np.testing.assert_allclose(
        interpolate_rows(bent, [301, 300, 250, 200, 150, 99]), [np.nan, 100, 150, 200, 200, np.nan]
    )
    np.testing.assert_allclose(interpolate_rows(bent[::-1], [250, 150]), [150, 200])
    assert np.isnan(
        interpolate_rows(line((10, 50), (90, 50)), [49, 50, 51])
    ).all()  # a level line has no position on its row


def test_resampling_is_even_and_keeps_the_ends():
    corner = resample(line((0, 0), (30, 0), (30, 10)), 5)
    np.testing.assert_allclose(corner, [[0, 0], [10, 0], [20, 0], [30, 0], [30, 10]])


def test_left_is_left_on_the_rows_that_both_lines_have():
    # Seen from far right: on shared rows the first is left, though its middle lies right of the other's.
    long, short = line((600, 300), (200, 100)), line((260, 120), (240, 100))
    assert assign_sides([long, short], "x")[0] is long
    assert assign_sides([short, long], "x")[0] is long
    apart = line((50, 90), (60, 10)), line((10, 300), (20, 200))
    assert assign_sides(apart, "x")[0] is apart[1]
    assert assign_sides([], "x") == (None, None)


@pytest.mark.parametrize(
    ("function", "words"),
    [
        (partial(assign_sides, [line((0, 0), (1, 1))], "f: line 3"), ["f: line 3: one line"]),
        (partial(assign_sides, [line((0, 0), (1, 1))] * 3, "f"), ["f: 3 lines"]),
        (partial(LabelledImage, "a.png", None, line((1, 2))), ["a.png: right_px"]),
        (partial(LabelledImage, "a.png", line((1, 2), (np.nan, 3)), None), ["a.png: left_px"]),
    ],
)
def test_lines_without_two_points_or_sides_are_refused_by_name(missing_words, function, words):
    assert missing_words(words, function) == []
