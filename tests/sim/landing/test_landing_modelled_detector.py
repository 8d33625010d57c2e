"""Drawn detections have the statistics of their model."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform
from scipy.stats import norm

from deckline.geometry import Camera, camera_mount
from deckline.types import Segment
from deckline_sim.landing.detection_model import FalseLines, read_detection_model
from deckline_sim.landing.modelled_detector import ModelledDetector, latent_mean, visible_ends

CAMERA = Camera.from_fov(1280, 720, np.deg2rad(60.0))
LINES = tuple(Segment(np.array([400.0, y, 0.0]), np.array([640.0, y, 0.0])) for y in (-12.0, 12.0))
POSE = RigidTransform.from_translation([0.0, 0.0, -30.0]) * camera_mount()


def test_visible_ends_are_the_projected_ends() -> None:
    ends_m = POSE.inv().apply(np.stack([LINES[0].p0_m, LINES[0].p1_m]))
    ends = visible_ends(CAMERA, ends_m)
    assert ends is not None
    np.testing.assert_allclose(ends[:, :2], CAMERA.project(ends_m))
    np.testing.assert_allclose(ends[:, 2], 1.0 / ends_m[:, 2])


def test_visible_ends_are_cut_at_the_border() -> None:
    ends_m = np.array([[0.5, 1.0, 0.5], [0.5, 5.0, 100.0]])  # passes below the camera
    ends = visible_ends(CAMERA, ends_m)
    assert ends is not None
    assert ends[0, 1] == pytest.approx(CAMERA.height - 1.0)
    depth = 1.0 / ends[0, 2]
    share = (depth - 0.5) / 99.5
    np.testing.assert_allclose(CAMERA.project(ends_m[:1] + share * (ends_m[1:] - ends_m[:1]))[0], ends[0, :2])


@pytest.mark.parametrize("ends_m", [[[0.0, 1.0, -9.0], [0.0, 1.0, -5.0]], [[90.0, 1.0, 10.0], [95.0, 1.0, 12.0]]])
def test_lines_out_of_view_have_no_ends(ends_m: list[list[float]]) -> None:
    assert visible_ends(CAMERA, np.array(ends_m)) is None


def test_presence_has_the_chance_of_its_probit() -> None:
    presence = replace(read_detection_model().presence, intercept=4.0, per_visibility=-4.0, per_size=0.0)
    model = replace(read_detection_model(), presence=presence)
    mean = float(latent_mean(presence, 400.0 / 420.0, 60.0, False))
    found = 0
    for seed in range(600):
        detector = ModelledDetector(model, False, 420.0, np.random.default_rng(seed))
        found += len(detector.detect(0.0, LINES, POSE, CAMERA).left) > 0
    assert found / 600 == pytest.approx(norm.cdf(mean), abs=0.07)


def test_false_lines_lie_at_their_distance() -> None:
    model = read_detection_model()
    none = (0.0,) * 6
    errors = replace(model.errors, offset=none, slope=none, slope_outward=none, white=none)
    wrong = replace(model, errors=errors, false_lines=FalseLines(1e9, 1e9, 5.0))
    detector = ModelledDetector(wrong, False, 5000.0, np.random.default_rng(3))
    points = detector.detect(0.0, LINES, POSE, CAMERA).left.points_px
    ends = visible_ends(CAMERA, POSE.inv().apply(np.stack([LINES[0].p0_m, LINES[0].p1_m])))
    assert ends is not None
    share = (points[:, 1] - ends[0, 1]) / (ends[1, 1] - ends[0, 1])
    true_u, _, inverse_m = (start + share * (end - start) for start, end in zip(*ends, strict=True))
    np.testing.assert_allclose((points[:, 0] - true_u) / (CAMERA.fx * inverse_m), detector.lines[0].false_m, rtol=1e-6)
    assert abs(detector.lines[0].false_m) > 0.1
