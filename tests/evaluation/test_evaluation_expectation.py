"""What a chain is told of a runway: errors as large as stated, and nothing that is there where nothing is."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from deckline.detect.prior import project_prior
from deckline.evaluation.expectation import AZIMUTH_SIGMA_RAD, drawn_expectation
from deckline.geometry import Camera, attitude
from deckline.types import Frame, Segment, Truth

LEFT = Segment(np.array([0.0, -12.0, -20.0]), np.array([200.0, -12.0, -20.0]))
RIGHT = Segment(np.array([0.0, 12.0, -20.0]), np.array([200.0, 12.0, -20.0]))


def frame(file: str, truth: Truth | None) -> Frame:
    camera = Camera.from_fov(64, 36, np.deg2rad(90))
    pose = RigidTransform.from_components([-500.0, 0.0, -60.0], attitude(0.0, -0.05, 0.0))
    return Frame(file, 0.0, np.zeros((36, 64, 3), np.uint8), camera, world_from_body=pose, deck_z_m=-20.0, truth=truth)


def test_the_errors_are_as_large_as_stated():
    drawn = [drawn_expectation(frame(f"{i}", Truth(LEFT, RIGHT)), 30.0) for i in range(400)]
    middles = np.array([(told.left_m[0] + told.right_m[0]) / 2 for told in drawn]) - [0.0, 0.0, -20.0]
    along = np.array([told.left_m[1] - told.left_m[0] for told in drawn])
    # 400 draws: 1-sigma of a standard deviation is 3.5 % of it.
    np.testing.assert_allclose(middles.std(axis=0), [30.0, 30.0, 7.5], rtol=0.12)
    assert np.arctan2(along[:, 1], along[:, 0]).std() == pytest.approx(AZIMUTH_SIGMA_RAD, rel=0.12)
    np.testing.assert_allclose(np.linalg.norm(along, axis=1), 200.0)
    assert {told.sigma_m for told in drawn} == {30.0}


def test_exact_is_the_truth_and_a_frame_draws_the_same_again():
    one = frame("a", Truth(LEFT, RIGHT))
    told = drawn_expectation(one, 0.0)
    np.testing.assert_allclose((told.left_m[0] + told.right_m[0]) / 2, [0.0, 0.0, -20.0], atol=1e-9)
    assert np.linalg.norm(told.right_m[0] - told.left_m[0]) == pytest.approx(24.0)
    first, again, other = (drawn_expectation(frame(file, Truth(LEFT, RIGHT)), 9.0) for file in ("a", "a", "b"))
    np.testing.assert_array_equal(first.left_m, again.left_m)
    assert not np.array_equal(first.left_m, other.left_m)


def test_where_there_is_no_runway_one_is_told_of_in_view():
    for number in range(50):
        empty = frame(f"{number}", Truth())
        told = drawn_expectation(empty, 10.0)
        assert project_prior(empty, told) is not None
        assert np.linalg.norm(told.left_m[0] - told.right_m[0]) == pytest.approx(24.0)


def test_without_truth_or_pose_nothing_is_told():
    assert drawn_expectation(frame("a", None), 10.0) is None
    assert drawn_expectation(replace(frame("a", Truth(LEFT, RIGHT)), world_from_body=None), 10.0) is None
