from dataclasses import replace

import numpy as np
import pytest
from sea_scene import AIRLIGHT, CAMERA, EYE_Z_M, SEA, SEA_Z_M, ray_z, sea_pair, world_from_body

from deckline.dehaze.haze_fit import (
    DISPLAY_WATER,
    EARTH_RADIUS_M,
    HazeFit,
    NotFitted,
    WaterPrior,
    explained_share,
    fit_haze,
    measure_profile,
    prior_equations,
    ray_lengths,
    view_sea,
)
from deckline.geometry import Camera, camera_mount, intersect_plane
from deckline.haze import beta_from_visibility

POSE = world_from_body() * camera_mount()
VIEW = view_sea(CAMERA, POSE, SEA_Z_M)


@pytest.mark.parametrize("visibility_m", [500.0, 1200.0, 3000.0])
def test_a_known_haze_is_found(visibility_m):
    beta = beta_from_visibility(visibility_m)
    fit = fit_haze(sea_pair(beta)[0], VIEW)
    assert isinstance(fit, HazeFit)
    assert fit.beta_per_m == pytest.approx(beta, rel=0.08)  # the grid's step is 7.5 %
    assert 0 < fit.beta_sigma_per_m < 0.5 * beta
    assert fit.bank_per_m == 0
    np.testing.assert_allclose(fit.airlight, AIRLIGHT, atol=0.5)
    straight_below = fit.clear_sea(np.ones((1, 1), np.float32))[:, 0, 0]
    np.testing.assert_allclose(straight_below, SEA, atol=12)


def test_air_that_thickens_with_range_is_told_from_even_air():
    fit = fit_haze(sea_pair(1e-3, bank_per_m=1e-3)[0], VIEW)
    assert fit.bank_per_m == pytest.approx(1e-3, rel=0.25)
    assert fit.optical_depth(np.float32(1000.0)) == pytest.approx(2.0, rel=0.2)


def test_foam_and_a_ship_do_not_move_it():
    beta = beta_from_visibility(1000.0)
    image = sea_pair(beta)[0]
    image[100:180, 20:90] = 225  # wake
    image[70:130, 150:200] = 60  # hull
    assert fit_haze(image, VIEW).beta_per_m == pytest.approx(beta, rel=0.15)


def test_clear_air_comes_out_thin():
    assert fit_haze(sea_pair(0.0)[1], VIEW).beta_per_m < beta_from_visibility(20_000.0)


def test_optical_depth_is_the_law():
    fit = HazeFit(AIRLIGHT, 2e-3, 1e-4, 1e-3, np.zeros((2, 3)))
    depth = fit.optical_depth(np.array([0.0, 500.0, np.inf], np.float32))
    np.testing.assert_allclose(depth[:2], [0.0, 1.0 + 0.5**4], rtol=1e-5)
    assert np.exp(-depth[2]) == 0


def test_water_that_tells_nothing_is_taken_as_usual():
    pulls, usual = prior_equations(WaterPrior(0.7, 0.1, 0.5, 0.3), AIRLIGHT)
    np.testing.assert_allclose(np.linalg.solve(pulls, usual), [-0.7 * AIRLIGHT, 0.35 * AIRLIGHT])


@pytest.mark.parametrize("mirror", [0.5, 0.7])
def test_thick_haze_over_usual_water_seen_from_high_up_is_told(mirror):
    """The nearest water transmits a seventh; how bright the far water is cannot be seen."""
    beta, pose = 2e-3, world_from_body(-8.0, 0.0, -300.0)
    view = view_sea(CAMERA, pose * camera_mount(), SEA_Z_M)
    down = view.down[..., None]
    sea = AIRLIGHT * (1 - DISPLAY_WATER.dark * (1 - mirror * (1 - np.clip(down, 0, 1)) ** 5))
    waves = np.random.default_rng(5).normal(0, 3, (*view.down.shape, 1))
    t = np.exp(-beta * view.range_m)[..., None]
    image = np.rint(np.where(down > 0, AIRLIGHT + t * (sea + waves - AIRLIGHT), AIRLIGHT)).astype(np.uint8)
    fit = fit_haze(image, view)
    assert fit.beta_per_m == pytest.approx(beta, rel=0.1)
    found = np.moveaxis(fit.clear_sea(view.down), 0, 2)[view.range_m < 1000]
    assert np.abs(found - sea[view.range_m < 1000]).mean() < 12


def reason(image: np.ndarray, view=VIEW) -> str:
    result = fit_haze(image, view)
    assert isinstance(result, NotFitted)
    return result.reason


