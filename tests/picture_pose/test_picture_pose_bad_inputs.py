"""Pictures of no approach to a runway, through the whole chain: no `ok` beyond a level, no metres without a width.

Detections are projected, horizons are put in their place; the letterboxed pictures are drawn and searched.
"""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from runway_picture import (
    CAMERA,
    FLIGHT,
    IN_WIDTHS,
    LEVEL,
    LEVEL_RUNWAY,
    RATE_HZ,
    Follower,
    Place,
    Runway,
    fly,
    frame_at,
    horizon_of,
    pose_of,
    reasons,
    seconds,
    see,
)
from scipy.ndimage import gaussian_filter1d

from deckline.dehaze import DEHAZERS
from deckline.flight import Flight
from deckline.geometry import Camera
from deckline.types import Detection, LinePoints, PoseSource, Reason, Status
from dehaze.sea_scene import draw_horizon
from runway_scene import off_camera

CONFIGS = pytest.mark.parametrize("config", [LEVEL, IN_WIDTHS], ids=["width", "no width"])
SILENT = {Status.UNVERIFIED, Status.NOT_SEEN, Status.COASTING, Status.ONE_LINE}


def picture_at(time_s):
    """A frame whose picture is like no other's."""
    frame = frame_at(time_s)
    grain = np.random.default_rng(round(100 * time_s)).integers(0, 256, (72, 128, 3), np.uint8)
    image = np.tile(grain, (10, 10, 1))
    image[0, 0] = frame.image_rgb[0, 0]
    return replace(frame, image_rgb=image)


@pytest.fixture
def run(monkeypatch):
    """Results of a flight through the chain for so many seconds.

    Of the place and the true camera by time, and a runway; `shown`: another place by time whose lines are detected.
    """

    def results(place, end_s, config=LEVEL, *, camera=lambda _: CAMERA, runway=LEVEL_RUNWAY, shown=None):
        rng, shown = np.random.default_rng(0), shown or place
        Follower(config, monkeypatch, lambda t: horizon_of(place(t), camera(t)))
        found = []
        with Flight(config, DEHAZERS["none"](), lambda picture, box: None) as flight:
            for t in seconds(0.0, end_s):
                found.append(flight(picture_at(t), detection=see(shown(t), runway, camera(t), rng=rng)))
        return found

    return results


def statuses(results):
    return Counter(result.guidance.status for result in results)


def assert_honest(results, true_place):
    """No frame is `ok` whose errors are beyond its protection levels."""
    for result in results:
        found, place = result.guidance, true_place(result.frame.time_s)
        if found.status is Status.OK:
            levels = found.protection
            assert abs(found.lateral_deviation_m.value - place.lateral_m) <= levels.lateral_m
            assert abs(found.height_above_deck_m.value - place.height_m) <= levels.vertical_m
            assert levels.heading_rad is None  # nothing shows a camera that is turned in yaw
            assert abs(found.distance_to_ramp_m.value - place.distance_m) <= levels.distance_m


def assert_no_metres(results):
    for result in results:
        found = result.guidance
        lengths = (found.lateral_deviation_m, found.height_above_deck_m, found.distance_to_ramp_m, found.protection)
        assert lengths == (None, None, None, None)
        assert (found.vertical_deviation_m, found.closing_m_s, found.height_rate_m_s) == (None, None, None)


@pytest.mark.parametrize("seed", range(2))
def test_a_nominal_flight_is_verified_and_stays_so(run, seed):
    results = run(fly(seed=seed), 4.0)
    assert_honest(results, fly(seed=seed))
    assert all(result.guidance.status is Status.OK for result in results[15:])


@pytest.mark.parametrize(
    "place",
    [
        Place(distance_m=50.0, lateral_m=0.0, height_m=0.1, roll=0.0, pitch=0.0, heading=0.0),  # on the ground
        Place(distance_m=-50.0, lateral_m=-60.0, height_m=15.0, roll=0.0, pitch=0.0, heading=1.5),  # from beside
    ],
    ids=["ground", "beside"],
)
@CONFIGS
def test_a_camera_on_the_ground_or_beside_gives_no_pose(run, place, config):
    results = run(lambda _: place, 1.0, config)
    assert set(statuses(results)) <= {Status.UNVERIFIED, Status.NOT_SEEN}
    assert all(result.frame.world_from_body is None and result.guidance.in_widths is None for result in results)
    assert_no_metres(results)


def drive(time_s):
    """A car in the middle of a lane, 15 m/s."""
    return Place(-5.0 - 15.0 * time_s, 0.0, 1.5, 0.0, 0.0, 0.01)


