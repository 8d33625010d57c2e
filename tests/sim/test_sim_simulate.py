"""Frames of a recording, with and without a runway."""

import numpy as np
import pytest

from deckline_lab.evaluation.frames import RenderOptions
from deckline_sim import SimConfig, frames
from deckline_sim.config import DepthConfig, MotionConfig, NavigationConfig, SensorConfig, WeatherConfig

FAR = DepthConfig(range_m=float("inf"))
SMALL = {"width": 160, "height": 90}


pytestmark = pytest.mark.usefixtures("opengl")


def rendered(config, start=0):
    return list(frames(config, start))


@pytest.fixture(scope="module")
def training():
    settings = {"preset": "train", "trajectory": "random", "frames": 24, "frames_per_ship": 1, "seed": 3}
    return rendered(SimConfig(**settings, **SMALL, depth=FAR))


@pytest.mark.parametrize("trajectory", ["random", "approach"])
def test_a_frame_depends_on_seed_and_index_alone(trajectory):
    settings = {"preset": "train", "trajectory": trajectory, "frames": 4, "frames_per_ship": 3}
    config = SimConfig(**settings, **SMALL, visibility_m=(200.0, 900.0))
    whole, tail = rendered(config), rendered(config, start=2)
    assert len(tail) == 2
    for a, b in zip(whole[2:], tail, strict=True):
        assert a.file == b.file
        np.testing.assert_array_equal(a.image_rgb, b.image_rgb)
        np.testing.assert_array_equal(a.depth_m, b.depth_m)
        np.testing.assert_array_equal(a.truth.left.p0_m, b.truth.left.p0_m)
        np.testing.assert_array_equal(a.world_from_body.as_matrix(), b.world_from_body.as_matrix())
    (other,) = rendered(SimConfig(**settings, **SMALL, seed=1), start=3)
    assert np.any(other.image_rgb != whole[3].image_rgb)
    assert np.abs(other.world_from_body.as_matrix() - whole[3].world_from_body.as_matrix()).max() > 0.1


def test_a_weathers_seed_keeps_light_sky_and_sea_in_every_recording():
    def weathers(seed: int, weather: int | None) -> list[dict]:
        config = SimConfig(trajectory="random", frames=2, seed=seed, weather=WeatherConfig(seed=weather), **SMALL)
        return [frame.truth.conditions["weather"] for frame in rendered(config)]

    (first, second), (third, _) = weathers(1, 4), weathers(2, 4)
    assert first == second == third
    assert weathers(1, 5)[0] != first
    changing = weathers(1, None)
    assert changing[0] != changing[1]
    deckless = SimConfig(preset="train", trajectory="deckless", frames=2, weather=WeatherConfig(seed=4), **SMALL)
    one, other = (frame.truth.conditions["weather"] for frame in rendered(deckless))
    assert one == other


def test_haze_follows_the_scattering_model():
    exact = SensorConfig(noise=0.0, electrons=0.0, jpeg_quality=0)
    config = SimConfig(frames=3, visibility_m=(300.0, 300.0), depth=FAR, sensor=exact, **SMALL)
    for frame in rendered(config):
        distance = frame.depth_m * frame.camera.ray_lengths()
        t = np.where(np.isnan(distance), 0.0, np.exp(-3.912023 / 300.0 * np.nan_to_num(distance)))[..., None]
        expected = frame.truth.clear_rgb * t + np.array(frame.truth.airlight_rgb) * (1 - t)
        assert np.abs(frame.image_rgb - expected).max() <= 0.51
        assert frame.truth.visibility_m == 300.0
    assert np.abs(frame.image_rgb.astype(float) - frame.truth.clear_rgb).max() > 30.0


def test_visibility_is_uniform_in_its_limits_and_infinite_when_clear(training):
    config = SimConfig(preset="cvn", trajectory="random", frames=6, visibility_m=(100.0, 900.0), **SMALL)
    values = [frame.truth.visibility_m for frame in rendered(config)]
    assert 100.0 <= min(values) < max(values) <= 900.0
    assert len(set(values)) == 6
    assert {frame.truth.visibility_m for frame in training} == {float("inf")}


def test_training_frames_differ_and_are_neither_black_nor_white(training):
    means = np.array([frame.image_rgb.mean() for frame in training])
    assert len({frame.file for frame in training}) == len(training)
    assert np.std(means) > 10.0
    assert np.mean((means > 20) & (means < 235)) > 0.9
    assert len({frame.camera.fx for frame in training}) == len(training)
    bare = [frame for frame in training if frame.truth.left is None]
    assert 0 < len(bare) < 8 and all(frame.truth.right is None for frame in bare)