def test_what_cannot_be_told_is_said():
    image = sea_pair(2e-3)[0]
    looking_down = view_sea(CAMERA, world_from_body(-60.0) * camera_mount(), SEA_Z_M)
    looking_up = view_sea(CAMERA, world_from_body(25.0) * camera_mount(), SEA_Z_M)
    assert reason(image, looking_down) == "the horizon is not in view"
    assert reason(image, looking_up) == "the horizon is not in view"
    assert reason(image // 10) == "too dark to see the haze"
    assert reason(np.full_like(image, 150)) == "the sea cannot be told from the haze"
    mist = sea_pair(1.5e-2)[0]
    mist[VIEW.range_m < 260] = 20  # a deck hides all water that is not hidden by the mist
    assert reason(mist) == "the sea does not tell how thick the haze is"
    striped = np.repeat(np.where(np.arange(len(image)) // 9 % 2, 60, 130), image.shape[1])  # fields, say
    land = np.where(VIEW.is_sea[..., None], striped.reshape(*VIEW.is_sea.shape, 1), image).astype(np.uint8)
    assert reason(land) == "what lies below the horizon does not fade as a sea in haze does"
    sliver = view_sea(CAMERA, world_from_body(16.8, 0.0) * camera_mount(), SEA_Z_M)
    assert sliver.is_sea.any()
    assert reason(image, sliver) == "too little sea in view"


def test_a_deck_just_ahead_hides_the_sea_and_its_sides_tell():
    """A dark deck in the middle three fifths, all the way up to the horizon, in clear air: it does not fade."""
    beta = beta_from_visibility(1500.0)
    image = sea_pair(beta)[0]
    ahead = VIEW.is_sea.copy()
    ahead[:, :64] = ahead[:, -64:] = False
    image[ahead] = np.random.default_rng(6).integers(50, 75, (ahead.sum(), 1))
    fit = fit_haze(image, VIEW)
    assert isinstance(fit, HazeFit)
    assert fit.beta_per_m == pytest.approx(beta, rel=0.15)


def test_noise_does_not_thin_the_haze():
    beta, sigma = beta_from_visibility(1200.0), 5.0
    image = sea_pair(beta)[0].astype(np.float32)
    noisy = image + np.random.default_rng(7).normal(0, sigma, image.shape).astype(np.float32)
    assert fit_haze(noisy, VIEW, noise_sigma=sigma).beta_per_m == pytest.approx(beta, rel=0.1)
    assert fit_haze(noisy, VIEW).beta_per_m < 0.8 * beta  # what a quantile below the median makes of it


def test_the_share_of_explained_bins():
    fit = fit_haze(sea_pair(2e-3)[0], VIEW)
    profile = measure_profile(sea_pair(2e-3)[0], VIEW)
    assert explained_share(fit, profile) == 1
    wrong = replace(profile, levels=profile.levels + np.where(np.arange(len(profile.range_m)) < 10, 3.0, 0)[:, None])
    assert explained_share(fit, wrong) == pytest.approx(1 - 10 / len(profile.range_m))  # 3 levels in each of 3 channels


def test_near_water_is_where_a_flat_sea_is():
    ray = POSE.rotation.apply(CAMERA.rays([[200.0, 170.0]]))
    hit = intersect_plane(POSE.translation, ray, SEA_Z_M)[0]
    assert VIEW.range_m[170, 200] == pytest.approx(np.linalg.norm(hit - POSE.translation), rel=1e-3)
    assert VIEW.height_m == -EYE_Z_M
    np.testing.assert_allclose(VIEW.down, ray_z(world_from_body()), atol=1e-6)


def test_the_points_lie_on_the_sphere():
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


@pytest.mark.parametrize("distortion", [(0.0,) * 5, (-0.2, 0.05, 0.001, -0.002, 0.0)])
def test_rows_are_the_same_as_in_the_whole_picture(distortion):
    camera = Camera(40, 30, 30.0, 31.0, 19.0, 16.0, distortion)
    whole, rows = view_sea(camera, POSE, SEA_Z_M), view_sea(camera, POSE, SEA_Z_M, slice(11, 23))
    np.testing.assert_array_equal(rows.down, whole.down[11:23])
    np.testing.assert_array_equal(rows.range_m, whole.range_m[11:23])


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (9, 1), (640, 360)])
def test_a_lens_bends_the_rays_as_the_camera_says(size):
    width, height = size
    camera = Camera(width, height, 400.0, 410.0, 0.48 * width, 0.53 * height, (-0.1, 0.02, 0.001, -0.002, 0.0))
    view = view_sea(camera, POSE, SEA_Z_M)
    v, u = np.mgrid[0:height, 0:width]
    rays = POSE.rotation.apply(camera.rays(np.stack([u.ravel(), v.ravel()], axis=1)))
    exact = (rays[:, 2] / np.linalg.norm(rays, axis=1)).reshape(height, width)
    assert np.abs(view.down - exact).max() < 2e-5
    np.testing.assert_allclose(ray_lengths(camera), camera.ray_lengths(), atol=3e-5)
