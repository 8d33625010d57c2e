import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from deckline.geometry import Camera
from deckline.sim.scene.uniforms import clip_from_optical, sea_uniforms, solid_uniforms
from deckline.sim.scene.view import Scene
from deckline.sim.scene.weather import random_weather

CAMERA = Camera.from_fov(640, 360, np.deg2rad(60.0))
WEATHER = random_weather(np.random.default_rng(0))


def test_projection_agrees_with_the_camera():
    points = np.array([[3.0, -2.0, 40.0], [-30.0, 10.0, 90.0], [0.0, 0.0, 5.0]])
    clip = np.column_stack([points, np.ones(3)]) @ clip_from_optical(CAMERA).T
    pixels = (clip[:, :2] / clip[:, 3:] + 1) / 2 * [640, 360] - 0.5
    np.testing.assert_allclose(pixels, CAMERA.project(points), atol=1e-9)


def test_depth_row_gives_the_depth_along_the_axis():
    pose = RigidTransform.from_translation([4.0, 5.0, 6.0])
    values = solid_uniforms(Scene(CAMERA, RigidTransform.identity(), WEATHER), pose, 100.0)
    assert values["depth_row"] @ np.array([1.0, 2.0, 3.0, 1.0]) == pytest.approx(9.0)


def test_long_waves_run_faster():
    weather = WEATHER
    drift = np.array(sea_uniforms(weather, 2.0)["drift_m"])
    assert drift[0] > drift[1] > drift[2] > 0
    assert drift[0] == pytest.approx(2.0 * np.sqrt(9.81 * weather.wave_length_m / (2 * np.pi)))
    assert sea_uniforms(weather, 0.0)["drift_m"] == [0.0] * 4
