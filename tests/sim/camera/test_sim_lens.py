from dataclasses import replace

import numpy as np
import pytest

from deckline.geometry import Camera
from deckline_sim.camera.lens import Lens, pinhole_for, pixel_rays, random_lens
from deckline_sim.config import LensConfig
from deckline_sim.scene.view import Rendering

BARREL = Camera(320, 200, 180.0, 184.0, 165.0, 96.0, (-0.15, 0.03, 0.002, -0.001, -0.004))
PINCUSHION = Camera(320, 200, 180.0, 184.0, 155.5, 103.0, (0.08, 0.01, -0.001, 0.002, 0.0))
LENSES = pytest.mark.parametrize("camera", [BARREL, PINCUSHION])


@pytest.fixture(scope="module")
def lens(context):
    return Lens(context)


def grid(camera):
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    return np.column_stack([u.ravel(), v.ravel()]).astype(float)


def dots(camera, points, sigma=1.2):
    """A picture (H, W, 3) with a soft dot at each pixel (N, 2)."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    light = sum(np.exp(-0.5 * ((u - x) ** 2 + (v - y) ** 2) / sigma**2) for x, y in points)
    return np.repeat(light[..., None], 3, axis=2).astype(np.float32)


@LENSES
def test_a_point_is_drawn_where_the_lens_projects_it(lens, camera):
    corners = np.array([[40.0, 30.0], [280.0, 30.0], [40.0, 170.0], [280.0, 170.0], [160.0, 100.0], [60.0, 100.0]])
    points = camera.rays(corners + 0.37) * 55.0
    source = pinhole_for(camera)
    view = Rendering(dots(source, source.project(points)), np.full((source.height, source.width), 55.0, np.float32))
    picture = lens.warp(view, source, camera).radiance[..., 1].astype(float)
    for u, v in camera.project(points):
        box = picture[round(v) - 6 : round(v) + 7, round(u) - 6 : round(u) + 7]
        rows, columns = np.mgrid[round(v) - 6 : round(v) + 7, round(u) - 6 : round(u) + 7]
        found = np.array([(box * columns).sum(), (box * rows).sum()]) / box.sum()
        np.testing.assert_allclose(found, [u, v], atol=0.05)


def test_depth_is_not_mixed_across_edges(lens):
    source = pinhole_for(BARREL)
    depth = np.full((source.height, source.width), 30.0, np.float32)
    depth[:, source.width // 2 :], depth[: source.height // 2] = 90.0, np.nan
    got = lens.warp(Rendering(np.zeros((*depth.shape, 3), np.float32), depth), source, BARREL).depth_m
    values = np.unique(np.round(got[np.isfinite(got)], 3))
    np.testing.assert_array_equal(values, [30.0, 90.0])


def test_without_distortion_nothing_changes(lens):
    camera = Camera.from_fov(64, 40, 1.0)
    rng = np.random.default_rng(0)
    view = Rendering(rng.random((40, 64, 3), np.float32) * 9, rng.uniform(5.0, 80.0, (40, 64)).astype(np.float32))
    got = lens.warp(view, pinhole_for(camera), camera)
    np.testing.assert_allclose(got.radiance, view.radiance, atol=1e-4)
    np.testing.assert_allclose(got.depth_m, view.depth_m, rtol=1e-5)


@LENSES
def test_the_pinhole_sees_every_ray_and_no_much_more(camera):
    source = pinhole_for(camera)
    pixels = source.project(camera.rays(grid(camera)))
    assert (source.fx, source.fy) == (camera.fx, camera.fy)
    assert pixels.min() >= 1.0
    assert np.all(pixels.max(axis=0) <= [source.width - 2, source.height - 2])
    spare = np.array([source.width, source.height]) - np.ptp(pixels, axis=0)
    assert np.all(spare < 8.0)


@pytest.mark.parametrize("camera", [BARREL, PINCUSHION, Camera.from_fov(77, 45, 1.5)])
def test_fast_rays_are_the_cameras(camera):
    exact = camera.rays(grid(camera)).reshape(camera.height, camera.width, 3)
    np.testing.assert_allclose(pixel_rays(camera) * camera.fx, exact * camera.fx, atol=1e-3)


def test_a_given_lens_is_kept():
    camera = Camera.from_fov(640, 360, 1.0)
    config = LensConfig(distortion=(-0.1, 0.0, 0.001, 0.0, 0.0), principal_offset_px=(3.0, -5.0))
    lens = random_lens(config, camera, np.random.default_rng(0), wide=True)
    assert lens.distortion == config.distortion
    assert (lens.cx, lens.cy) == (camera.cx + 3.0, camera.cy - 5.0)


def test_a_tiny_picture_may_have_a_lens():
    tiny = Camera(1, 1, 0.5, 0.5, 0.0, 0.0, (-0.05, 0.01, 0.0, 0.0, 0.0))
    pinhole = pinhole_for(tiny)
    assert (pinhole.width, pinhole.height, pinhole.cx, pinhole.cy) == (5, 5, 2.0, 2.0)
    line = replace(BARREL, width=7, height=1)
    at = np.column_stack([np.arange(7.0), np.zeros(7)])
    np.testing.assert_allclose(pixel_rays(line)[0], line.rays(at), rtol=1e-6)


def test_wrong_use_is_named(lens):
    with pytest.raises(ValueError, match=r"distortion \(-0\.5"):
        pinhole_for(Camera(320, 200, 100.0, 100.0, 160.0, 100.0, (-0.5, 0.0, 0.0, 0.0, 0.0)))
    view = Rendering(np.zeros((4, 5, 3), np.float32), np.zeros((4, 5), np.float32))
    with pytest.raises(ValueError, match=r"64x40 .*\(4, 5\)"):
        lens.warp(view, Camera.from_fov(64, 40, 1.0), BARREL)
    with pytest.raises(ValueError, match=r"distortion \(-0\.15"):
        lens.warp(view, BARREL, BARREL)
