"""The horizon in the picture against the attitude of the pose."""

import threading
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from approach_scene import CAMERA, STILL, frame
from deckline.dehaze.base import IdentityDehazer
from deckline.flight import Flight
from deckline.geometry import attitude
from deckline.monitors.attitude import AttitudeMonitor, expect_horizon
from deckline.types import Detection, LinePoints, Reason
from dehaze.sea_scene import AIRLIGHT, WATER, ray_z
from monitors.lenses import LENSES, through_lens
from track.steady_view import NOTHING, numbers_in, reasons

EMPTY = Detection(LinePoints.empty(), LinePoints.empty())


def at_sea(index, roll_deg=0.0, pitch_deg=-4.0, pose_roll_deg=None, pose_pitch_deg=None):
    """A frame whose picture shows the sea as from this attitude, and whose pose has another one."""
    pose_roll_deg = roll_deg if pose_roll_deg is None else pose_roll_deg
    pose_pitch_deg = pitch_deg if pose_pitch_deg is None else pose_pitch_deg
    true = attitude(np.deg2rad(roll_deg), np.deg2rad(pitch_deg), 0.0)
    stated = attitude(np.deg2rad(pose_roll_deg), np.deg2rad(pose_pitch_deg), 0.0)
    plain = frame(index)
    down = ray_z(RigidTransform.from_rotation(true), CAMERA)[..., None]
    image = np.where(down > 0, WATER, AIRLIGHT) + np.random.default_rng(index).normal(0, 2, down.shape)
    body = RigidTransform.from_components(plain.world_from_body.translation, stated)
    return replace(
        plain, image_rgb=np.clip(image, 0, 255).astype(np.uint8), world_from_body=body, time_s=0.5 * index, sea_z_m=0.0
    )


@pytest.fixture
def monitor():
    monitor = AttitudeMonitor(0.5)
    yield monitor
    monitor.close()


def flags(monitor, shown, detection=EMPTY):
    """Whether each frame is flagged, and the last flags."""
    found = [monitor.update(one, NOTHING, detection) for one in shown]
    assert {flag.reason for flags in found for flag in flags} <= {Reason.ATTITUDE}
    return [bool(flags) for flags in found], found[-1]


def test_the_expected_horizon_follows_the_attitude():
    level = expect_horizon(at_sea(0, pitch_deg=0.0))
    assert level.roll_deg == pytest.approx(0.0, abs=1e-6) and level.row_px == pytest.approx(CAMERA.cy)
    assert expect_horizon(at_sea(0, pitch_deg=-4.0)).row_px < CAMERA.cy - 10
    high = replace(at_sea(0), sea_z_m=300.0 + at_sea(0).world_from_camera.translation[2])
    assert expect_horizon(high).dip_deg == pytest.approx(0.51, abs=0.01)
    assert expect_horizon(replace(high, sea_z_m=None)).dip_deg is None
    assert expect_horizon(replace(high, sea_z_m=np.nan)).dip_deg is None
    right_wing_down = expect_horizon(at_sea(0, roll_deg=6.0))  # so that the horizon rises to the right
    assert right_wing_down.roll_deg == pytest.approx(-6.0, abs=0.1)


@pytest.mark.parametrize(("roll_deg", "off_deg"), [(-8.0, 0.0), (0.0, -0.8), (5.0, 0.8)])
def test_an_attitude_that_is_true_or_nearly_so_is_never_flagged(monitor, roll_deg, off_deg):
    pitches = [-4.0 + 0.2 * k for k in range(8)]
    shown = [at_sea(k, roll_deg + 0.3 * k, pitch, pose_pitch_deg=pitch + off_deg) for k, pitch in enumerate(pitches)]
    assert not any(flags(monitor, shown)[0])


@pytest.mark.parametrize(("off_deg", "is_flagged"), [(1.4, False), (-1.4, True)])
def test_the_sea_dips_below_the_horizontal_from_high_up(monitor, off_deg, is_flagged):
    """From 2.3 km it does so by 1.4 degrees; the picture's horizon lies lower, or higher, by as much."""
    low = [at_sea(k, pose_pitch_deg=-4.0 - off_deg) for k in range(12)]
    high = [replace(one, sea_z_m=2300.0 + one.world_from_camera.translation[2]) for one in low]
    assert expect_horizon(high[0]).dip_deg == pytest.approx(1.4, abs=0.02)
    assert any(flags(monitor, high)[0]) is is_flagged


