import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.spatial.transform import Rotation

from deckline.geometry import Camera
from deckline.haze import (
    Atmosphere,
    add_haze,
    air_path,
    atmosphere_from_mapping,
    beta_from_visibility,
    scatter,
    sun_glow,
    transmission,
    visibility_from_beta,
    world_rays,
)


@given(st.floats(0.1, 1e6))
def test_the_visibility_is_where_two_percent_are_left(visibility):
    beta = beta_from_visibility(visibility)
    assert visibility_from_beta(beta) == pytest.approx(visibility)
    np.testing.assert_allclose(transmission([0.0, visibility, np.inf, np.nan], beta), [1, 0.02, 0, 0], rtol=1e-5)


def test_clear_air_has_no_end_and_hides_nothing():
    assert (beta_from_visibility(float("inf")), visibility_from_beta(0.0)) == (0.0, float("inf"))
    assert (transmission([0.0, np.inf, np.nan], 0.0) == 1).all()


def test_add_haze_is_the_scattering_model():
    clear = np.full((2, 3, 3), 100, dtype=np.uint8)
    ranges = np.array([[0.0, 100.0, 500.0], [np.nan, np.inf, 250.0]])
    hazy = add_haze(clear, ranges, 0.004, [200, 210, 220])
    t = np.exp(-0.004 * np.nan_to_num(ranges, nan=np.inf))[..., None]
    np.testing.assert_array_equal(hazy, np.rint(100 * t + np.array([200, 210, 220]) * (1 - t)).astype(np.uint8))
    assert hazy.dtype == np.uint8
    assert (clear == 100).all()


EYE = np.array([30.0, -20.0, -45.0])  # 45 m above the water
UNIFORM = Atmosphere(extinction_per_m=(0.004, 0.004, 0.004), airlight=(0.7, 0.75, 0.8))
PATCHY = replace(UNIFORM, waves=((0.02, 0.01, 0.3, 0.4), (-0.005, 0.03, 2.0, 0.3)))


