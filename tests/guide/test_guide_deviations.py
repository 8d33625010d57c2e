import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from deckline import guide
from deckline.config import Approach
from deckline.geometry import Camera, attitude
from deckline.trackers import YOUNG
from deckline.types import (
    DepthMode,
    Diagnostic,
    Frame,
    LineVisibility,
    Protection,
    Reason,
    RunwayEstimate,
    RunwayLine,
    Scale,
    Status,
    Track,
    TrackState,
    Value,
)

APPROACH = Approach()
CAMERA = Camera(4, 3, 2.0, 2.0, 1.5, 1.0)
ONE, NOTHING = Diagnostic(Reason.NO_CENTRE_LINE, "one line"), Diagnostic(Reason.NO_LINE, "no line")
NORTH = RunwayLine(np.array([0.0, 0.0, -20.0]), 0.0, np.diag([0.3, 0.01, 0.2]) ** 2)


def frame(position, rotation=None):
    pose = None if position is None else RigidTransform.from_components(position, rotation or Rotation.identity())
    return Frame("a.png", 2.5, np.zeros((3, 4, 3), dtype=np.uint8), CAMERA, world_from_body=pose)


def guidance(at, found, track=None, approach=APPROACH):
    return guide.guidance(at, found, track, approach)


def estimate(**changes):
    values = dict(seen=LineVisibility.BOTH, mode=DepthMode.FINE, pixel_lines={}, lines={"centre": NORTH})
    return RunwayEstimate(**values | changes)


HERE = frame([-100.0, 4.0, -29.0])


def test_signs_right_of_the_line_nose_right_above_and_before_the_ramp():
    body = frame([-100.0, 4.0, -29.0], attitude(0.1, -0.05, 0.02))
    found = guidance(body, estimate(ramp_m=np.array([-60.0, 0.0, -20.0]), ramp_sigma_m=1.5))
    assert found.lateral_deviation_m.value == pytest.approx(4.0)
    assert found.heading_error_rad.value == pytest.approx(0.02)
    assert found.height_above_deck_m.value == pytest.approx(9.0)
    assert found.distance_to_ramp_m.value == pytest.approx(40.0)
    assert found.distance_to_ramp_m.sigma == 1.5
    assert (found.time_s, found.status, found.mode) == (2.5, Status.UNVERIFIED, DepthMode.FINE)
    assert [diagnostic.reason for diagnostic in found.diagnostics] == [Reason.YOUNG_TRACK]  # no levels, so never ok


def test_sigmas_are_those_of_the_line_where_the_aircraft_is():
    found = guidance(HERE, estimate())
    assert found.distance_to_ramp_m is None
    assert found.lateral_deviation_m.sigma == pytest.approx(np.hypot(0.3, 100 * 0.01))
    assert found.heading_error_rad.sigma == pytest.approx(0.01)
    assert found.height_above_deck_m.sigma == pytest.approx(0.2)
    turned = np.outer([1.0, 0.01, 0.0], [1.0, 0.01, 0.0])  # an azimuth error that turns the line about the aircraft
    for relative, sigma_m in ((None, 0.0), (np.diag([0.04, 0.0, 0.0]), 0.2)):
        line = RunwayLine(NORTH.point_m, 0.0, turned, relative)
        found = guidance(HERE, estimate(lines={"centre": line}))
        assert found.lateral_deviation_m.sigma == pytest.approx(sigma_m, abs=1e-7)


@settings(deadline=None)
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
    found = guidance(HERE, estimate(seen=LineVisibility.ONE, lines={"left": NORTH}, diagnostics=(ONE,)))
    assert found.height_above_deck_m.value == pytest.approx(9.0)
    assert found.lateral_deviation_m is None
    assert found.heading_error_rad is None
    assert found.distance_to_ramp_m is None
    assert (found.status, found.diagnostics) == (Status.ONE_LINE, (ONE,))


