import numpy as np
import pytest

from deckline.geometry import Camera
from deckline.sim.config import SimConfig
from deckline.sim.layout import cvn_layout, paper_layout, random_layout
from deckline.sim.paint import axes
from deckline.sim.trajectory import APPARENT_WIDTH, approach_view, draw_range, looking, random_view, runway_in_view

PAPER = SimConfig(preset="paper", frames=50)


def ship_position(layout, view):
    return layout.world_from_ship.inv().apply(view.world_from_body.translation)


def test_nose_points_at_the_target():
    position, target = np.array([10.0, -5.0, -60.0]), np.array([-200.0, 40.0, 6.0])
    body = looking(position, target, np.zeros(3))
    nose = body.rotation.apply([1.0, 0.0, 0.0])
    np.testing.assert_allclose(nose, (target - position) / np.linalg.norm(target - position), atol=1e-12)
    assert abs(body.rotation.apply([0.0, 1.0, 0.0])[2]) < 1e-12  # wings level


def test_approach_follows_the_glideslope_in_equal_times():
    layout = paper_layout()
    views = [approach_view(PAPER, layout, k) for k in range(50)]
    along, right, _ = axes(*layout.centre_m)
    positions = np.array([ship_position(layout, view) for view in views])
    ranges = -(positions[:, :2] - layout.centre_m[0]) @ along
    np.testing.assert_allclose(ranges, np.linspace(800.0, 12.0, 50), atol=1e-6)
    np.testing.assert_allclose(np.diff([view.time_s for view in views]), 788.0 / 49 / 65.0)
    path = (ranges + 70.0) * np.tan(np.deg2rad(3.5))
    assert np.abs(-positions[:, 2] - path).max() < 12.0
    assert np.abs((positions[:, :2] - layout.centre_m[0]) @ right).max() < 30.0
    assert -positions[:, 2].max() >= 3.05 - 1e-9
    assert min(runway_in_view(view, layout) for view in views[:40]) == 1.0


def test_random_views_stay_in_range_and_mostly_show_the_runway():
    layout, config = cvn_layout(), SimConfig(preset="cvn", trajectory="random")
    shown = []
    for k in range(60):
        view = random_view(config, layout, k, np.random.default_rng(k))
        position = ship_position(layout, view)
        along, _, _ = axes(*layout.centre_m)
        assert 60.0 <= -(position[:2] - layout.centre_m[0]) @ along <= 800.0
        assert -position[2] >= 3.05
        shown.append(runway_in_view(view, layout))
    assert np.mean(np.array(shown) > 0.6) > 0.8


def test_training_draws_fields_of_view_that_show_something():
    config = SimConfig(preset="train", trajectory="random")
    for seed in range(40):
        rng = np.random.default_rng(seed)
        layout = random_layout(rng)
        range_m, fov = draw_range(config, layout, rng)
        assert 30.0 <= range_m <= 1500.0
        assert np.deg2rad(10.0) <= fov <= np.deg2rad(90.0)
        width = np.hypot(*(layout.right_m[0] - layout.left_m[0]))
        apparent = width * Camera.from_fov(100, 50, fov).fx / range_m / 100
        assert APPARENT_WIDTH[0] <= apparent <= APPARENT_WIDTH[1]


def test_fixed_field_of_view_is_kept():
    config = SimConfig(preset="train", trajectory="random", fixed_fov=True, fov_deg=33.0)
    assert draw_range(config, cvn_layout(), np.random.default_rng(0))[1] == pytest.approx(np.deg2rad(33.0))
