"""Every detector keeps the contract. Parity of torch and ONNX is tested where the network is, in tests/train."""

import numpy as np
import pytest

from deckline.detect import OnnxDetector
from deckline.runtime import shipped_weights
from deckline_lab.rivals.catalog import ALL_DETECTORS

SIZES = [(720, 1280), (97, 131), (8, 8)]


@pytest.fixture(scope="module", params=sorted(ALL_DETECTORS))
def detector(request):
    return ALL_DETECTORS[request.param]()


@pytest.mark.parametrize("size", SIZES)
def test_contract(detector, size):
    image = np.random.default_rng(0).integers(0, 256, (*size, 3), dtype=np.uint8)
    before = image.copy()
    found = detector(image)
    again = detector(image) if size == SIZES[1] else found
    np.testing.assert_array_equal(image, before)
    for one, other in ((found.left, again.left), (found.right, again.right)):
        np.testing.assert_array_equal(one.points_px, other.points_px)
        assert len(one) == 0 or len(one) >= 3
        assert np.isfinite(one.points_px).all()
        assert ((one.confidence >= 0) & (one.confidence <= 1)).all()
        assert (one.sigma_px > 0).all()
        inside = (one.points_px > -2) & (one.points_px < [size[1] + 1, size[0] + 1])
        assert inside.all()


def test_a_detector_has_a_name_and_sees_nothing_in_an_empty_sky(detector):
    assert isinstance(detector.name, str) and detector.name
    detection = detector(np.full((720, 1280, 3), 170, dtype=np.uint8))
    assert len(detection.left) == len(detection.right) == 0


def test_a_model_of_another_kind_is_refused():
    with pytest.raises(ValueError, match=r"\.onnx.*\bclear\b.*row_logits"):
        OnnxDetector(shipped_weights("coarse-t"))