@pytest.mark.parametrize(
    ("position", "changes"),
    [(None, {}), ([0.0, 0, -30], {"lines": {}}), ([0.0, 0, -30], {"lines": {}, "seen": LineVisibility.NONE})],
)
def test_a_frame_without_a_place_or_lines_is_not_localized(position, changes):
    found = guidance(frame(position), estimate(**changes))
    assert found.height_above_deck_m is None
    assert found.lateral_deviation_m is None
    assert [diagnostic.reason for diagnostic in found.diagnostics] == [Reason.NOT_LOCALIZED]


def test_a_vertical_nose_has_no_heading():
    found = guidance(frame([-100.0, 4.0, -29.0], attitude(0, np.pi / 2, 0)), estimate())
    assert found.heading_error_rad is None
    assert found.lateral_deviation_m.value == pytest.approx(4.0)
    assert [diagnostic.reason for diagnostic in found.diagnostics] == [Reason.YOUNG_TRACK, Reason.NO_HEADING]


ON_SLOPE_M = np.tan(np.deg2rad(3.5)) * (40.0 + 70.0)
RAMP = dict(ramp_m=np.array([-60.0, 0.0, -20.0]), ramp_sigma_m=1.5)


def track(state=TrackState.TRACKING, **changes):
    values = dict(lines={"centre": NORTH}, protection=Protection(2.0, 1.0, 0.02, None, 1e-7), age_s=5.0)
    return Track(2.5, state, **values | changes)


@pytest.mark.parametrize(("above", "right"), [(2.0, 3.0), (0.0, 0.0), (-2.0, -3.0)])
def test_above_and_right_are_positive_in_metres_and_as_angles_at_the_aim_point(above, right):
    found = guidance(frame([-100.0, right, -20.0 - ON_SLOPE_M - above]), estimate(**RAMP))
    assert found.distance_to_touchdown_m.value == pytest.approx(110.0)
    assert found.vertical_deviation_m.value == pytest.approx(above, abs=1e-9)
    assert found.lateral_deviation_rad.value == pytest.approx(np.arctan(right / 110.0))
    angle = np.arctan((ON_SLOPE_M + above) / 110.0) - np.deg2rad(3.5)
    assert found.vertical_deviation_rad.value == pytest.approx(angle, abs=1e-12)
    assert found.glideslope_rad == pytest.approx(np.deg2rad(3.5))


def test_sigmas_of_the_deviations_are_those_of_drawn_measurements():
    rng = np.random.default_rng(0)
    rows = []
    for _ in range(2000):
        line = RunwayLine(np.array([0.0, 0.0, rng.normal(-20.0, 0.2)]), 0.0, NORTH.covariance)
        ramp = np.array([-60.0 + rng.normal(0, 1.5), 0.0, -20.0])
        found = guidance(HERE, estimate(lines={"centre": line}, ramp_m=ramp, ramp_sigma_m=1.5))
        rows.append([found.vertical_deviation_m.value, found.vertical_deviation_rad.value])
    stated = [found.vertical_deviation_m.sigma, found.vertical_deviation_rad.sigma]
    np.testing.assert_allclose(np.std(rows, axis=0), stated, rtol=0.06)


def test_another_slope_aim_point_and_hook():
    approach = Approach(glideslope_deg=4.0, touchdown_m=50.0, point_m=(-2.0, 0.5, 3.0))
    found = guidance(frame([-100.0, 0.0, -29.0]), estimate(**RAMP), approach=approach)
    assert found.height_above_deck_m.value == pytest.approx(6.0)  # the hook hangs 3 m lower
    assert found.lateral_deviation_m.value == pytest.approx(0.5)
    assert found.distance_to_touchdown_m.value == pytest.approx(42.0 + 50.0)
    assert found.vertical_deviation_m.value == pytest.approx(6.0 - 92.0 * np.tan(np.deg2rad(4.0)))


@pytest.mark.parametrize(("x_m", "has_angles"), [(5.0, False), (0.5, False), (-0.5, True)])
def test_nearer_than_ten_metres_to_the_aim_point_there_are_no_angles(x_m, has_angles):
    found = guidance(frame([x_m, 0.0, -22.0]), estimate(**RAMP))
    assert found.vertical_deviation_m is not None
    assert (found.vertical_deviation_rad is not None, found.lateral_deviation_rad is not None) == (has_angles,) * 2