def test_left_is_left_on_the_deck_and_the_ramp_end_is_mostly_nearer(training):
    nearer = []
    for frame in training:
        if frame.truth.left is None:
            continue
        left, right = frame.truth.left, frame.truth.right
        along = left.p1_m - left.p0_m
        across = np.cross([0.0, 0.0, 1.0], along / np.linalg.norm(along))
        assert (right.p0_m - left.p0_m) @ across > 9.0
        on_ship = frame.truth.world_from_ship.inv().apply([left.p0_m, left.p1_m, right.p0_m, right.p1_m])
        np.testing.assert_allclose(on_ship[:, 2], 0.0, atol=1e-9)
        assert abs(left.p0_m[2] - frame.deck_z_m) < 6.0  # the deck moves about the height that the ship reports
        assert frame.sea_z_m > frame.deck_z_m
        camera = frame.world_from_camera.translation
        nearer.append(np.linalg.norm(left.p0_m - camera) < np.linalg.norm(left.p1_m - camera))
    assert np.mean(nearer) > 0.7  # the others look from ahead or abeam


def test_a_pitching_ship_under_way_carries_its_lines():
    motion = MotionConfig(sea_state=6, ship_speed_m_s=12.0)
    first, *_, last = rendered(SimConfig(frames=4, motion=motion, **SMALL))
    still = next(frames(SimConfig(frames=4, **SMALL)))
    seconds = last.time_s - first.time_s
    sailed = last.truth.world_from_ship.translation - first.truth.world_from_ship.translation
    assert np.linalg.norm(sailed[:2]) == pytest.approx(12.0 * seconds, abs=1.0)
    tilt = [frame.truth.left.p1_m[2] - frame.truth.left.p0_m[2] for frame in (first, last, still)]
    assert abs(tilt[2]) < 1e-9 < 0.1 < max(abs(tilt[0]), abs(tilt[1]))
    assert first.truth.conditions["weather"]["sea_state"] == 6  # one sea for the ship and for the eye


def test_a_measured_pose_leaves_the_true_one_in_the_truth():
    (exact,) = rendered(SimConfig(frames=2, **SMALL), start=1)
    (noisy,) = rendered(SimConfig(frames=2, navigation=NavigationConfig(position_bias_m=1.5), **SMALL), start=1)
    assert exact.truth.world_from_body is None
    np.testing.assert_array_equal(noisy.true_world_from_body.as_matrix(), exact.world_from_body.as_matrix())
    assert 0.1 < np.linalg.norm(noisy.world_from_body.translation - exact.world_from_body.translation) < 9.0
    np.testing.assert_array_equal(noisy.image_rgb, exact.image_rgb)


@pytest.mark.parametrize("preset", ["axial", "small", "runway"])
def test_every_class_is_flown_to_along_the_papers_profile(preset):
    frames_seen = rendered(SimConfig(preset=preset, trajectory="profile", frames=3, **SMALL))
    heights = [frame.deck_z_m - frame.world_from_body.translation[2] for frame in frames_seen]
    assert heights[0] == pytest.approx(400.0, abs=5.0) and heights[0] > heights[1] > heights[2] > 0
    for frame in frames_seen:  # the camera is pointed at the runway
        middle = (frame.truth.left.p0_m + frame.truth.right.p0_m) / 2
        (pixel,) = frame.camera.project(frame.world_from_camera.inv().apply(middle[None]))
        assert frames_seen[2] is frame or np.linalg.norm(pixel - [79.5, 44.5]) < 40.0


def test_start_must_not_be_negative():
    with pytest.raises(ValueError, match=r"start .*-1"):
        next(frames(SimConfig(), start=-1))


def test_views_without_a_runway_show_each_kind_in_turn_whatever_came_before():
    settings = {"preset": "train", "trajectory": "deckless", "keep_clear": False, "width": 96, "height": 54}
    config = SimConfig(frames=5, visibility_m=(500.0, 3000.0), seed=1000, frames_per_ship=1, **settings)
    views = rendered(config)
    shown = [frame.truth.conditions["deckless"] for frame in views]
    assert set(shown) <= {"open sea", "open land", "other ships", "coast", "past a ship", "past a runway", "bare deck"}
    assert shown[0].startswith("open") and shown[3].startswith("past") and shown[4] == "bare deck"
    for frame in views:
        assert (frame.truth.left, frame.truth.right) == (None, None) or frame.truth.conditions["deckless"].startswith(
            "past"
        )
        assert frame.image_rgb.std() > 0
        assert 500.0 <= frame.truth.visibility_m <= 3000.0
    np.testing.assert_array_equal(rendered(config, start=1)[0].image_rgb, views[1].image_rgb)


def test_sets_of_the_command():
    sets = RenderOptions(7, 3, ("paper", "cvn", "paper"), 5, "200..900", (50.0, 60.0), 40.0).open_sets()
    assert [(item.name, len(item)) for item in sets] == [
        ("rendered paper", 7),
        ("rendered cvn", 7),
        ("no runway", 3),
    ]
    assert sets[1].settings["visibility_m"] == [200.0, 900.0]
    assert sets[1].settings["fov_deg"] == 40.0
    assert RenderOptions(0, 3, visibility="clear").open_sets()[0].settings["visibility_m"] == ["inf", "inf"]
