"""A belief as frame, lines and track, and all of it in widths."""

from dataclasses import replace

import numpy as np
import pytest
from runway_picture import CAMERA, LEVEL, Place, Runway, belief_of, frame_at, line_of, pose_of

from deckline.picture_pose.answer import estimate_of, in_widths, lines_of, track_of, with_pose
from deckline.picture_pose.states import CLOSING_M_S, line_rows, shared_sigmas
from deckline.types import (
    NO_POSE,
    DepthMode,
    Diagnostic,
    LineVisibility,
    PoseSource,
    Reason,
    RunwayEstimate,
    Scale,
    TrackState,
)

RUNWAY = Runway(width_m=18.0, angle_rad=0.006, slope=0.01)
PLACE = Place()
UNSURE = Diagnostic(Reason.UNSURE, "the direction is too uncertain")
SHARED = shared_sigmas(CAMERA, LEVEL)


def sure_belief(sigma=0.01):
    start = belief_of(PLACE, RUNWAY)
    return replace(start, covariance=np.diag(np.full(start.mean.shape, sigma**2)))


def track(ramp=True, belief=None):
    return track_of(belief or sure_belief(), TrackState.TRACKING, ramp, SHARED, LEVEL)


def test_the_frame_has_the_pose_above_a_deck_at_zero():
    placed = with_pose(replace(frame_at(1.0), sea_z_m=3.0), sure_belief())
    np.testing.assert_allclose(placed.world_from_body.as_matrix(), pose_of(PLACE, RUNWAY).as_matrix(), atol=1e-12)
    assert (placed.pose_source, placed.deck_z_m, placed.sea_z_m) == (PoseSource.PICTURE, 0.0, None)


@pytest.mark.parametrize("at_m", [0.0, 70.0])
def test_the_lines_are_those_of_the_runway(at_m):
    lines = lines_of(sure_belief(), at_m, LEVEL)
    for side in ("left", "right"):
        points = line_of(RUNWAY, side)
        expected = [np.interp(at_m, points[:, 0], points[:, axis]) for axis in range(3)]
        np.testing.assert_allclose(lines[side].point_m, expected, atol=1e-4)
    assert lines["right"].azimuth_rad - lines["left"].azimuth_rad == pytest.approx(0.006)
    np.testing.assert_allclose(lines["centre"].point_m, [at_m, 0.0, 0.01 * at_m])


def test_the_lines_covariance_is_the_beliefs_and_that_of_the_mount():
    belief = sure_belief()
    rows, line = line_rows(belief, 70.0), lines_of(belief, 70.0, LEVEL)["centre"]
    own = rows @ belief.covariance @ rows.T
    turned = LEVEL.sensors.attitude_rad * np.array([PLACE.distance_m + 70.0, 1.0, 0.0])
    np.testing.assert_allclose(line.covariance, own + np.outer(turned, turned))
    np.testing.assert_array_equal(line.aircraft_covariance, line.covariance)


def test_the_estimate_keeps_its_picture_and_drops_reasons_that_hold_no_longer():
    seen = RunwayEstimate(LineVisibility.BOTH, DepthMode.NONE, {}, {}, diagnostics=(NO_POSE, UNSURE))
    found = estimate_of(seen, sure_belief(), True, LEVEL)
    assert (found.seen, found.mode, found.diagnostics) == (LineVisibility.BOTH, DepthMode.WIDTH, (UNSURE,))
    assert found.ramp_m.tolist() == [0.0, 0.0, 0.0]
    assert found.ramp_sigma_m == pytest.approx(0.01)
    assert found.lines["centre"].point_m[0] == LEVEL.approach.touchdown_m
    unseen = estimate_of(seen, sure_belief(), False, LEVEL)
    assert (unseen.ramp_m, unseen.ramp_sigma_m) == (None, None)
    assert unseen.lines["centre"].point_m[0] == 0.0


def test_the_track_has_rates_where_they_are_known():
    found = track()
    assert found.closing_m_s.value == pytest.approx(CLOSING_M_S)
    assert (found.lateral_rate_m_s.value, found.height_rate_m_s.value) == (0.0, 0.0)
    assert found.scale_sources == (Scale.WIDTH,)
    assert track(ramp=False).closing_m_s is None
    assert track(ramp=False).protection.distance_m is None
    unsure = track(belief=sure_belief(sigma=25.0))
    assert (unsure.closing_m_s, unsure.lateral_rate_m_s, unsure.height_rate_m_s) == (None, None, None)


@pytest.mark.parametrize("width", [10.0, 20.0])
def test_widths_are_metres_over_the_width(width):
    belief = sure_belief()
    frame, followed = with_pose(frame_at(0.0), belief), track(belief=belief)
    estimate = estimate_of(RunwayEstimate(LineVisibility.BOTH, DepthMode.NONE, {}, {}), belief, True, LEVEL)
    scaled_frame, scaled_estimate, scaled = in_widths(frame, estimate, followed, width)
    assert scaled_frame.in_widths
    for name in ("world_from_body", "world_from_camera"):
        scaled_pose, pose = (getattr(one, name) for one in (scaled_frame, frame))
        np.testing.assert_allclose(width * scaled_pose.translation, pose.translation, atol=1e-12)
        np.testing.assert_allclose(scaled_pose.rotation.as_matrix(), pose.rotation.as_matrix(), atol=1e-12)
    assert in_widths(frame_at(0.0), estimate, followed, width)[0].world_from_body is None
    for side, line in followed.lines.items():
        np.testing.assert_allclose(width * scaled.lines[side].point_m, line.point_m)
        sigma, unit = np.sqrt(np.diag(line.covariance)), np.sqrt(np.diag(scaled.lines[side].covariance))
        np.testing.assert_allclose(unit, sigma / [width, 1.0, width])
        assert scaled.lines[side].azimuth_rad == line.azimuth_rad
    assert scaled.ramp_sigma_m == scaled_estimate.ramp_sigma_m == pytest.approx(followed.ramp_sigma_m / width)
    for name in ("protection", "closing_m_s", "lateral_rate_m_s", "height_rate_m_s"):
        assert getattr(scaled, name) is None