def test_the_track_goes_before_the_frame_and_brings_rates_bounds_and_state():
    ship = RunwayLine(np.array([0.0, 1.0, -21.0]), 0.0, NORTH.covariance)
    rates = dict(lateral_rate_m_s=Value(0.5, 0.1), height_rate_m_s=Value(-3.9, 0.2), closing_m_s=Value(60.0, 0.5))
    rates |= dict(deck_acceleration_m_s2=Value(0.7, 0.3))
    ramp = dict(ramp_m=np.array([-50.0, 1.0, -21.0]), ramp_sigma_m=0.5)
    found = guidance(HERE, estimate(**RAMP), track(lines={"centre": ship}, **ramp, **rates))
    assert found.lateral_deviation_m.value == pytest.approx(3.0)
    assert found.height_above_deck_m.value == pytest.approx(8.0)
    assert found.distance_to_ramp_m.value == pytest.approx(50.0)
    assert (found.height_rate_m_s.value, found.closing_m_s.value) == (-3.9, 60.0)
    assert found.deck_acceleration_m_s2.value == 0.7
    assert found.protection.lateral_m == 2.0
    assert found.track is TrackState.TRACKING


def test_a_lost_track_leaves_the_frame_unless_something_is_wrong():
    alone = guidance(HERE, estimate(), track(TrackState.LOST, lines={}, protection=None))
    assert alone.lateral_deviation_m.value == pytest.approx(4.0)
    assert (alone.track, alone.protection) == (TrackState.LOST, None)
    wrong = Diagnostic(Reason.SPACING, "the lines are 9 m apart")
    doubted = guidance(HERE, estimate(), track(TrackState.LOST, lines={}, protection=None, flags=(wrong,)))
    assert doubted.lateral_deviation_m is None
    assert doubted.flags == (wrong,)
    assert wrong in doubted.diagnostics


def test_a_coasting_track_guides_where_the_frame_shows_nothing():
    nothing = estimate(lines={}, seen=LineVisibility.NONE, diagnostics=(NOTHING,))
    found = guidance(HERE, nothing, track(TrackState.COASTING))
    assert found.lateral_deviation_m.value == pytest.approx(4.0)
    assert (found.status, found.track) == (Status.COASTING, TrackState.COASTING)
    assert found.diagnostics == (NOTHING,)


@pytest.mark.parametrize(
    ("of_frame", "of_track", "status"),
    [
        ({}, {}, Status.OK),
        ({"mode": DepthMode.COARSE}, {}, Status.UNVERIFIED),
        ({"mode": DepthMode.COARSE}, {"scale_sources": (Scale.WIDTH,)}, Status.OK),
        ({"mode": DepthMode.COARSE, "depth_confirms_height": True}, {}, Status.OK),
        ({}, {"doubts": (YOUNG,)}, Status.UNVERIFIED),
        ({}, {"state": TrackState.LOST, "lines": {}}, Status.UNVERIFIED),
        ({}, {"flags": (Diagnostic(Reason.HEIGHT, "off"),)}, Status.UNVERIFIED),
        ({}, {"flags": (Diagnostic(Reason.FROZEN, "same"),)}, Status.STALE),
        ({}, {"excluded": (Diagnostic(Reason.LEFT, "off"),)}, Status.ONE_LINE),
        ({"seen": LineVisibility.ONE}, {}, Status.ONE_LINE),
        ({"seen": LineVisibility.NONE}, {}, Status.COASTING),
        ({}, {"state": TrackState.COASTING}, Status.COASTING),
        ({"seen": LineVisibility.NONE, "lines": {}}, {"state": TrackState.LOST, "lines": {}}, Status.NOT_SEEN),
        ({"lines": {}, "mode": DepthMode.NONE}, {"state": TrackState.LOST, "lines": {}}, Status.UNVERIFIED),
    ],
)
def test_the_status_follows_frame_and_track(of_frame, of_track, status):
    assert guidance(HERE, estimate(**of_frame), track(**of_track)).status is status
