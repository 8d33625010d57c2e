import json
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from label_lines import labelled_images

from deckline.labels import read_labels, write_labels


def test_labels_are_read_and_bad_ones_named(tmp_path):
    path, left = tmp_path / "labels.json", [[100.0, 300.0], [250.0, 150.0], [300.0, 100.0]]
    path.write_text(json.dumps({"frames": [{"file": "a.png", "left_px": left, "right_px": None, "x": 1}]}))
    read = read_labels(path)
    np.testing.assert_array_equal(read["a.png"]["left"], left)
    assert read["a.png"]["right"] is None
    for text, message in (
        ("{", "not valid JSON"),
        ("[]", "frames"),
        ('{"frames": [{"left_px": null}]}', r"frames\[0\]: file"),
        ('{"frames": [{"file": "a.png", "left_px": [[1, 2]]}]}', r"a.png left_px .*two or more \[u, v\]"),
        ('{"frames": [{"file": "a.png", "left_px": [[1, 2], [NaN, 2]]}]}', "left_px .*two or more"),
    ):
        path.write_text(text)
        with pytest.raises(ValueError, match=message):
            read_labels(path)
    with pytest.raises(ValueError, match=r"gone\.json: cannot be read: No such file"):
        read_labels(tmp_path / "gone.json")


@settings(deadline=None)
@given(labelled_images())
def test_what_is_written_is_read_back_to_a_thousandth(image):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "labels.json"
        write_labels(path, [image])
        read = read_labels(path)[image.file]
    for side, line in image.lines.items():
        assert (read[side] is None) == (line is None)
        if line is not None:
            np.testing.assert_allclose(read[side], line, atol=0.0005 + 1e-9)
