import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.geometry import Camera, attitude
from deckline.truth import state_error, touchdown, true_centre
from deckline.types import Frame, RunwayLine, Segment, Truth
from deckline_lab.evaluation.localization_score import frame_figures, line_figures, unit_figures
from deckline_lab.evaluation.pilot_errors import move_with_pose, pilot_figures

LEFT = Segment(np.array([0.0, 35.788523, 6.08]), np.array([-200.0, 35.788523 + 0.163 * 200, 6.08]))
RIGHT = Segment(np.array([0.0, 20.889669, 6.08]), np.array([-200.0, 20.889669 + 0.15632 * 200, 6.08]))
TOUCHDOWN_M = 70.0  # past the ramp
CAMERA = Camera.from_fov(64, 36, np.pi / 2)
COVARIANCE = np.diag([0.2**2, np.deg2rad(0.1) ** 2, 0.3**2])


def line(truth: Segment, right_m=0.0, turn_rad=0.0, down_m=0.0, at_m=50.0) -> RunwayLine:
    """A true line, at a point so far past its ramp end, moved and turned about that point."""
    along = (truth.p1_m - truth.p0_m) / np.linalg.norm(truth.p1_m - truth.p0_m)
    right = np.array([-along[1], along[0], 0.0])
    azimuth = float(np.arctan2(along[1], along[0])) + turn_rad
    return RunwayLine(truth.p0_m + at_m * along + right_m * right + [0, 0, down_m], azimuth, COVARIANCE)


def frame(true_body: RigidTransform, measured_body: RigidTransform | None = None) -> Frame:
    return Frame(
        "a.png",
        0.0,
        np.zeros((36, 64, 3), np.uint8),
        CAMERA,
        world_from_body=true_body if measured_body is None else measured_body,
        truth=Truth(LEFT, RIGHT, visibility_m=800.0, world_from_body=true_body),
    )


BODY = RigidTransform.from_components([300.0, -20.0, -30.0], attitude(0.05, -0.06, np.pi - 0.15))


def test_the_paper_s_figures_of_its_own_line():
    """Slope -0.163 and intercept 35.788523 of 0.16300 x + y - 35.788523 = 0; a line 0.15 steeper is 8.4 degrees off."""
    exact = line_figures(line(LEFT), LEFT, "left")
    assert (exact["slope.left"], exact["intercept_m.left"]) == pytest.approx((-0.163, 35.788523))
    assert exact["height_m.left"] == pytest.approx(6.08)
    assert exact["direction_error_deg.left"] == pytest.approx(0.0, abs=1e-9)
    steeper = np.arctan(0.163 + 0.15) - np.arctan(0.163)
    wrong = line_figures(line(LEFT, turn_rad=-steeper, at_m=0.0), LEFT, "left")
    assert wrong["slope_error.left"] == pytest.approx(0.15)
    assert wrong["intercept_error_m.left"] == pytest.approx(0.0, abs=1e-9)
    assert wrong["direction_error_deg.left"] == pytest.approx(np.rad2deg(steeper))


def test_state_errors_ignore_the_direction_of_travel_and_follow_a_tilted_deck():
    backwards = dataclasses.replace(line(RIGHT), azimuth_rad=line(RIGHT).azimuth_rad - np.pi + 0.02)
    assert state_error(backwards, RIGHT)[1] == pytest.approx(0.02)
    tilted = dataclasses.replace(LEFT, p1_m=np.add(LEFT.p1_m, [0.0, 0.0, 2.0]))
    assert state_error(line(tilted, at_m=100.0), tilted)[2] == pytest.approx(0.0, abs=1e-9)


def test_normalised_errors_follow_the_covariance():
    figures = line_figures(line(LEFT, 0.2, np.deg2rad(0.2), 0.9), LEFT, "left")
    ratios = [figures[f"ratio.{name}.left"] for name in ("offset", "azimuth", "height")]
    np.testing.assert_allclose(ratios, [1.0, 2.0, 3.0], rtol=1e-9)
    assert figures["normalised.left"] == pytest.approx(14.0)
    unknown = dataclasses.replace(line(LEFT, 0.2), covariance=np.zeros((3, 3)))
    assert "normalised.left" not in line_figures(unknown, LEFT, "left")


