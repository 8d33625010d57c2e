"""The finder without weights: ladders and stripes on a drawn deck, and everything it must not take for a runway."""

import numpy as np
import pytest
from drawn_deck import BOTTOM, TOP, at, deck
from scipy.spatial.transform import RigidTransform

from deckline.detect import ClassicalDetector
from deckline.detect.classical import VanishingPrior
from deckline.geometry import Camera, attitude, camera_mount
from deckline.types import Detection

LADDERS = [-0.06, 0.06, 0.94, 1.06]
RIGHT_PRIOR = VanishingPrior(np.array([400.0, 60.0]), 40.0)


def seen(detection: Detection) -> tuple[bool, bool]:
    return len(detection.left) > 0, len(detection.right) > 0


@pytest.mark.parametrize("stripes", [[0.0, 1.0], [0.0, 0.5, 1.0], LADDERS, [*LADDERS, 0.5]])
def test_points_lie_in_the_middle_of_both_markings(stripes: list[float]) -> None:
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


def test_a_mirrored_picture_has_its_sides_swapped() -> None:
    image = deck(LADDERS)
    plain, mirrored = ClassicalDetector()(image), ClassicalDetector()(image[:, ::-1].copy())
    assert len(plain.left) > 0
    line = np.polyfit(*plain.left.points_px.T[::-1], 1)
    turned = np.polyfit(*mirrored.right.points_px.T[::-1], 1)
    np.testing.assert_allclose(799 - np.polyval(turned, [200, 400]), np.polyval(line, [200, 400]), atol=0.2)


def test_one_stripe_is_no_runway() -> None:
    assert seen(ClassicalDetector()(deck([0.0]))) == (False, False)


def test_parallel_stripes_are_no_runway() -> None:
    image = np.full((480, 800, 3), 70, np.uint8)
    image[100:400, 200:205] = image[100:400, 500:505] = 210
    assert seen(ClassicalDetector()(image)) == (False, False)


def test_two_runways_are_none() -> None:
    """Four stripes of which any two could be the edges: it does not choose."""
    assert seen(ClassicalDetector()(deck([0.0, 0.25, 0.6, 1.0]))) == (False, False)


def test_what_is_as_bright_between_as_on_the_stripes_is_no_runway() -> None:
    image = deck([0.0, 1.0])
    v, u = np.mgrid[0:480, 0:800]
    foam = np.random.default_rng(1).integers(40, 255, (480, 800))
    between = (u > at(v, 0.1)) & (u < at(v, 0.9))
    image[between] = foam[between][:, None]
    assert seen(ClassicalDetector()(image)) == (False, False)


def test_a_prior_rules_out_pairs_that_meet_elsewhere() -> None:
    image, detector = deck(LADDERS), ClassicalDetector()
    assert seen(detector(image, vanishing=RIGHT_PRIOR)) == (True, True)
    assert seen(detector(image, vanishing=VanishingPrior(np.array([500.0, 60.0]), 40.0))) == (False, False)


def test_a_prior_can_settle_what_the_picture_cannot() -> None:
    """Another pair beside the runway, just as good, that meets 150 px away."""
    image, other = deck([0.0, 1.0]), deck([0.0, 1.0])
    both = np.full((480, 1600, 3), 70, np.uint8)
    both[:, :800], both[40:, 800:] = image, other[:440]
    assert seen(ClassicalDetector()(both)) == (False, False)
    assert seen(ClassicalDetector()(both, vanishing=RIGHT_PRIOR)) == (True, True)


def test_a_pose_says_where_the_lines_meet() -> None:
    """A far point of a level line along the azimuth, projected, is the vanishing point."""
    camera = Camera.from_fov(1280, 720, np.deg2rad(90))
    body = RigidTransform.from_components([-300.0, 20.0, -60.0], attitude(0.05, -0.1, 2.9))
    world_from_camera = body * camera_mount()
    prior = VanishingPrior.from_pose(camera, world_from_camera, 3.0, np.deg2rad(5))
    far = np.array([[-300.0, 20.0, -60.0]]) + 1e7 * np.array([[np.cos(3.0), np.sin(3.0), 0.0]])
    np.testing.assert_allclose(prior.point_px, camera.project(world_from_camera.inv().apply(far))[0], atol=1e-2)
    assert prior.radius_px == pytest.approx(640 * np.tan(np.deg2rad(5)))
    with pytest.raises(ValueError, match="the camera looks away from the runway's direction"):
        VanishingPrior.from_pose(camera, world_from_camera, 3.0 - np.pi, 0.1)


def test_wrong_use_is_refused() -> None:
    with pytest.raises(ValueError, match=r"expected an image \(H, W, 3\) of uint8, got \(5, 5, 3\) of float64"):
        ClassicalDetector()(np.zeros((5, 5, 3)))  # type: ignore[arg-type]
