import numpy as np
import pytest
from sea_scene import CAMERA, EYE_Z_M, SEA_Z_M, ray_z, world_from_body

from deckline.dehaze.sea_view import EARTH_RADIUS_M, ray_lengths, view_sea, view_water
from deckline.geometry import Camera, camera_mount

POSE = world_from_body() * camera_mount()
VIEW = view_sea(CAMERA, POSE, SEA_Z_M)


def test_the_points_lie_on_the_sphere():
    assert VIEW.height_m == -EYE_Z_M
    np.testing.assert_allclose(VIEW.down, ray_z(world_from_body()), atol=1e-6)
    ranges, down = VIEW.range_m[VIEW.is_sea].astype(float), VIEW.down[VIEW.is_sea].astype(float)
    above_centre = EARTH_RADIUS_M + VIEW.height_m - ranges * down
    across_sq = ranges**2 * (1 - down**2)
    height = np.hypot(above_centre, np.sqrt(across_sq)) - EARTH_RADIUS_M
    near = ranges < 10_000  # beyond, a pixel's float32 sine moves the point by more
    assert np.abs(height[near]).max() < 0.1


def test_the_horizon_dips_as_sailors_know_it():
    """1.76 arc minutes times the root of the height in metres (IHO)."""
    camera = Camera(1, 2001, 20_000.0, 20_000.0, 0.0, 1000.0)
    view = view_sea(camera, world_from_body(0.0, 0.0) * camera_mount(), SEA_Z_M)
    dip_rad = np.arcsin(view.down[view.is_sea].min())
    assert np.degrees(dip_rad) * 60 == pytest.approx(1.76 * np.sqrt(60.0), rel=0.02)


@pytest.mark.parametrize("eye_z_m", [0.0, 5.0])
def test_a_camera_that_is_not_above_the_water_sees_none(eye_z_m):
    view = view_sea(CAMERA, world_from_body(eye_z_m=eye_z_m) * camera_mount(), SEA_Z_M)
    assert not view.is_sea.any()


def test_pixels_without_a_ray_are_sky():
    strong = Camera(64, 64, 30.0, 30.0, 31.5, 31.5, (-0.5, 0.0, 0.0, 0.0, 0.0))
    view = view_sea(strong, world_from_body(-60.0) * camera_mount(), SEA_Z_M)
    assert np.isnan(strong.rays([[0.0, 63.0]])).any()
    assert not view.is_sea[63, 0]
    assert np.isfinite(view.down).all()


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (9, 1), (640, 360)])
def test_a_lens_bends_the_rays_as_the_camera_does(size):
    width, height = size
    camera = Camera(width, height, 400.0, 410.0, 0.48 * width, 0.53 * height, (-0.1, 0.02, 0.001, -0.002, 0.0))
    view = view_sea(camera, POSE, SEA_Z_M)
    v, u = np.mgrid[0:height, 0:width]
    rays = POSE.rotation.apply(camera.rays(np.stack([u.ravel(), v.ravel()], axis=1)))
    exact = (rays[:, 2] / np.linalg.norm(rays, axis=1)).reshape(height, width)
    assert np.abs(view.down - exact).max() < 2e-5
    np.testing.assert_allclose(ray_lengths(camera), camera.ray_lengths(), atol=3e-5)


def test_a_plane_above_the_water_is_seen_along_the_same_rays():
    deck = view_water(VIEW.down, VIEW.height_m - 20.0)
    np.testing.assert_array_equal(deck.range_m, view_sea(CAMERA, POSE, SEA_Z_M - 20.0).range_m)


def test_the_sea_share_rises_over_one_pixel_at_the_horizon():
    share, whole = VIEW.sea_share, VIEW.is_sea
    between = (share > 0) & (share < 1)
    assert between.any(axis=0).mean() > 0.9  # nearly every column crosses the horizon within a pixel
    assert between.sum(axis=0).max() <= 2
    np.testing.assert_array_equal(share[~between] > 0.5, whole[~between])
    np.testing.assert_array_equal(share > 0.5, whole)
    assert view_water(np.full((1, 1), -0.1, np.float32), 50.0).sea_share.tolist() == [[0.0]]
