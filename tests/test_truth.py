import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deckline.config import Approach
from deckline.geometry import Camera, pose
from deckline.truth import (
    compare_line,
    passing_distance_m,
    range_to_ramp_m,
    state_error,
    touchdown,
    true_centre,
    true_guidance,
    true_segments,
)
from deckline.types import Frame, RunwayLine, Segment, Truth

TRUTH = Segment(np.array([10.0, 2.0, -20.0]), np.array([110.0, 2.0, -20.0]))
LEFT = Segment(np.array([0.0, -10.0, 0.0]), np.array([200.0, -10.0, 0.0]))
RIGHT = Segment(np.array([0.0, 10.0, 0.0]), np.array([200.0, 10.0, 0.0]))


def line(point, azimuth):
    return RunwayLine(np.array(point, dtype=float), azimuth, np.eye(3))


def frame(**truth) -> Frame:
    camera, at = Camera.from_fov(64, 36, np.pi / 2), pose([-100.0, 3.0, -20.0], [1.0, 0.0, 0.0, 0.0])
    known = Truth(**({"left": LEFT, "right": RIGHT} | truth))
    return Frame("a.png", 0.0, np.zeros((36, 64, 3), np.uint8), camera, world_from_body=at, deck_z_m=0.0, truth=known)


def test_line_errors_have_the_documented_signs():
    estimate, turned = line([60.0, 3.5, -19.4], 0.0), line([60.0, 2.0, -20.0], 0.02)
    assert passing_distance_m(estimate, TRUTH, TRUTH.p0_m) == pytest.approx((1.5, 0.6))
    np.testing.assert_allclose(state_error(estimate, TRUTH), [1.5, 0.0, 0.6])
    assert state_error(turned, TRUTH)[1] == pytest.approx(0.02)
    assert passing_distance_m(turned, TRUTH, TRUTH.p0_m)[0] == pytest.approx(-50 * np.tan(0.02))
    errors = {"direction_error_deg": np.rad2deg(0.02), "lateral_error_m": 50 * np.tan(0.02), "height_error_m": 0.0}
    assert compare_line(turned, TRUTH) == pytest.approx(errors)


@given(st.floats(-3.1, 3.1), st.floats(-300, 300))
def test_errors_do_not_depend_on_direction_of_travel_or_the_point_on_the_line(angle, along):
    base = line([60.0, 4.0, -20.0], angle)
    same = line(base.point_m + along * base.direction, angle + np.pi)
    errors, again = compare_line(base, TRUTH), compare_line(same, TRUTH)
    assert 0 <= errors["direction_error_deg"] <= 90
    if abs(errors["direction_error_deg"] - 89.0) > 1e-6:
        assert again == pytest.approx(errors, abs=1e-6, rel=1e-6)


@pytest.mark.parametrize("turn_deg", [89.5, 90.0])
def test_a_line_across_has_no_lateral_error(turn_deg):
    errors = compare_line(line([60.0, 4.0, -20.0], np.deg2rad(turn_deg)), TRUTH)
    assert errors.keys() == {"direction_error_deg", "height_error_m"}


def test_true_lines_and_range():
    centre = true_centre(frame().truth)
    np.testing.assert_allclose([centre.p0_m, centre.p1_m], [[0.0, 0.0, 0.0], [200.0, 0.0, 0.0]])
    assert list(true_segments(frame().truth)) == ["left", "right", "centre"]
    np.testing.assert_allclose(touchdown(centre, 70.0), [70.0, 0.0, 0.0])
    assert range_to_ramp_m(frame()) == pytest.approx(np.hypot(100.0, 3.0))
    nothing = frame(left=None, right=None)
    assert true_centre(nothing.truth) is None and true_centre(None) is None and true_segments(nothing.truth) == {}
    assert np.isnan(range_to_ramp_m(nothing)) and true_guidance(nothing, Approach()) is None


def test_true_guidance_is_that_of_the_true_lines():
    exact = true_guidance(frame(), Approach())
    assert exact.lateral_deviation_m.value == pytest.approx(3.0)
    assert exact.height_above_deck_m.value == pytest.approx(20.0)
    assert exact.distance_to_ramp_m.value == pytest.approx(100.0)