@CONFIGS
def test_a_road_is_never_verified(run, config):
    results = run(drive, 3.0, config, runway=Runway(3.5, length_m=400.0))
    assert set(statuses(results)) == {Status.UNVERIFIED}
    assert Reason.NO_RAMP in reasons(results[-1].track.doubts)
    if config is IN_WIDTHS:
        assert_no_metres(results)
        assert results[-1].guidance.in_widths.height_above_deck.value == pytest.approx(1.5 / 3.5, abs=0.08)  # the arm


@pytest.mark.parametrize("share", [2, 3])
def test_two_runways_in_turn_are_never_verified(run, share):
    def shown(time_s):
        place = FLIGHT(time_s)
        other = replace(place, heading=place.heading - 0.15, lateral_m=place.lateral_m + 20.0)
        return other if round(10 * time_s) % share else place

    results = run(FLIGHT, 4.0, shown=shown)
    assert set(statuses(results)) <= SILENT
    assert Reason.OTHER_LINES in reasons(results[-1].track.doubts)


@pytest.mark.parametrize("times", [1.5, 2.0, 0.67])
def test_a_zoom_in_flight_is_flagged_from_then_on(run, times):
    """The focal length becomes so many times longer from 2 to 3 s on."""
    results = run(FLIGHT, 5.0, camera=lambda t: off_camera(CAMERA, (times - 1) * float(np.clip(t - 2.0, 0.0, 1.0))))
    assert_honest(results, FLIGHT)
    assert results[19].guidance.status is Status.OK
    assert all(result.guidance.status in SILENT for result in results[30:])


@pytest.mark.parametrize("seed", range(2))
def test_a_stabilised_video_is_never_verified_beyond_its_levels(run, seed):
    """Its picture is shifted by 2 % of its width from frame to frame, smoothly."""
    shift = gaussian_filter1d(np.random.default_rng(seed).normal(size=(2, 60)), 3, axis=1)
    shift *= 0.02 * CAMERA.width / np.abs(np.diff(shift, axis=1)).mean()

    results = run(FLIGHT, 5.0, camera=lambda t: off_camera(CAMERA, 0.0, *shift[:, round(10 * t)]))
    assert_honest(results, FLIGHT)
    assert all(result.guidance.status in SILENT for result in results[10:])


def test_after_a_jump_cut_the_new_view_is_measured(run):
    def place(time_s):
        return FLIGHT(time_s) if time_s < 2.0 else fly(180.0, seed=3)(time_s - 1.5)

    results = run(place, 5.0)
    assert_honest(results, place)
    assert all(result.guidance.status in SILENT for result in results[20:25])


SMALL = Camera.from_fov(640, 360, np.deg2rad(60))
BAR = 44  # rows of black above and below: 2.35 to 1 in 16 to 9


@pytest.mark.parametrize("bar", [0, BAR])
def test_a_letterboxed_video_is_verified_only_within_its_levels(bar):
    rng = np.random.default_rng(0)
    with Flight(LEVEL, DEHAZERS["none"](), lambda picture, box: None) as flight:
        results = []
        for time_s in seconds(0.0, 3.0):
            place = FLIGHT(time_s)
            horizon = horizon_of(place, SMALL)
            sea = draw_horizon((640, 360), horizon.middle_px, horizon.slope, 0.01, round(100 * time_s), 0.7)
            sea[:bar] = sea[360 - bar :] = 0
            frame = replace(frame_at(time_s), camera=SMALL, image_rgb=sea)
            seen = see(place, camera=SMALL, rng=rng)
            results.append(flight(frame, detection=Detection(*(above(line, bar) for line in (seen.left, seen.right)))))
    assert_honest(results, FLIGHT)
    assert (Status.OK in statuses(results)) == (bar == 0)
    assert bar == 0 or reasons(results[-1].track.doubts) == [Reason.NO_HORIZON]  # the bar's edge is taken for none


def above(points, bar):
    """Points that no bar hides."""
    shown = points.points_px[:, 1] < SMALL.height - bar
    return LinePoints(points.points_px[shown], points.confidence[shown], points.sigma_px[shown])


def test_the_picture_answers_once_the_poses_have_stopped():
    """Without a break, and the world is then the runway's."""
    sources = []
    with Flight(LEVEL, DEHAZERS["none"](), lambda picture, box: None) as flight:
        for time_s in seconds(0.0, 4.0):
            place = FLIGHT(time_s)
            frame = replace(picture_at(time_s), deck_z_m=0.0)
            posed = replace(frame, world_from_body=pose_of(place)) if time_s < 1.0 else frame
            sources.append(flight(posed, detection=see(place)).guidance.pose_source)
    posed = round(1.0 * RATE_HZ)
    assert set(sources[:posed]) == {PoseSource.NAVIGATION}
    assert set(sources[posed:]) == {PoseSource.PICTURE}
