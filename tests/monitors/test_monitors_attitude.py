"""The horizon in the picture against the attitude of the pose."""

import re
from dataclasses import replace

import numpy as np
import pytest
from deckline.attitude import AttitudeCheck, expect_horizon
from scipy.spatial.transform import RigidTransform

from approach_scene import CAMERA, STILL, frame
from deckline.dehaze.base import IdentityDehazer
from deckline.flight import Flight
from deckline.geometry import attitude
from deckline.types import Detection, LinePoints, Reason


def at_sea(index, roll_deg=0.0, pitch_deg=-4.0, told_roll_deg=None, told_pitch_deg=None):
    """A frame whose picture shows the sea as from this attitude, and whose pose tells another one."""
    told_roll_deg = roll_deg if told_roll_deg is None else told_roll_deg
    told_pitch_deg = pitch_deg if told_pitch_deg is None else told_pitch_deg
    true = attitude(np.deg2rad(roll_deg), np.deg2rad(pitch_deg), 0.0)
    said = attitude(np.deg2rad(told_roll_deg), np.deg2rad(told_pitch_deg), 0.0)
    plain = frame(index)
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    rays = CAMERA.rays(np.column_stack([u.ravel(), v.ravel()]))
    pose = RigidTransform.from_components(plain.world_from_body.translation, true)
    down = (pose * plain.body_from_camera).rotation.apply(rays)[:, 2].reshape(v.shape)
    image = np.where(down[..., None] > 0, (45.0, 60.0, 70.0), (150.0, 165.0, 180.0))
    image += np.random.default_rng(index).normal(0, 2, (*v.shape, 1))
    body = RigidTransform.from_components(pose.translation, said)
    return replace(
        plain, image_rgb=np.clip(image, 0, 255).astype(np.uint8), world_from_body=body, time_s=0.5 * index, sea_z_m=0.0
    )


def flags(shown, every_s=0.5):
    check, seen = AttitudeCheck(every_s), []
    for one in shown:
        check(one)
        seen.append(check.flag and check.flag.reason)
    return seen, check.flag


def test_the_attitude_tells_how_the_horizon_is_turned():
    level = expect_horizon(at_sea(0, pitch_deg=0.0))
    assert level.roll_deg == pytest.approx(0.0, abs=1e-6) and level.row_px == pytest.approx(CAMERA.cy)
    assert expect_horizon(at_sea(0, pitch_deg=-4.0)).row_px < CAMERA.cy - 10
    high = replace(at_sea(0), sea_z_m=300.0 + at_sea(0).world_from_camera.translation[2])
    assert expect_horizon(high).dip_deg == pytest.approx(0.51, abs=0.01)
    assert expect_horizon(replace(high, sea_z_m=None)).dip_deg is None
    assert expect_horizon(replace(high, sea_z_m=np.nan)).dip_deg is None
    right_wing_down = expect_horizon(at_sea(0, roll_deg=6.0))  # so that the horizon rises to the right
    assert right_wing_down.roll_deg == pytest.approx(-6.0, abs=0.1)


@pytest.mark.parametrize("roll_deg", [-8.0, 0.0, 5.0])
def test_a_true_attitude_is_never_flagged(roll_deg):
    seen, _ = flags([at_sea(k, roll_deg + 0.3 * k, -4.0 + 0.2 * k) for k in range(8)])
    assert seen == [None] * 8


@pytest.mark.parametrize("off_deg", [-0.8, 0.8])
def test_the_horizon_may_be_a_little_too_low_or_too_high(off_deg):
    assert flags([at_sea(k, told_pitch_deg=-4.0 + off_deg) for k in range(8)])[0] == [None] * 8


@pytest.mark.parametrize(("off_deg", "is_flagged"), [(1.4, False), (-1.4, True)])
def test_the_sea_dips_below_the_horizontal_from_high_up(off_deg, is_flagged):
    """From 2.3 km it does so by 1.4 degrees; the picture's horizon lies lower, or higher, by as much."""
    low = [at_sea(k, told_pitch_deg=-4.0 - off_deg) for k in range(12)]
    high = [replace(one, sea_z_m=2300.0 + one.world_from_camera.translation[2]) for one in low]
    assert expect_horizon(high[0]).dip_deg == pytest.approx(1.4, abs=0.02)
    assert any(flags(high)[0]) is is_flagged


def test_hills_raise_the_horizon_of_a_land():
    on_land = [replace(at_sea(k, told_pitch_deg=0.0), sea_z_m=None) for k in range(8)]
    assert flags(on_land)[0] == [None] * 8


@pytest.mark.parametrize(
    ("told", "words"),
    [
        ({"told_roll_deg": -6.0}, r"turned by [-+]6\.\d"),
        ({"told_roll_deg": 3.5}, r"turned by \+3\.\d"),
        ({"told_pitch_deg": -1.0}, r"raised by [23]\.\d"),
        ({"told_pitch_deg": -9.5}, r"lowered by [45]\.\d"),
    ],
)
def test_a_wrong_attitude_is_flagged_until_it_is_right_again(told, words):
    wrong = [at_sea(k, **told) for k in range(6)]
    seen, flag = flags(wrong)
    assert seen[0] is None and seen[4] is Reason.ATTITUDE
    assert re.search(words, flag.message), flag.message
    again, _ = flags([*wrong, *(at_sea(k) for k in range(6, 14))])
    assert again[-1] is None


def test_a_mirrored_picture_is_flagged_as_soon_as_the_aircraft_rolls():
    shown = [at_sea(k, (0.0, 0.5, 3.0, 3.0, 3.0, 3.0)[k]) for k in range(6)]
    seen, _ = flags([replace(one, image_rgb=np.ascontiguousarray(one.image_rgb[:, ::-1])) for one in shown])
    assert seen[:3] == [None] * 3 and seen[-1] is Reason.ATTITUDE


def test_what_shows_no_horizon_changes_nothing():
    grey = replace(at_sea(0, told_roll_deg=-6.0), image_rgb=np.full_like(at_sea(0).image_rgb, 120))
    for one in (grey, replace(grey, world_from_body=None), at_sea(0, 30.0), at_sea(0, pitch_deg=40.0)):
        assert flags([replace(one, time_s=0.5 * k) for k in range(4)])[0] == [None] * 4
    bent = replace(at_sea(0, told_roll_deg=-6.0), camera=replace(CAMERA, distortion=(0.1, 0, 0, 0, 0)))
    assert expect_horizon(bent) is None
    assert flags([at_sea(k, told_roll_deg=-6.0) for k in range(4)], every_s=0.0)[0] == [None] * 4


def test_another_flight_begins_without_a_flag():
    wrong = [at_sea(k, told_roll_deg=-6.0) for k in range(6)]
    seen, _ = flags([*wrong, at_sea(0)])
    assert seen[5] is Reason.ATTITUDE and seen[6] is None


def test_a_flight_flags_it_and_one_with_told_points_does_not_look():
    def detector(image_rgb, prior_box=None):
        return Detection(LinePoints.empty(), LinePoints.empty())

    flight = Flight(STILL, IdentityDehazer(), detector)
    results = [flight(at_sea(2 * k, told_roll_deg=-6.0)) for k in range(5)]
    assert [flag.reason for flag in results[-1].track.flags] == [Reason.ATTITUDE]
    told = Flight(STILL, IdentityDehazer(), detector)
    results = [told(at_sea(2 * k, told_roll_deg=-6.0), detection=detector(None)) for k in range(5)]
    assert not results[-1].track.flags
