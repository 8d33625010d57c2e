"""Haze that training lays over clear views: as the laws say, and a prior that geometry alone can give."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from deckline.dehaze.geometry import linear_levels
from deckline.evaluation.metrics import psnr_db
from deckline.geometry import Camera, attitude, camera_mount
from deckline.haze import transmission
from deckline.train.dehaze_data import ClearView, lowest_z
from deckline.train.dehaze_haze import HazeAugmentation, geometry_prior, lay_haze, physical_haze

CAMERA = Camera.from_fov(320, 180, np.radians(60))
EYE_M, DECK_Z_M, SEA_Z_M = 60.0, -8.0, 12.0
POSE = (
    RigidTransform.from_components([0.0, 0.0, SEA_Z_M - EYE_M], attitude(0.0, np.radians(-8.0), 1.0)) * camera_mount()
)
PLAIN = HazeAugmentation(clear_share=0, noise_share=0)


@pytest.fixture(scope="module")
def view() -> ClearView:
    """A dark textured sea under a bright sky, seen from above."""
    v, u = np.mgrid[0 : CAMERA.height, 0 : CAMERA.width]
    rays = CAMERA.rays(np.stack([u.ravel(), v.ravel()], axis=1).astype(float))
    down = (rays @ POSE.rotation.as_matrix()[2] / np.linalg.norm(rays, axis=1)).reshape(u.shape)
    ranges = np.where(down > 0, EYE_M / np.maximum(down, 1e-9), np.inf)
    image = np.random.default_rng(0).normal((30, 50, 62), 3, (*u.shape, 3))
    image[down <= 0] = (150, 165, 180)
    with np.errstate(over="ignore"):
        half = ranges.astype(np.float16)
    horizon = np.array([150, 165, 180], np.float32)
    clear = np.rint(image).clip(0, 255).astype(np.uint8)
    return ClearView(clear, half, horizon, CAMERA, POSE, DECK_Z_M, SEA_Z_M)


def test_the_sea_is_the_lowest_thing_in_view(view: ClearView) -> None:
    """Half-precision ranges are right to 0.05 %, so the water's height is, of the 60 m it lies below."""
    assert lowest_z(view.range_m.astype(float), CAMERA, POSE) == pytest.approx(SEA_Z_M, abs=0.05)
    assert lowest_z(np.full((180, 320), np.inf), CAMERA, POSE) == SEA_Z_M - EYE_M


def test_the_prior_brings_the_clear_picture_nearer_wherever_the_sea_lies(view: ClearView) -> None:
    hazy, _ = lay_haze(view, replace(PLAIN, visibility_m=(700, 700), exact_share=1, horizon_share=1), rng(3))
    assert psnr_db(geometry_prior(view, hazy, rng(0)), view.clear_rgb) > psnr_db(hazy, view.clear_rgb) + 8
    for without in (replace(view, world_from_camera=None), replace(view, deck_z_m=None)):
        np.testing.assert_array_equal(geometry_prior(without, hazy, rng(0)), hazy)


def test_recorded_haze_is_kept_when_asked_for(view: ClearView) -> None:
    seen = np.full_like(view.clear_rgb, 77)
    recorded = replace(view, hazy_rgb=seen, visibility_m=900.0)
    hazy, t = lay_haze(recorded, replace(PLAIN, recorded_share=1), rng(0))
    np.testing.assert_array_equal(hazy, seen)
    np.testing.assert_allclose(t, transmission(view.range_m, 3.912 / 900), atol=1e-5)
    plain = [lay_haze(each, PLAIN, rng(4))[0] for each in (view, recorded)]
    np.testing.assert_array_equal(*plain)


def test_physical_haze_hides_the_sky_and_spares_what_is_near(view: ClearView) -> None:
    """Air that thins with height is seen through upwards, so the sky is judged in even air only."""
    for seed in range(30):
        hazy, t = physical_haze(view, 400.0, np.array([150.0, 165.0, 180.0]), rng(seed))
        assert t.shape == (180, 320)
        assert np.isfinite(t).all()
        assert (t >= 0).all()
        assert (t <= 1).all()
        near, far = t[-1].mean(), t[np.isfinite(view.range_m)].min()
        assert far < near
        light = linear_levels(np.arange(256))[hazy[-1]].mean(axis=0)
        assert (light > linear_levels(np.arange(256))[view.clear_rgb[-1]].mean(axis=0) * near - 1).all()
    with pytest.raises(ValueError, match="needs the view's pose"):
        physical_haze(replace(view, world_from_camera=None), 400.0, np.ones(3), rng(0))


def test_views_without_a_pose_get_the_papers_haze(view: ClearView) -> None:
    lost = replace(view, world_from_camera=None)
    even = replace(PLAIN, visibility_m=(500, 500), physical_share=1)
    _, t = lay_haze(lost, even, rng(1))
    np.testing.assert_allclose(t, transmission(view.range_m, 3.912 / 500), atol=1e-5)


def rng(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)
