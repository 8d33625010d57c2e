"""docs/how/network.md: its code decodes what deckline decodes, and its reference is what the network gives."""

import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from deckline.config import Engine
from deckline.detect import DETECTORS
from deckline.detect.anchors import decode, decode_region
from deckline.detect.crop import normalise

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def page():
    """What the page's code defines."""
    text = (DOCS / "how" / "network.md").read_text(encoding="utf-8")
    names = {}
    exec(re.search(r"```python\n(.*?)```", text, re.DOTALL)[1], names)
    return names


@pytest.fixture(scope="module")
def crop_rgb():
    return cv2.imread(str(DOCS / "figures" / "network_reference.png"))[..., ::-1]


@pytest.fixture(scope="module")
def reference():
    return json.loads((DOCS / "figures" / "network_reference.json").read_text())


def test_the_page_decodes_as_deckline_does(page, crop_rgb):
    detector = DETECTORS["hybrid"](Engine(threads=1))
    view = page["network_input"](crop_rgb)
    np.testing.assert_allclose(view[0], normalise(crop_rgb.astype(np.float32)), atol=1e-4)
    output = detector.infer(view[0])
    grid, config = detector.config.grid, detector.config
    for logits, line in zip(output.rows, decode(output.rows, grid, config.decode), strict=True):
        is_line = np.isfinite(line.x_px) & (line.confidence >= config.min_confidence)
        wanted = np.column_stack([line.x_px, grid.row_y, line.confidence, line.sigma_px])[is_line]
        np.testing.assert_allclose(page["row_points"](logits), wanted, atol=1e-6)
    probability = decode_region(output.region, output.box).probability
    assert page["runway_probability"](output.region) == pytest.approx(probability, abs=1e-6)


OF_8_BITS = 0.6, 0.0, 0.1, 0.3  # largest difference: x, y, px; confidence; sigma, px


@pytest.mark.parametrize(("name", "most"), [("hybrid", (0.02, 0.0, 0.02, 0.02)), ("hybrid-int8", OF_8_BITS)])
def test_the_reference_is_what_the_network_gives(page, crop_rgb, reference, name, most):
    output = DETECTORS[name](Engine(threads=1)).infer(page["network_input"](crop_rgb)[0])
    for side, logits in zip(("left", "right"), output.rows, strict=False):
        points = np.array(reference[f"{side}: x, y, confidence, sigma"])
        assert len(points) > 30
        off = np.abs(page["row_points"](logits) - points)
        assert np.all(off <= most)
        assert np.all(np.median(off, axis=0) <= np.array(most) / 5)
    assert reference["runway_probability"] == pytest.approx(page["runway_probability"](output.region), abs=1e-3)
