import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.geometry import Camera, attitude
from deckline.guide import guidance
from deckline.types import DepthMode, Frame, RunwayEstimate, RunwayLine, Status

CAMERA = Camera(4, 3, 2.0, 2.0, 1.5, 1.0)
NORTH = RunwayLine(np.array([0.0, 0.0, -20.0]), 0.0, np.diag([0.3, 0.01, 0.2]) ** 2)


def frame(position, rotation=None):
    pose = None if position is None else RigidTransform.from_components(position, rotation or Rotation.identity())
    return Frame("a.png", 2.5, np.zeros((3, 4, 3), dtype=np.uint8), CAMERA, world_from_body=pose)


def estimate(**changes):
    values = dict(status=Status.OK, mode=DepthMode.COARSE, pixel_lines={}, lines={"centre": NORTH})
    return RunwayEstimate(**values | changes)


def test_signs_right_of_the_line_nose_right_above_and_before_the_ramp():
    body = frame([-100.0, 4.0, -29.0], attitude(0.1, -0.05, 0.02))
    found = guidance(body, estimate(ramp_m=np.array([-60.0, 0.0, -20.0]), ramp_sigma_m=1.5))
    assert found.lateral_deviation_m.value == pytest.approx(4.0)
    assert found.heading_error_rad.value == pytest.approx(0.02)
    assert found.height_above_deck_m.value == pytest.approx(9.0)
    assert found.distance_to_ramp_m.value == pytest.approx(40.0)
    assert found.distance_to_ramp_m.sigma == 1.5
    assert (found.time_s, found.status, found.mode, found.reason) == (2.5, Status.OK, DepthMode.COARSE, "")


def test_sigma_of_the_lateral_deviation_grows_with_the_distance_to_the_line():
    found = guidance(frame([-100.0, 4.0, -29.0]), estimate())
    assert found.lateral_deviation_m.sigma == pytest.approx(np.hypot(0.3, 100 * 0.01))
    assert found.heading_error_rad.sigma == pytest.approx(0.01)
    assert found.height_above_deck_m.sigma == pytest.approx(0.2)


def test_correlation_and_relative_covariance_are_used():
    jacobian = np.array([1.0, 100.0, 0.0])  # an azimuth error that turns the line about the aircraft
    turned = np.outer([1.0, 0.01, 0.0], [1.0, 0.01, 0.0])
    line = RunwayLine(NORTH.point_m, 0.0, turned)
    assert guidance(frame([-100.0, 0, -29.0]), estimate(lines={"centre": line})).lateral_deviation_m.sigma < 1e-7
    assert jacobian @ np.diag(np.diag(turned)) @ jacobian > 1
    relative = RunwayLine(NORTH.point_m, 0.0, turned, np.diag([0.04, 0.0, 0.0]))
    found = guidance(frame([-100.0, 0, -29.0]), estimate(lines={"centre": relative}))
    assert found.lateral_deviation_m.sigma == pytest.approx(0.2)


@given(st.floats(-3.1, 3.1), st.floats(-50, 50), st.floats(-0.5, 0.5), st.floats(-500, -10))
def test_deviations_do_not_depend_on_where_the_world_points(turn, lateral, heading, along):
    c, s = np.cos(turn), np.sin(turn)
    line = RunwayLine(np.array([7.0, -3.0, -20.0]), turn, NORTH.covariance)
    position = line.point_m + along * np.array([c, s, 0]) + lateral * np.array([-s, c, 0]) + [0, 0, -5.0]
    body = frame(position, attitude(0.2, 0.1, turn + heading))
    found = guidance(body, estimate(lines={"centre": line}))
    assert found.lateral_deviation_m.value == pytest.approx(lateral, abs=1e-9)
    assert found.heading_error_rad.value == pytest.approx(heading, abs=1e-9)


def test_one_line_gives_the_height_alone():
    found = guidance(frame([-100.0, 4.0, -29.0]), estimate(status=Status.ONE_LINE, lines={"left": NORTH}, reason="one"))
    assert found.height_above_deck_m.value == pytest.approx(9.0)
    assert found.lateral_deviation_m is None
    assert found.heading_error_rad is None
    assert found.distance_to_ramp_m is None
    assert (found.status, found.reason) == (Status.ONE_LINE, "one")


def test_no_ramp_no_distance():
    assert guidance(frame([-100.0, 4.0, -29.0]), estimate()).distance_to_ramp_m is None


@pytest.mark.parametrize(
    ("position", "changes"),
    [(None, {}), ([0.0, 0, -30], {"lines": {}}), ([0.0, 0, -30], {"lines": {}, "status": Status.NOT_SEEN})],
)
def test_nothing_to_say_is_said(position, changes):
    found = guidance(frame(position), estimate(**changes))
    assert found.height_above_deck_m is None
    assert found.lateral_deviation_m is None
    assert found.reason == "no line was localized"


def test_a_vertical_nose_has_no_heading():
    found = guidance(frame([-100.0, 4.0, -29.0], attitude(0, np.pi / 2, 0)), estimate())
    assert found.heading_error_rad is None
    assert found.lateral_deviation_m.value == pytest.approx(4.0)
    assert "nose points straight" in found.reason
