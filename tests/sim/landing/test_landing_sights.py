"""Ways to see: exact models give the truth back, the same seed gives the same answers."""

from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from deckline.config import Tracking
from deckline.geometry import attitude
from deckline.truth import true_guidance
from deckline.types import Guidance, PoseSource, Status
from deckline_sim.flight.viewpoints import deck_rise, runway_point, steady_pose
from deckline_sim.landing.config import LandingConfig
from deckline_sim.landing.detection_model import DEPTHS, RANGE_M, DetectionModel, read_detection_model
from deckline_sim.landing.deviations import deviations
from deckline_sim.landing.guidance_model import QUANTITIES, GuidanceModel, read_guidance_model
from deckline_sim.landing.guidance_sight import GuidanceSight
from deckline_sim.landing.navigation_sight import NavigationSight
from deckline_sim.landing.point_sight import PointSight
from deckline_sim.landing.rendered_sight import RenderedSight
from deckline_sim.landing.sight import Moment
from deckline_sim.landing.surroundings import (
    DATALINK_HEADING_SIGMA_DEG,
    DATALINK_SIGMA_M,
    Surroundings,
    datalink_prior,
    empty_picture,
    measured_frame,
    surroundings,
)

EXACT = LandingConfig(navigation="exact", visibility_m=1000.0, start_m=600.0)
SPEED_M_S = 55.0  # over the deck


def moment_at(scene: Surroundings, time_s: float, range_m: float = 400.0) -> Moment:
    """On the glideslope of the steady ship, 2 m right of the centre line, nose 4 degrees up and 1 to the right."""
    layout = scene.deck.layout.at_pose(steady_pose(scene.deck.layout, scene.deck.motion, time_s))
    along = range_m - SPEED_M_S * time_s
    place = runway_point(layout, -along, 2.0, (along + 70.0) * np.tan(np.deg2rad(3.5)))
    ramp, far = runway_point(layout, 0.0), runway_point(layout, 100.0)
    yaw = np.arctan2(far[1] - ramp[1], far[0] - ramp[0]) + np.deg2rad(1.0)
    body = RigidTransform.from_components(place, attitude(0.01, np.deg2rad(4.0), yaw))
    forward = (far - ramp) / 100.0
    velocity = SPEED_M_S * forward + scene.deck.layout.world_from_ship.rotation.apply(
        [scene.deck.motion.speed_m_s, 0.0, 0.0]
    )
    sink = np.array([0.0, 0.0, SPEED_M_S * np.tan(np.deg2rad(3.5))])
    return Moment(time_s, body, velocity + sink, np.zeros(3))


def truth_at(scene: Surroundings, moment: Moment) -> Guidance:
    truth = true_guidance(measured_frame(scene, moment, empty_picture(scene.camera)), scene.run.approach)
    assert truth is not None
    return truth


def numbers(found: Guidance) -> tuple[float, float, float, float]:
    parts = (
        found.lateral_deviation_m,
        found.height_above_deck_m,
        found.heading_error_rad,
        found.distance_to_ramp_m,
    )
    assert all(part is not None for part in parts)
    return tuple(part.value for part in parts if part is not None)  # type: ignore[return-value]


def exact_detector() -> DetectionModel:
    """Everything in view is found without error."""
    model, none = read_detection_model(), (0.0,) * len(RANGE_M)
    errors = replace(
        model.errors,
        log_sigma=(-2.0,) * len(RANGE_M),
        log_sigma_depth=(0.0,) * len(DEPTHS),
        log_sigma_spread=0.0,
        offset=none,
        slope=none,
        slope_outward=none,
        white=none,
    )
    extent = replace(
        model.extent, near_steps=none, near_steps_spread=none, far=(0.0,) * len(DEPTHS), points=(40.0,) * len(DEPTHS)
    )
    presence = replace(model.presence, intercept=100.0, per_visibility=0.0)
    return replace(model, errors=errors, extent=extent, presence=presence)


@pytest.mark.parametrize("sea_state", [0.0, 5.0])
def test_deviations_are_those_of_true_guidance(sea_state: float) -> None:
    scene = surroundings(replace(EXACT, sea_state=sea_state), 3)
    for time_s in (0.0, 2.5, 6.0):
        moment = moment_at(scene, time_s)
        found = deviations(scene, time_s, moment.world_from_body, moment.velocity_m_s)
        plain = (found.lateral_m, found.height_m, found.heading_rad, found.distance_m)
        np.testing.assert_allclose(plain, numbers(truth_at(scene, moment)), atol=1e-3)


@pytest.mark.parametrize(("sea_state", "swing_m_s"), [(0.0, 1e-3), (5.0, 0.2)])
def test_rates_are_the_differences_of_deviations(sea_state: float, swing_m_s: float) -> None:
    scene, step_s = surroundings(replace(EXACT, sea_state=sea_state), 3), 1e-3
    before, now, after = (
        deviations(scene, t, m.world_from_body, m.velocity_m_s)
        for t in (3.0 - step_s, 3.0, 3.0 + step_s)
        for m in [moment_at(scene, t)]
    )
    assert now.height_rate_m_s == pytest.approx((after.height_m - before.height_m) / (2 * step_s), abs=0.01)
    assert now.closing_m_s == pytest.approx((before.distance_m - after.distance_m) / (2 * step_s), abs=swing_m_s)
    assert now.lateral_rate_m_s == pytest.approx((after.lateral_m - before.lateral_m) / (2 * step_s), abs=swing_m_s)


