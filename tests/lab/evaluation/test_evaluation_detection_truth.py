import dataclasses

import numpy as np
import pytest
from level_deck import frame_at

from deckline.detect.prior import project_prior
from deckline.types import Frame
from deckline_lab.evaluation.detection_truth import (
    AZIMUTH_SIGMA_RAD,
    FALSE_WIDTH_M,
    SceneKind,
    draw_runway_prior,
    expected_from_labels,
    expected_from_truth,
)


def test_what_there_is_to_find():
    both = expected_from_truth(frame_at(-100.0))
    assert both.scene is SceneKind.DECK
    assert both.range_m == pytest.approx(100.0)
    assert both.visibility_m == 800.0
    assert expected_from_truth(frame_at(-100.0, left=None, right=None)).scene is SceneKind.EMPTY
    assert expected_from_truth(frame_at(-100.0, yaw_rad=np.pi)).scene is SceneKind.EMPTY  # looking away
    assert expected_from_truth(frame_at(-100.0, visibility_m=50.0)).scene is SceneKind.UNRATED  # hidden in haze
    assert expected_from_truth(frame_at(300.0, yaw_rad=np.pi)).scene is SceneKind.UNRATED  # from ahead: left is right
    assert expected_from_truth(frame_at(-9000.0, visibility_m=np.inf)).scene is SceneKind.UNRATED  # a pixel or two
    # Turned so far that the left line alone is in the image.
    assert expected_from_truth(frame_at(-30.0, yaw_rad=np.deg2rad(53.0))).scene is SceneKind.UNRATED


def test_labels_decide_what_there_is_to_find():
    line = np.array([[1.0, 2.0], [3.0, 4.0]])
    for left, right, scene in (
        (line, line, SceneKind.DECK),
        (line, None, SceneKind.UNRATED),
        (None, None, SceneKind.EMPTY),
    ):
        assert expected_from_labels({"left": left, "right": right}, frame_at(-100.0).image_rgb).scene is scene


def test_frames_without_truth_or_pose_are_named():
    with pytest.raises(ValueError, match="truth"):
        expected_from_truth(dataclasses.replace(frame_at(-100.0), truth=None))
    with pytest.raises(ValueError, match="pose"):
        expected_from_truth(dataclasses.replace(frame_at(-100.0), world_from_body=None))


def named(file: str, **truth) -> Frame:
    return dataclasses.replace(frame_at(-500.0, deck_z_m=None, **truth), file=file)


def test_prior_errors_have_the_stated_sigmas():
    drawn = [draw_runway_prior(named(f"{i}"), 30.0) for i in range(400)]
    middles = np.array([(prior.left_m[0] + prior.right_m[0]) / 2 for prior in drawn])
    along = np.array([prior.left_m[1] - prior.left_m[0] for prior in drawn])
    # 400 draws: 1-sigma of a standard deviation is 3.5 % of it.
    np.testing.assert_allclose(middles.std(axis=0), [30.0, 30.0, 7.5], rtol=0.12)
    assert np.arctan2(along[:, 1], along[:, 0]).std() == pytest.approx(AZIMUTH_SIGMA_RAD, rel=0.12)
    np.testing.assert_allclose(np.linalg.norm(along, axis=1), 200.0)
    assert {prior.sigma_m for prior in drawn} == {30.0}


def test_an_exact_prior_is_the_truth_and_a_frame_draws_the_same_again():
    one = named("a")
    prior = draw_runway_prior(one, 0.0)
    np.testing.assert_allclose((prior.left_m[0] + prior.right_m[0]) / 2, [0.0, 0.0, 0.0], atol=1e-9)
    assert np.linalg.norm(prior.right_m[0] - prior.left_m[0]) == pytest.approx(20.0)
    first, again, other = (draw_runway_prior(named(file), 9.0) for file in ("a", "a", "b"))
    np.testing.assert_array_equal(first.left_m, again.left_m)
    assert not np.array_equal(first.left_m, other.left_m)


def test_a_frame_without_a_runway_gets_a_false_prior_in_view():
    for number in range(50):
        empty = named(f"{number}", left=None, right=None)
        prior = draw_runway_prior(empty, 10.0)
        assert project_prior(empty, prior) is not None
        assert np.linalg.norm(prior.left_m[0] - prior.right_m[0]) == pytest.approx(FALSE_WIDTH_M)


def test_without_truth_or_pose_there_is_no_prior():
    assert draw_runway_prior(dataclasses.replace(named("a"), truth=None), 10.0) is None
    assert draw_runway_prior(dataclasses.replace(named("a"), world_from_body=None), 10.0) is None
