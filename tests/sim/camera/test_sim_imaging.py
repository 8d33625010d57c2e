"""Air and the whole camera path."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform
from undo_sensor import recorded_sensor, undo_sensor

from deckline.geometry import Camera, attitude, camera_mount, intersect_plane
from deckline.haze import atmosphere_from_mapping, scatter, world_rays
from deckline_sim.camera.imaging import (
    Imaging,
    Surroundings,
    draw_air,
    draw_airlight,
    draw_model,
    draw_waves,
    rain_extinction,
)
from deckline_sim.camera.lens import pinhole_for, pixel_rays, random_lens
from deckline_sim.camera.sensor import develop
from deckline_sim.config import AirConfig, DepthConfig, ExposureConfig, ImagingConfig, LensConfig, SensorConfig
from deckline_sim.scene.view import Rendering

CAMERA = Camera.from_fov(160, 90, 1.0)
POSE = RigidTransform.from_components([0.0, 0.0, -40.0], attitude(0.02, -0.15, 0.3)) * camera_mount()
SCENE = Surroundings((0.6, 0.7, 0.8), (0.6, 0.0, 0.8), 0.0, 400.0, (60.0, 0.0, 2.0))
EXACT = SensorConfig(noise=0.0, electrons=0.0, jpeg_quality=0)


@pytest.fixture(scope="module")
def imaging(context):
    return Imaging(context)


def sea_view(camera):
    """An even grey sea at z = 0 under a bright sky, computed ray by ray."""
    rays = pixel_rays(camera).reshape(-1, 3).astype(float)
    hits = intersect_plane(POSE.translation, POSE.rotation.apply(rays), 0.0)
    depth = POSE.inv().apply(hits)[:, 2].reshape(camera.height, camera.width).astype(np.float32)
    light = np.where(np.isnan(depth), 0.7, 0.1).astype(np.float32)
    return Rendering(np.repeat(light[..., None], 3, axis=2), depth)


def shot(imaging, config, scene=SCENE, camera=CAMERA, wide=False, seed=0):
    rngs = [np.random.default_rng([seed, k]) for k in range(2)]
    return imaging.take(sea_view(pinhole_for(camera)), camera, POSE, scene, config, *rngs, wide)


def test_clear_air_leaves_the_developed_picture(imaging):
    for model in ("paper", "physical"):
        config = ImagingConfig(sensor=EXACT, air=AirConfig(model=model))
        taken = shot(imaging, config, replace(SCENE, visibility_m=float("inf")))
        sensor = recorded_sensor(taken.records["sensor"])
        np.testing.assert_array_equal(taken.image_rgb, develop(sea_view(CAMERA).radiance, sensor))
        np.testing.assert_array_equal(taken.image_rgb, taken.clear_rgb)


def test_physical_haze_can_be_made_again_from_the_clear_picture_and_the_record(imaging):
    config = ImagingConfig(sensor=EXACT, air=AirConfig(model="physical", scale_height_m=150.0, patchiness=0.5))
    taken = shot(imaging, config)
    records = json.loads(json.dumps(taken.records, allow_nan=False))
    sensor, air = recorded_sensor(records["sensor"]), atmosphere_from_mapping(records["air"])
    directions, lengths = world_rays(pixel_rays(CAMERA), POSE.rotation.as_matrix())
    light = undo_sensor(taken.clear_rgb, sensor)
    again = develop(scatter(light, sea_view(CAMERA).depth_m * lengths, directions, POSE.translation, air), sensor)
    assert np.abs(again.astype(int) - taken.image_rgb).max() <= 2
    assert np.abs(taken.image_rgb.astype(int) - taken.clear_rgb).max() > 20


def test_the_lens_bends_picture_and_depth_alike(imaging):
    lens = LensConfig(distortion=(-0.2, 0.02, 0.001, 0.0, 0.0), principal_offset_px=(4.0, -3.0))
    camera = random_lens(lens, CAMERA, np.random.default_rng(0), wide=False)
    config = ImagingConfig(lens=lens, sensor=EXACT, depth=DepthConfig(range_m=np.inf))
    taken = shot(imaging, config, camera=camera)
    expected = sea_view(camera).depth_m
    near = expected < 300.0
    assert near.mean() > 0.3
    np.testing.assert_allclose(taken.depth_m[near], expected[near], rtol=1e-3)
    assert taken.image_rgb.shape == (90, 160, 3)
    short = shot(imaging, replace(config, depth=DepthConfig(range_m=90.0)), camera=camera)
    assert np.nanmax(short.depth_m) <= 90.0 < np.nanmax(taken.depth_m)


def test_the_same_generators_give_the_same_shot(imaging):
    config = ImagingConfig(exposure=ExposureConfig(exposure_s=0.02, rain_mm_h=10.0))
    first, again = (shot(imaging, config, wide=True, seed=9) for _ in range(2))
    np.testing.assert_array_equal(first.image_rgb, again.image_rgb)
    assert first.records == again.records
    assert np.any(shot(imaging, config, wide=True, seed=10).image_rgb != first.image_rgb)


def test_haze_counts_for_the_exposure(imaging):
    bright = replace(SCENE, horizon=(2.0, 2.0, 2.0), visibility_m=50.0)
    clear = replace(bright, visibility_m=float("inf"))
    config = ImagingConfig(sensor=replace(EXACT, exposure_ev=0.0, white_balance=(1.0, 1.0, 1.0)))
    gains = [shot(imaging, config, scene).records["sensor"]["gain"][1] for scene in (bright, clear)]
    assert gains[0] < 0.5 * gains[1]


def test_rain_shortens_the_visibility_and_the_clear_picture_is_kept_only_when_asked(imaging):
    config = ImagingConfig(sensor=EXACT, exposure=ExposureConfig(rain_mm_h=25.0), air=AirConfig(model="physical"))
    taken = shot(imaging, config)
    assert taken.visibility_m == pytest.approx(3.912023 / (3.912023 / 400.0 + 2.141e-3), rel=1e-3)
    rngs = [np.random.default_rng([0, k]) for k in range(2)]
    bare = imaging.take(sea_view(CAMERA), CAMERA, POSE, SCENE, config, *rngs, False, keep_clear=False)
    assert bare.clear_rgb is None
    np.testing.assert_array_equal(bare.image_rgb, taken.image_rgb)


HORIZON, SUN = np.array([0.6, 0.7, 0.8]), np.array([0.6, 0.0, 0.8])


def drawn(config, seed, visibility_m=500.0, rain_mm_h=0.0, wide=True):
    return draw_air(config, visibility_m, rain_mm_h, HORIZON, SUN, 0.0, np.random.default_rng(seed), wide)


def test_named_presets_have_the_papers_model_and_training_has_both():
    fair, wide = ({draw_model(AirConfig(), np.random.default_rng(k), w) for k in range(30)} for w in (False, True))
    assert fair == {"paper"}
    assert wide == {"paper", "physical"}
    assert draw_model(AirConfig(model="physical"), np.random.default_rng(0), wide=False) == "physical"


def test_defaults_are_as_documented():
    air = drawn(AirConfig(), 0, wide=False)
    np.testing.assert_allclose(air.extinction_per_m, np.full(3, -np.log(0.02) / 500.0))
    assert (air.scale_height_m, air.waves, air.glow, air.sun) == (1000.0, (), 1.0, (0.6, 0.0, 0.8))
    np.testing.assert_allclose(air.airlight, HORIZON, rtol=0.15)


def test_rain_thickens_the_air():
    # 25 mm/h: 1.076 * 25^0.67 = 9.30 dB/km, a 2 % visibility of 1.83 km.
    assert rain_extinction(25.0) == pytest.approx(2.141e-3, rel=1e-3)
    assert rain_extinction(0.0) == 0.0
    dry, wet = (drawn(AirConfig(), 3, float("inf"), rain, wide=False) for rain in (0.0, 25.0))
    assert dry.extinction_per_m == (0.0, 0.0, 0.0)
    np.testing.assert_allclose(wet.extinction_per_m, np.full(3, 2.141e-3), rtol=1e-3)


def test_small_drops_dim_blue_most():
    red, green, blue = drawn(AirConfig(angstrom=1.0), 0, wide=False).extinction_per_m
    assert green == pytest.approx(-np.log(0.02) / 500.0)
    assert (red / green, blue / green) == (pytest.approx(550 / 610), pytest.approx(550 / 465))


def test_given_settings_are_kept():
    config = AirConfig(scale_height_m=77.0, patchiness=0.5, patch_m=300.0, angstrom=0.0, glow=0.25)
    for wide in (False, True):
        air = drawn(config, 1, wide=wide)
        assert (air.scale_height_m, air.glow) == (77.0, 0.25)
        assert sum(wave[3] for wave in air.waves) == pytest.approx(0.5)


def test_waves_have_about_the_wavelength():
    waves = np.array(draw_waves(0.6, 400.0, np.random.default_rng(0)))
    length = 2 * np.pi / np.hypot(waves[:, 0], waves[:, 1])
    assert np.all((length > 190.0) & (length < 810.0))
    assert waves[:, 3].sum() == pytest.approx(0.6)
    assert draw_waves(0.0, 400.0, np.random.default_rng(0)) == ()


def test_thick_air_is_pale_under_a_gaudy_sky():
    gaudy = np.array([0.05, 0.5, 0.8])
    air = np.array([draw_airlight(gaudy, np.random.default_rng(k), wide=True) for k in range(100)])
    assert np.abs(air / air.mean(axis=1, keepdims=True) - 1).max() < 0.55
    pale = np.array([draw_airlight(HORIZON, np.random.default_rng(k), wide=True) for k in range(200)])
    assert 0.1 < pale.min() < pale.max() < 1.4
    assert np.all(draw_airlight(gaudy, np.random.default_rng(0), wide=False)[[0, 2]] / gaudy[[0, 2]] < 1.2)