def test_exact_points_give_the_truth() -> None:
    config = replace(EXACT, sea_state=0.0)
    with closing(PointSight(config, 5, exact_detector())) as sight:
        for time_s in np.arange(0.0, 4.0, 0.1):
            moment = moment_at(sight.surroundings, float(time_s))
            found = sight.see(moment)
    truth = numbers(truth_at(sight.surroundings, moment))
    assert found.status is Status.OK
    np.testing.assert_allclose(numbers(found)[:2], truth[:2], atol=0.01)


def test_points_repeat_with_their_seed() -> None:
    def fly(seed: int) -> list[tuple[float, ...]]:
        with closing(PointSight(replace(EXACT, navigation="good"), seed)) as sight:
            moments = [moment_at(sight.surroundings, t) for t in (0.0, 0.1, 0.2, 0.3)]
            return [numbers(sight.see(moment)) for moment in moments]

    assert fly(5) == fly(5)
    assert fly(5) != fly(6)


def test_points_are_tracked_as_the_configuration_says() -> None:
    told = Tracking(coast_s=0.5, gate_sigma=3.0)
    with closing(PointSight(replace(EXACT, tracking=told), 5)) as sight:
        assert sight.flight.config.tracking == replace(told, horizon_s=0.0, paint_s=0.0)
    with closing(PointSight(replace(EXACT, tracking=Tracking(enabled=False)), 5, exact_detector())) as sight:
        assert sight.see(moment_at(sight.surroundings, 0.0)).track is None


def test_points_are_not_seen_through_thick_haze() -> None:
    with closing(PointSight(replace(EXACT, visibility_m=100.0), 5)) as sight:
        assert sight.see(moment_at(sight.surroundings, 0.0)).status is Status.NOT_SEEN


def test_picture_alone_has_no_pose() -> None:
    config = replace(EXACT, guidance="picture", sea_state=0.0, navigation="good")
    with closing(PointSight(config, 5, exact_detector())) as sight:
        found = [sight.see(moment_at(sight.surroundings, t)) for t in np.arange(0.0, 3.0, 0.1)][-1]
    assert found.pose_source is PoseSource.PICTURE
    assert sight.result is not None
    assert numbers(found)[0] == pytest.approx(2.0, abs=0.3)


def exact_guidance() -> GuidanceModel:
    model = read_guidance_model()
    always_ok = np.zeros_like(model.transitions)
    always_ok[..., 2:] = 1.0
    return replace(model, errors=np.zeros_like(model.errors), transitions=always_ok)


def test_exact_guidance_is_the_truth() -> None:
    sight = GuidanceSight(EXACT, 5, exact_guidance())
    moment = moment_at(sight.surroundings, 1.0)
    found = sight.see(moment)
    assert found.status is Status.OK
    np.testing.assert_allclose(numbers(found), numbers(truth_at(sight.surroundings, moment)), atol=1e-3)


def test_guidance_repeats_with_its_seed_and_is_not_seen_far_off() -> None:
    def fly(seed: int) -> list[tuple[float, ...]]:
        sight = GuidanceSight(replace(EXACT, navigation="good"), seed)
        found = [sight.see(moment_at(sight.surroundings, 0.1 * k)) for k in range(60)]
        return [numbers(answer) for answer in found if answer.status is Status.OK]

    assert fly(5) == fly(5) != []
    assert fly(5) != fly(6)
    far = GuidanceSight(replace(EXACT, visibility_m=300.0), 5)
    answers = [far.see(moment_at(far.surroundings, 0.1 * k, 900.0)).status for k in range(20)]
    assert answers.count(Status.NOT_SEEN) > 15


def test_guidance_errors_have_the_spread_of_their_table() -> None:
    model = exact_guidance()
    errors = np.zeros_like(model.errors) + 0.5 * np.array([-2.576, -1.645, -0.674, 0.0, 0.674, 1.645, 2.576])
    model = replace(model, errors=errors, mixing=np.eye(len(QUANTITIES)), correlation_s=np.full(len(QUANTITIES), 0.01))
    sight = GuidanceSight(EXACT, 5, model)
    moments = [replace(moment_at(sight.surroundings, 0.0), time_s=0.1 * k) for k in range(400)]
    found = [sight.see(moment) for moment in moments]
    shares = [numbers(answer)[2] / answer.protection.heading_rad for answer in found]
    assert np.std(shares) == pytest.approx(0.5, rel=0.1)