def rays_about(seed=0, shape=(6, 7)):
    """Unit directions (H, W, 3) and ranges (H, W) that end above the water, one of them the sky's."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(*shape, 3)) * [1.0, 1.0, 0.15]
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    to_water = np.where(directions[..., 2] > 0, -EYE[2] / np.maximum(directions[..., 2], 1e-9), 3000.0)
    ranges = np.minimum(rng.uniform(0.05, 1.0, shape) * to_water, 3000.0)
    ranges[0, 0], directions[0, 0] = np.nan, np.array([0.6, 0.0, -0.8])
    return directions.astype(np.float32), ranges.astype(np.float32)


def integrated(direction, range_m, atmosphere):
    """Path of air along a ray by numerical integration."""

    def density(s):
        at = EYE + s * direction
        banks = sum(a * np.cos(kx * at[0] + ky * at[1] + phase) for kx, ky, phase, a in atmosphere.waves)
        return np.exp((at[2] - atmosphere.base_z_m) / atmosphere.scale_height_m) * (1.0 + banks)

    return quad(density, 0.0, 1e5 if np.isnan(range_m) else range_m, limit=2000)[0]


@pytest.mark.parametrize(
    ("atmosphere", "rel"),
    [(replace(UNIFORM, scale_height_m=height_m, base_z_m=2.0), 2e-4) for height_m in (25.0, 300.0, 1e7)]
    + [(PATCHY, 1e-3)],
)
def test_the_air_path_is_the_integral_along_each_ray(atmosphere, rel):
    directions, ranges = rays_about()
    got = air_path(ranges, directions, EYE, atmosphere)
    for at in np.ndindex(*ranges.shape):
        if atmosphere.scale_height_m < 1e5 or at != (0, 0):
            assert got[at] == pytest.approx(integrated(directions[at].astype(float), ranges[at], atmosphere), rel=rel)
    if atmosphere.waves:
        assert np.std(got[1:] / ranges[1:]) > 0.05


def test_endless_rays_meet_all_the_air_above_them():
    atmosphere = replace(UNIFORM, scale_height_m=200.0)
    directions = np.array([[[0.6, 0.0, -0.8], [1.0, 0.0, 0.0], [0.8, 0.0, 0.6]]], dtype=np.float32)
    path = air_path(np.full((1, 3), np.nan, np.float32), directions, EYE, atmosphere)[0]
    assert path[0] == pytest.approx(200.0 * np.exp(-45.0 / 200.0) / 0.8, rel=1e-5)
    assert np.all(np.isinf(path[1:]))


@pytest.mark.parametrize("extinction_per_m", [(0.004, 0.004, 0.004), (0.002, 0.003, 0.004)])
def test_even_air_is_the_scattering_model_in_linear_light(extinction_per_m):
    air = replace(UNIFORM, extinction_per_m=extinction_per_m)
    directions, ranges = rays_about(2)
    light = np.random.default_rng(3).random((*ranges.shape, 3), dtype=np.float32)
    kept = light.copy()
    t = np.exp(-np.nan_to_num(ranges, nan=np.inf)[..., None] * extinction_per_m)
    expected = light * t + np.array(UNIFORM.airlight) * (1 - t)
    np.testing.assert_allclose(scatter(light, ranges, directions, EYE, air), expected, rtol=1e-5)
    np.testing.assert_array_equal(light, kept)
    no_air = replace(UNIFORM, extinction_per_m=(0.0, 0.0, 0.0))
    np.testing.assert_array_equal(scatter(light, ranges, directions, EYE, no_air), light)


def test_the_sun_brightens_the_air_before_it():
    sun = np.array([0.6, 0.0, 0.8])  # light falls towards +x and down, so the sun stands at -x
    air = replace(UNIFORM, glow=2.0, glow_g=0.7, sun=tuple(sun))
    directions = np.stack([-sun, sun, np.array([0.0, 1.0, 0.0])])[None].astype(np.float32)
    lobe = sun_glow(directions, air)[0]
    np.testing.assert_allclose(lobe, [1.0, (0.3 / 1.7) ** 3, 0.3**3 / 1.49**1.5], rtol=1e-4)
    seen = scatter(np.zeros((1, 3, 3), np.float32), np.full((1, 3), 1e6, np.float32), directions, EYE, air)[0]
    np.testing.assert_allclose(seen[:, 0], 0.7 * (1 + 2.0 * lobe), rtol=1e-5)


def test_world_rays_are_the_cameras():
    camera, turn = Camera.from_fov(32, 18, 1.2), Rotation.from_euler("xyz", [0.3, -0.2, 1.0])
    v, u = np.mgrid[0:18, 0:32]
    rays = camera.rays(np.column_stack([u.ravel(), v.ravel()]).astype(float))
    directions, lengths = world_rays(rays.reshape(18, 32, 3).astype(np.float32), turn.as_matrix())
    np.testing.assert_allclose(lengths, camera.ray_lengths(), rtol=1e-6)
    expected = turn.apply(rays) / np.linalg.norm(rays, axis=1)[:, None]
    np.testing.assert_allclose(directions.reshape(-1, 3), expected, atol=1e-6)


def test_an_atmosphere_survives_its_record():
    for air in (UNIFORM, replace(PATCHY, scale_height_m=120.0, glow=1.0, sun=(0.6, 0.0, 0.8))):
        text = json.dumps(air.to_mapping(), allow_nan=False)
        assert atmosphere_from_mapping(json.loads(text)) == air


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: replace(UNIFORM, extinction_per_m=(0.1, -0.1, 0.1)), r"extinction_per_m.*-0\.1"),
        (lambda: replace(UNIFORM, scale_height_m=0.0), r"scale_height_m.*0\.0"),
        (lambda: replace(UNIFORM, glow_g=1.0), r"glow_g.*1\.0"),
        (
            lambda: replace(UNIFORM, waves=((0.1, 0.1, 0.0, 0.7), (0.1, 0.2, 0.0, -0.6))),
            r"amplitudes.*0\.7.*-0\.6",
        ),
        (lambda: atmosphere_from_mapping({"glow": 1.0}), "atmosphere.*glow"),
        (lambda: beta_from_visibility(0.0), r"visibility.*0\.0"),
        (lambda: beta_from_visibility(-1.0), r"visibility.*-1\.0"),
        (lambda: beta_from_visibility(float("nan")), "visibility.*nan"),
        (lambda: visibility_from_beta(-1), "extinction.*-1"),
        (lambda: add_haze(np.zeros((2, 3, 3), np.uint8), np.zeros((3, 2)), 0.1, [1, 2, 3]), r"\(2, 3\).*\(3, 2\)"),
    ],
)
def test_impossible_air_and_shapes_are_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()


@pytest.mark.parametrize("height_m", [300.0, 3000.0, 9000.0, 40000.0])
def test_air_far_below_the_eye_is_counted_whole(height_m):
    air = Atmosphere((1e-3,) * 3, (1.0, 1.0, 1.0), scale_height_m=40.0)
    down = np.array([[[0.0, 0.0, 1.0], [0.6, 0.0, 0.8]]], np.float32)
    path = air_path(np.array([[height_m, height_m / 0.8]], np.float32), down, [0.0, 0.0, -height_m], air)
    expected = 40.0 * (1.0 - np.exp(-height_m / 40.0)) / np.array([[1.0, 0.8]])
    np.testing.assert_allclose(path, expected, rtol=1e-3)  # single precision of the height itself
