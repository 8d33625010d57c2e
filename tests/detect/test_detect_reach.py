"""Expectations, right and wrong, on rendered approaches, with the shipped network and the classical finder."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.detect import ClassicalDetector, OnnxDetector
from deckline.detect.coarse_to_fine import NetworkOutput, detect_lines
from deckline.detect.prior import project_prior
from deckline.runtime import shipped_weights
from deckline.sim import SimConfig, frames
from deckline.types import Detection, Frame, RunwayPrior

APPROACH = SimConfig(
    preset="cvn", trajectory="approach", frames=3, visibility_m=(5000.0, 5000.0), seed=1005, start_m=900.0, end_m=250.0
)
# An error of the aircraft's own position, m, north and east, and of its heading, deg: up to 100 m and 10 degrees.
WRONG = [(100.0, 0.0, 0.0), (0.0, 100.0, 0.0), (0.0, -100.0, 10.0), (-70.0, 70.0, -10.0), (0.0, 0.0, 10.0)]
SAME_PX = 0.5  # median distance between two looks at one line


@pytest.fixture(scope="module")
def approach() -> list[Frame]:
    return list(frames(APPROACH))


@pytest.fixture(scope="module")
def network() -> OnnxDetector:
    """The shipped network; a view that it has seen is not worked for again."""
    detector, known = OnnxDetector(shipped_weights("detect")), {}
    infer = detector.infer

    def remembered(view: np.ndarray) -> NetworkOutput:
        key = view.tobytes()
        if key not in known:
            known[key] = infer(view)
        return known[key]

    detector.infer = remembered
    return detector


@pytest.fixture(scope="module")
def blind(network):
    """The same network, whose search of the whole image never sees anything."""
    config = replace(network.config, min_probability=1.1)
    return lambda image, box=None: detect_lines(image, network.infer, config, box)


def true_runway(frame: Frame, sigma_m: float, sigma_deg: float) -> RunwayPrior:
    lines = (np.stack([line.p0_m, line.p1_m]) for line in (frame.truth.left, frame.truth.right))
    return RunwayPrior(*lines, sigma_m, np.deg2rad(sigma_deg))


def wrong_box(frame: Frame, error: tuple[float, float, float], sigma_m: float, sigma_deg: float):
    """Where a frame whose pose is wrong expects the runway."""
    north, east, heading = error
    pose = frame.world_from_body
    turned = Rotation.from_euler("z", heading, degrees=True) * pose.rotation
    moved = RigidTransform.from_components(pose.translation + np.array([north, east, 0.0]), turned)
    return project_prior(replace(frame, world_from_body=moved), true_runway(frame, sigma_m, sigma_deg))


def from_truth_px(frame: Frame, detection: Detection) -> list[float]:
    """Median distance of each line's points from the true line, along u, px."""
    camera_from_world = frame.world_from_camera.inv()
    found = []
    for points, line in ((detection.left, frame.truth.left), (detection.right, frame.truth.right)):
        (u0, v0), (u1, v1) = frame.camera.project(camera_from_world.apply([line.p0_m, line.p1_m]))
        u, v = points.points_px.T
        found.append(float(np.median(np.abs(u - (u0 + (v - v0) * (u1 - u0) / (v1 - v0))))))
    return found


def both(detection: Detection) -> bool:
    return len(detection.left) > 0 and len(detection.right) > 0


@pytest.mark.parametrize("error", WRONG)
def test_wrong_expectations_end_in_the_searchs_own_lines(network, approach, error):
    for frame in approach:
        searched = network(frame.image_rgb)
        assert both(searched)
        told = network(frame.image_rgb, wrong_box(frame, error, 5.0, 1.0))
        np.testing.assert_array_equal(told.left.points_px, searched.left.points_px)
        np.testing.assert_array_equal(told.right.points_px, searched.right.points_px)


def test_an_expectation_replaces_a_search_that_sees_nothing(blind, approach):
    for frame in approach:
        assert not both(blind(frame.image_rgb))
        told = blind(frame.image_rgb, project_prior(frame, true_runway(frame, 5.0, 1.0)))
        assert both(told)
        assert max(from_truth_px(frame, told)) < SAME_PX


@pytest.mark.parametrize("error", WRONG)
@pytest.mark.parametrize("honest", [True, False])
def test_without_a_search_wrong_expectations_end_in_the_true_lines_or_in_none(blind, approach, error, honest):
    seen = []
    for frame in approach[:2]:
        told = blind(frame.image_rgb, wrong_box(frame, error, *((60.0, 6.0) if honest else (2.0, 0.5))))
        seen.append(both(told))
        if seen[-1]:
            assert max(from_truth_px(frame, told)) < SAME_PX
        else:
            assert len(told.left) == len(told.right) == 0
    assert any(seen) or not honest


def test_an_expectation_on_the_open_sea_ends_not_seen(blind, network, approach):
    frame = approach[0]
    for box in ((20.0, 420.0, 220.0, 560.0), (1040.0, 440.0, 1240.0, 600.0)):
        told = blind(frame.image_rgb, box)
        assert len(told.left) == len(told.right) == 0
        assert both(network(frame.image_rgb, box))


def test_an_expectation_that_covers_the_image_is_a_search(blind, network, approach):
    frame = approach[1]
    box = (-0.5, -0.5, 1279.5, 719.5)
    np.testing.assert_array_equal(blind(frame.image_rgb, box).left.points_px, network(frame.image_rgb).left.points_px)


def test_the_classical_finder_looks_where_it_is_told(approach):
    """A bright pair elsewhere makes it doubt what is the runway, until it is told where to look."""
    detector, frame = ClassicalDetector(), approach[2]
    box = project_prior(frame, true_runway(frame, 1.0, 0.2))
    assert not both(detector(frame.image_rgb))
    told = detector(frame.image_rgb, box)
    assert both(told)
    assert max(from_truth_px(frame, told)) < 3.0