def test_a_pilot_s_errors_are_at_the_touchdown_point():
    centre = true_centre(Truth(LEFT, RIGHT))
    assert np.linalg.norm(touchdown(centre, TOUCHDOWN_M) - centre.p0_m) == pytest.approx(TOUCHDOWN_M)
    turned = pilot_figures(frame(BODY), line(centre, turn_rad=0.01, down_m=0.25, at_m=20.0), TOUCHDOWN_M)
    assert turned["lateral_m"] == pytest.approx(50.0 * np.tan(0.01))
    assert turned["heading_deg"] == pytest.approx(np.rad2deg(0.01))
    assert turned["height_m"] == pytest.approx(0.25)
    ahead = (BODY.translation - centre.p0_m) @ (centre.p1_m - centre.p0_m) / np.linalg.norm(centre.p1_m - centre.p0_m)
    assert turned["deviation_m"] == pytest.approx((ahead - 20.0) * np.tan(0.01))
    assert turned["deviation_sigma_m"] == pytest.approx(np.hypot(0.2, (ahead - 20.0) * np.deg2rad(0.1)), rel=1e-3)
    assert turned["lateral_sigma_m"] == pytest.approx(np.hypot(0.2, 50.0 * np.deg2rad(0.1)), rel=1e-4)
    relative = dataclasses.replace(line(centre, at_m=TOUCHDOWN_M), relative_covariance=COVARIANCE / 4)
    assert pilot_figures(frame(BODY), relative, TOUCHDOWN_M)["lateral_sigma_m"] == pytest.approx(0.1)


@given(st.tuples(*[st.floats(-5, 5)] * 3), st.floats(-0.2, 0.2))
def test_an_aircraft_wrong_about_itself_sees_the_runway_where_it_is(shift, turn):
    """Whatever moves the aircraft's pose moves a line measured from it as well: nothing is left for the pilot."""
    rotation = Rotation.from_rotvec([0.0, 0.0, turn])
    measured = RigidTransform.from_components(BODY.translation + shift, rotation * BODY.rotation)
    true = line(true_centre(Truth(LEFT, RIGHT)))
    seen = RunwayLine(
        rotation.apply(true.point_m - BODY.translation) + measured.translation, true.azimuth_rad + turn, COVARIANCE
    )
    figures = pilot_figures(frame(BODY, measured), seen, TOUCHDOWN_M)
    assert max(abs(figures[name]) for name in ("lateral_m", "height_m", "heading_deg")) < 1e-9
    np.testing.assert_allclose(move_with_pose(seen, measured, BODY).point_m, true.point_m, atol=1e-9)


def test_a_navigation_unit_alone_moves_lines_by_its_own_errors():
    """Turned about the aircraft, a ramp 300 m ahead moves by the turn times the way to it, abreast of the line."""
    turn, shift = np.deg2rad(0.05), np.array([3.0, 0.4, 2.0])
    rotation = Rotation.from_rotvec([0.0, 0.0, turn])
    measured = RigidTransform.from_components(BODY.translation + shift, rotation * BODY.rotation)
    figures = unit_figures(frame(BODY, measured))
    for side, segment in (("left", LEFT), ("right", RIGHT)):
        along = segment.p1_m - segment.p0_m
        right = np.array([-along[1], along[0], 0.0]) / np.linalg.norm(along)
        ahead = float((segment.p0_m - BODY.translation) @ along) / np.linalg.norm(along)
        expected = abs(shift @ right + ahead * turn)
        assert figures[f"unit.direction_error_deg.{side}"] == pytest.approx(0.05, rel=1e-6)
        assert figures[f"unit.lateral_error_m.{side}"] == pytest.approx(expected, abs=0.01)
        # A line that is moved by some lateral at x = 0, its ramp end, meets x = 0 farther off by 1 / cos.
        cosine = abs(along[0]) / np.linalg.norm(along)
        assert figures[f"unit.intercept_error_m.{side}"] == pytest.approx(expected / cosine, abs=0.01)
    assert max(unit_figures(frame(BODY)).values()) < 1e-9
    assert unit_figures(dataclasses.replace(frame(BODY), world_from_body=None)) == {}


def test_all_figures_of_a_frame():
    truth = true_centre(Truth(LEFT, RIGHT))
    figures = frame_figures(frame(BODY), {"left": line(LEFT), "centre": line(truth, 0.3)}, TOUCHDOWN_M)
    assert figures["centre.lateral_m"] == pytest.approx(0.3)
    assert "slope.left" in figures
    known = {"true_slope", "true_intercept_m", "true_height_m"}
    known |= {"unit.lateral_error_m", "unit.direction_error_deg", "unit.intercept_error_m"}
    assert {name for name in figures if name.endswith(".right")} == {f"{name}.right" for name in known}
    assert figures["true_slope.right"] == pytest.approx(-0.15632)


def test_frames_that_cannot_be_compared_are_refused():
    blind = dataclasses.replace(frame(BODY), truth=None)
    with pytest.raises(ValueError, match=r"a\.png"):
        frame_figures(blind, {}, TOUCHDOWN_M)
    with pytest.raises(ValueError, match=r"a\.png"):
        pilot_figures(dataclasses.replace(frame(BODY), world_from_body=None), line(LEFT), TOUCHDOWN_M)