def test_hills_raise_the_horizon_of_a_land(monitor):
    on_land = [replace(at_sea(k, pose_pitch_deg=0.0), sea_z_m=None) for k in range(8)]
    assert not any(flags(monitor, on_land)[0])


@pytest.mark.parametrize(
    ("stated", "direction", "off_deg"),
    [
        ({"pose_roll_deg": -6.0}, "turned", pytest.approx(-6.5, abs=0.5)),
        ({"pose_roll_deg": 3.5}, "turned", pytest.approx(3.5, abs=0.5)),
        ({"pose_pitch_deg": -1.0}, "raised", pytest.approx(3.0, abs=1.0)),
        ({"pose_pitch_deg": -9.5}, "lowered", pytest.approx(5.0, abs=1.0)),
    ],
)
def test_a_wrong_attitude_is_flagged_until_it_is_right_again(monitor, stated, direction, off_deg):
    seen, last = flags(monitor, [at_sea(k, **stated) for k in range(6)])
    assert not seen[0] and seen[4]
    assert set(last[0].message.split()) & {"turned", "raised", "lowered"} == {direction}
    assert numbers_in(last[0].message) == [off_deg]
    assert not flags(monitor, [at_sea(k) for k in range(6, 14)])[0][-1]


def test_a_mirrored_picture_is_flagged_as_soon_as_the_aircraft_rolls(monitor):
    shown = [at_sea(k, (0.0, 0.5, 3.0, 3.0, 3.0, 3.0)[k]) for k in range(6)]
    mirrored = [replace(one, image_rgb=np.ascontiguousarray(one.image_rgb[:, ::-1])) for one in shown]
    seen, _ = flags(monitor, mirrored)
    assert not any(seen[:3]) and seen[-1]


def test_what_shows_no_horizon_changes_nothing(monitor):
    grey = replace(at_sea(0, pose_roll_deg=-6.0), image_rgb=np.full_like(at_sea(0).image_rgb, 120))
    for one in (grey, replace(grey, world_from_body=None), at_sea(0, 30.0), at_sea(0, pitch_deg=40.0)):
        monitor.reset()
        assert not any(flags(monitor, [replace(one, time_s=0.5 * k) for k in range(4)])[0])


@pytest.mark.parametrize("lens", LENSES)
def test_a_distorted_picture_is_checked_without_its_distortion(monitor, lens):
    """Rolled by 6 degrees against the pose, or as the pose says."""
    for pose_roll_deg, is_wrong in ((-6.0, True), (0.0, False)):
        monitor.reset()
        shown = [through_lens(at_sea(k, pose_roll_deg=pose_roll_deg), lens) for k in range(6)]
        assert flags(monitor, shown)[0][-1] is is_wrong


def test_given_points_and_a_rate_of_zero_search_no_horizon(monitor):
    wrong = [at_sea(k, pose_roll_deg=-6.0) for k in range(6)]
    assert not any(flags(monitor, wrong, detection=None)[0])
    assert not any(flags(AttitudeMonitor(0.0), wrong)[0])


@pytest.mark.parametrize("how", ["reset", "close"])
def test_another_flight_begins_without_a_flag(monitor, how):
    assert flags(monitor, [at_sea(k, pose_roll_deg=-6.0) for k in range(6)])[0][5]
    getattr(monitor, how)()
    assert not flags(monitor, [at_sea(0)])[0][0]


@pytest.mark.parametrize(("given", "expected"), [(None, [Reason.ATTITUDE]), (EMPTY, [])])
def test_a_flight_flags_it_where_it_searches_the_picture(given, expected):
    before = threading.active_count()
    with Flight(STILL, IdentityDehazer(), lambda image_rgb, prior_box=None: EMPTY) as flight:
        results = [flight(at_sea(2 * k, pose_roll_deg=-6.0), detection=given) for k in range(5)]
        assert reasons(results[-1].track.flags) == expected
        assert not flight(at_sea(3), detection=given).track.flags  # 2.5 s earlier: another flight
    assert threading.active_count() == before
