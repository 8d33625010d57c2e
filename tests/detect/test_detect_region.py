import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deckline.detect.anchors import decode_region, encode_region

GRID = (32, 18)


@settings(deadline=None)
@given(st.floats(0, 505), st.floats(0, 280), st.floats(3, 500), st.floats(1, 280))
def test_decode_inverts_encode(x0, y0, width, height):
    box = np.array([x0, y0, min(x0 + width, 511), min(y0 + height, 287)])
    classes, offsets, weight = encode_region(box, GRID)
    assert classes.sum() == pytest.approx(1.0, abs=1e-5)
    assert weight.sum() == pytest.approx(1.0, abs=1e-5)
    region = decode_region(np.log(classes + 1e-12), offsets)
    np.testing.assert_allclose(region.box, box, atol=0.02)
    assert region.probability > 0.95


def test_no_runway_is_the_last_class():
    classes, _, weight = encode_region(None, GRID)
    assert classes[-1] == 1.0 and classes[:-1].sum() == 0.0 and weight.sum() == 0.0
    region = decode_region(np.log(classes + 1e-12), np.zeros((4, 18, 32), dtype=np.float32))
    assert region.probability < 1e-6


def test_wrong_use_is_refused():
    with pytest.raises(ValueError, match=r"box .*\(3\.0, 3\.0, 3\.0, 5\.0\)"):
        encode_region([3, 3, 3, 5], GRID)
    with pytest.raises(ValueError, match=r"expected logits of shape \(577,\), got \(576,\)"):
        decode_region(np.zeros(576), np.zeros((4, 18, 32)))


def test_a_certain_no_is_no_division_by_zero():
    logits = np.full(577, -2000.0)
    logits[-1] = 0.0
    region = decode_region(logits, np.zeros((4, 18, 32), dtype=np.float32))
    assert region.probability == 0.0
    assert np.isfinite(region.box).all()