def test_no_ok_answer_is_beyond_its_levels() -> None:
    """Errors are shares of the levels: where one is large, so is the other."""
    config, worst = replace(EXACT, navigation="good", sea_state=4.0), 0.0
    for seed in range(40):
        sight = GuidanceSight(config, seed)
        for k in range(60):
            moment = moment_at(sight.surroundings, 0.1 * k)
            found, true = sight.see(moment), truth_at(sight.surroundings, moment)
            if found.status is Status.OK:
                off = np.abs(np.array(numbers(found)) - numbers(true))[:2]
                worst = max(worst, *(off / (found.protection.lateral_m, found.protection.vertical_m)))
    assert 0.05 < worst < 0.7


def test_guidance_tables_have_their_shape() -> None:
    with pytest.raises(ValueError, match=r"levels.*\(3, 2\)"):
        replace(read_guidance_model(), levels=np.zeros((3, 2)))


def test_detection_tables_have_their_length() -> None:
    model = read_detection_model()
    with pytest.raises(ValueError, match=r"offset.*6.*2"):
        replace(model, errors=replace(model.errors, offset=(0.1, 0.2)))


def test_navigation_alone_lacks_the_deck_motion() -> None:
    sight = NavigationSight(replace(EXACT, sea_state=5.0), 5)
    scene, moment = sight.surroundings, moment_at(surroundings(replace(EXACT, sea_state=5.0), 5), 2.0)
    found = sight.see(moment)
    ramp, far = scene.deck.layout.centre_m
    touchdown = ramp + scene.deck.touchdown_m * (far - ramp) / np.linalg.norm(far - ramp)
    rise_m = deck_rise(scene.deck.layout, scene.deck.motion, 2.0, touchdown)
    assert found.status is Status.OK
    assert numbers(found)[1] - numbers(truth_at(scene, moment))[1] == pytest.approx(rise_m, abs=0.01)


def test_navigation_repeats_with_its_seed() -> None:
    config = replace(EXACT, navigation="tactical")
    first, again, other = (
        numbers(sight.see(moment_at(sight.surroundings, 1.0)))
        for sight in (NavigationSight(config, 5), NavigationSight(config, 5), NavigationSight(config, 6))
    )
    assert first == again
    assert abs(first[0] - other[0]) > 1e-3


def test_rendered_frames_have_the_mount_and_the_pose() -> None:
    camera = replace(EXACT.camera, width=320, height=180)
    with closing(RenderedSight(replace(EXACT, camera=camera, sight="rendered"), 5)) as sight:
        moment = moment_at(sight.surroundings, 0.5)
        frame = sight.take(moment)
        same = sight.take(moment)
    assert frame.world_from_body is not None and frame.truth is not None and frame.truth.left is not None
    np.testing.assert_allclose(frame.world_from_body.translation, moment.world_from_body.translation)
    np.testing.assert_array_equal(frame.image_rgb, same.image_rgb)
    truth = measured_frame(sight.surroundings, moment, empty_picture(sight.surroundings.camera)).truth
    assert truth is not None and truth.left is not None
    np.testing.assert_allclose(frame.truth.left.p0_m, truth.left.p0_m, atol=1e-9)
    ramp_px = frame.camera.project(frame.world_from_camera.inv().apply(frame.truth.left.p0_m[None]))[0]
    assert 0.3 * camera.height < ramp_px[1] < 0.7 * camera.height


def datalink_offset(seed: int) -> tuple[np.ndarray, float, float]:
    """Error of the datalink's ramp, m, and of its heading, degrees, and the change of its width, m."""
    scene = surroundings(replace(EXACT, sea_state=0.0), seed)
    with closing(PointSight(scene.config, seed)) as sight:
        moment = moment_at(scene, 2.0)
        frame = measured_frame(scene, moment, empty_picture(scene.camera))
        prior = datalink_prior(scene, sight.flight, frame)
    assert prior is not None and frame.truth is not None and frame.truth.left and frame.truth.right
    true = np.array([[line.p0_m, line.p1_m] for line in (frame.truth.left, frame.truth.right)])
    said = np.array([prior.left_m, prior.right_m])
    (x, y), (tx, ty) = (line[0, 1, :2] - line[0, 0, :2] for line in (said, true))
    turned = np.rad2deg(np.arctan2(tx * y - ty * x, tx * x + ty * y))
    widths = [float(np.linalg.norm(lines[1, 0] - lines[0, 0])) for lines in (said, true)]
    return (said - true)[:, 0].mean(axis=0), float(turned), widths[0] - widths[1]


def test_the_datalink_errs_by_what_it_states() -> None:
    shifts, turns, wider = zip(*(datalink_offset(seed) for seed in range(60)), strict=True)
    np.testing.assert_allclose(np.std(shifts, axis=0), DATALINK_SIGMA_M, rtol=0.3)
    assert np.std(turns) == pytest.approx(DATALINK_HEADING_SIGMA_DEG, rel=0.3)
    np.testing.assert_allclose(wider, 0.0, atol=1e-9)
    np.testing.assert_array_equal(datalink_offset(7)[0], shifts[7])


@pytest.mark.parametrize(("name", "value"), [("time_s", -1.0), ("velocity_m_s", np.zeros(2))])
def test_moments_refuse_what_they_cannot_be(name: str, value: object) -> None:
    moment = moment_at(surroundings(EXACT, 5), 0.0)
    with pytest.raises(ValueError, match=name):
        replace(moment, **{name: value})
