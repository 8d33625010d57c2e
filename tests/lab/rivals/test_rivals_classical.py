"""The finder without weights: ladders and stripes on a drawn deck, and everything it must not take for a runway."""

import numpy as np
import pytest

from deckline.types import Detection
from deckline_lab.rivals.classical import ClassicalDetector
from detect.drawn_deck import BOTTOM, TOP, at, deck

LADDERS = [-0.06, 0.06, 0.94, 1.06]


def seen(detection: Detection) -> tuple[bool, bool]:
    return len(detection.left) > 0, len(detection.right) > 0


@pytest.mark.parametrize("stripes", [[0.0, 1.0], [0.0, 0.5, 1.0], LADDERS, [*LADDERS, 0.5]])
def test_points_lie_on_the_midline_of_both_markings(stripes: list[float]) -> None:
    detection = ClassicalDetector()(deck(stripes))
    for points, share in ((detection.left, 0.0), (detection.right, 1.0)):
        assert len(points) > 0.9 * (BOTTOM - TOP)
        u, v = points.points_px.T
        errors = u - at(v, share)
        assert np.abs(errors).mean() < 0.4
        assert np.mean(np.abs(errors) < 2 * points.sigma_px) > 0.9
        assert points.confidence.min() > 0.9
    u0, v0, u1, v1 = detection.region_px or (0.0, 0.0, 0.0, 0.0)
    assert abs(v0 - TOP) <= 2 and abs(v1 - BOTTOM) <= 2
    assert abs(u0 - at(BOTTOM, 0)) < 3 and abs(u1 - at(BOTTOM, 1)) < 3


def parallel_stripes() -> np.ndarray:
    image = np.full((480, 800, 3), 70, np.uint8)
    image[100:400, 200:205] = image[100:400, 500:505] = 210
    return image


def foam_between_stripes() -> np.ndarray:
    image = deck([0.0, 1.0])
    v, u = np.mgrid[0:480, 0:800]
    foam = np.random.default_rng(1).integers(40, 255, (480, 800))
    between = (u > at(v, 0.1)) & (u < at(v, 0.9))
    image[between] = foam[between][:, None]
    return image


# Of four stripes any two could be the edges: it does not choose.
NO_RUNWAYS = [deck([0.0]), parallel_stripes(), deck([0.0, 0.25, 0.6, 1.0]), foam_between_stripes()]


@pytest.mark.parametrize("image", NO_RUNWAYS, ids=["one stripe", "parallel", "two runways", "foam"])
def test_what_is_no_runway_or_not_the_only_one_is_not_seen(image: np.ndarray) -> None:
    assert seen(ClassicalDetector()(image)) == (False, False)


def test_two_runways_side_by_side_are_seen_in_the_box_of_one() -> None:
    """The same deck twice: the whole image leaves open which is the runway; a prior's box decides."""
    both = np.full((480, 1600, 3), 70, np.uint8)
    both[:, :800], both[40:, 800:] = deck([0.0, 1.0]), deck([0.0, 1.0])[:440]
    assert seen(ClassicalDetector()(both)) == (False, False)
    detection = ClassicalDetector()(both, (180.0, 140.0, 620.0, 430.0))
    assert seen(detection) == (True, True)
    assert np.abs(detection.left.points_px[:, 0] - at(detection.left.points_px[:, 1], 0.0)).mean() < 0.5


def test_wrong_use_is_refused() -> None:
    with pytest.raises(ValueError, match=r"\(5, 5, 3\) of float64"):
        ClassicalDetector()(np.zeros((5, 5, 3)))  # type: ignore[arg-type]
