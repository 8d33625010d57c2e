"""Whatever a label file holds, reading it gives labels or one line that says what is wrong with it."""

import json
import tempfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deckline.labels import read_coco, read_culane, read_labels, read_tusimple

PLAIN = st.none() | st.booleans() | st.integers(-5, 700) | st.floats() | st.text(max_size=4) | st.just(10**400)
ANYTHING = st.recursive(PLAIN, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=3), inner))
NUMBERS = st.lists(st.integers(-2, 300), min_size=2, max_size=4)
TUSIMPLE = st.fixed_dictionaries(
    {"raw_file": st.just("a.png") | ANYTHING, "h_samples": NUMBERS | ANYTHING, "lanes": st.lists(NUMBERS) | ANYTHING}
)
KEYPOINTS = {"id": ANYTHING, "keypoints": st.just(["left_1", "left_2"]) | ANYTHING}
COCO = st.fixed_dictionaries(
    {
        "images": st.lists(st.fixed_dictionaries({"id": st.just(1) | ANYTHING, "file_name": ANYTHING}) | ANYTHING),
        "categories": st.lists(st.fixed_dictionaries({**KEYPOINTS, "id": st.just(1) | ANYTHING}) | ANYTHING),
        "annotations": st.lists(
            st.fixed_dictionaries(
                {
                    "image_id": st.just(1) | ANYTHING,
                    "category_id": st.just(1) | ANYTHING,
                    "keypoints": st.lists(st.integers(0, 9), min_size=6, max_size=6) | ANYTHING,
                }
            )
            | ANYTHING
        ),
    }
)
OWN = st.fixed_dictionaries(
    {
        "frames": st.lists(st.fixed_dictionaries({"file": ANYTHING, "left_px": ANYTHING, "right_px": ANYTHING}))
        | ANYTHING
    }
)


def labels_or_one_line(read, name: str, content: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_bytes(content)
        (Path(folder) / "a.png").write_bytes(b"")
        try:
            read(path if not name.endswith(".lines.txt") else Path(folder))
        except ValueError as error:
            assert "\n" not in str(error)
            assert folder in str(error)


@settings(deadline=None, max_examples=40)
@given(TUSIMPLE | ANYTHING)
def test_tusimple(value):
    labels_or_one_line(read_tusimple, "label_data.json", json.dumps(value).encode())


@settings(deadline=None, max_examples=40)
@given(COCO | ANYTHING)
def test_coco(value):
    labels_or_one_line(read_coco, "a.json", json.dumps(value).encode())


@settings(deadline=None, max_examples=40)
@given(OWN | ANYTHING)
def test_own(value):
    labels_or_one_line(read_labels, "labels.json", json.dumps(value).encode())


@settings(deadline=None, max_examples=40)
@given(st.text(alphabet="0123456789.-e \nnaif", max_size=60) | st.text(max_size=20))
def test_culane(text):
    labels_or_one_line(read_culane, "a.lines.txt", text.encode("utf-8", "replace"))
    labels_or_one_line(read_culane, "train.txt", text.encode("utf-8", "replace"))


@pytest.mark.parametrize("read", [read_tusimple, read_coco, read_labels])
@pytest.mark.parametrize("content", [b"\xff\xfe\x00", b"[" * 100_000, b"", b"\x00"])
def test_no_text_and_bottomless_json(read, content):
    labels_or_one_line(read, "a.json", content)
