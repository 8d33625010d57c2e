"""Airfields: truth lies on what is drawn, the same configuration draws the same frame, paint follows the standard."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from deckline.recording.images import encode_image
from deckline.types import EdgeKind
from deckline_sim.airfield.ground import TILE, GroundCamera, fractal_noise
from deckline_sim.airfield.land_runway import BARS, random_runway
from deckline_sim.airfield.picture import lay_coat, make_textures
from deckline_sim.config import DepthConfig, ExposureConfig, SimConfig
from deckline_sim.ship.paint_shapes import polygons
from deckline_sim.simulate import frames, open_simulator
from deckline_sim.visible_line import find_visible_line, project_line

LEVEL = np.array([[0.0, 1, 0], [0, 0, -1], [1, 0, 0]])  # axes of a camera that looks along x
FAR = DepthConfig(range_m=np.inf)
CONFIG = SimConfig(preset="airfield", trajectory="random", frames=16, width=320, height=180, seed=4, depth=FAR)


@pytest.fixture(scope="module")
def drawn() -> list:
    return list(frames(CONFIG))


def test_a_frame_depends_on_its_index_alone(drawn):
    with open_simulator(CONFIG) as simulator:
        again = simulator.frame(7)
    np.testing.assert_array_equal(again.image_rgb, drawn[7].image_rgb)
    assert not np.array_equal(drawn[6].image_rgb, drawn[7].image_rgb)


def heights_m(frame, v, u):
    """Heights above the plane of what pixels show, over their depth."""
    rays = frame.camera.rays(np.stack([u, v], axis=1).astype(float)) * frame.depth_m[v, u, None]
    return -frame.world_from_camera.apply(rays)[:, 2] / frame.depth_m[v, u]


def test_depth_is_that_of_the_plane_and_of_what_stands_on_it(drawn):
    """Hills fill some of the sky."""
    ground = [heights_m(frame, *np.nonzero(frame.depth_m < 3000)) for frame in drawn]
    on_plane = [np.mean(np.abs(heights) < 1e-3) for heights in ground]
    assert np.median(on_plane) > 0.97 and 0.5 < min(on_plane) < 1.0


def test_depth_of_a_pad_is_the_range_of_its_lines():
    """Whatever stands on the deck apart, at the pixel of a point of a line lies what the line's own range says."""
    errors = []
    for frame in frames(replace(CONFIG, preset="pad", frames=12)):
        for segment in (frame.truth.left, frame.truth.right):
            pixels, ranges = project_line(frame, segment)
            inside = np.all((pixels > 1) & (pixels < [318, 178]), axis=1)
            at = np.rint(pixels[inside]).astype(int)
            length = frame.camera.ray_lengths()[at[:, 1], at[:, 0]]
            errors.append(frame.depth_m[at[:, 1], at[:, 0]] * length / ranges[inside] - 1)
    assert np.median(np.abs(np.concatenate(errors))) < 0.01
    assert np.quantile(np.abs(np.concatenate(errors)), 0.9) < 0.05  # a pixel's width, crew and crates


def test_the_depth_camera_has_its_range(drawn):
    near = next(frames(replace(CONFIG, depth=DepthConfig(range_m=300.0))))
    np.testing.assert_array_equal(near.depth_m, np.where(drawn[0].depth_m <= 300, drawn[0].depth_m, np.nan))
    assert not np.isinf(drawn[0].depth_m).any()


@pytest.mark.parametrize("side_m", [20.0, 5000.0])
def test_a_polygon_that_leaves_the_picture_keeps_its_edges(side_m):
    """A strip from far behind the camera to far ahead is painted where the ground says, and nowhere else."""
    viewer = GroundCamera(320, 180, 300.0, np.array([0.0, 12.0, 9.0]), LEVEL)
    rays = viewer.rays()
    along = np.where(rays[..., 2] < 0, 9.0 / np.maximum(-rays[..., 2], 1e-6), np.inf)
    points = (viewer.position_m[:2] + rays[..., :2] * np.minimum(along, 1e5)[..., None]).astype(np.float32)
    image = np.zeros((180, 320, 3), np.float32)
    strip = polygons([[-4000, -side_m], [4000, -side_m], [4000, side_m], [-4000, side_m]], [1.0, 1.0, 1.0])
    lay_coat(image, viewer, strip, points, np.zeros((TILE, TILE), np.float32), 0.0, np.random.default_rng(0))
    inside = (np.abs(points[..., 1]) < side_m) & (points[..., 0] < 4000) & (along < 1e5)
    clear = cv2.blur(inside.astype(np.float32), (3, 3))
    np.testing.assert_allclose(image[clear == 1], 255, atol=1)
    np.testing.assert_allclose(image[clear == 0], 0, atol=1)


def test_nothing_hides_a_runway(drawn):
    for frame in drawn:
        for segment in filter(None, (frame.truth.left, frame.truth.right)):
            line = find_visible_line(frame, segment)
            if line is not None:
                u, v = np.rint(line.points_px[line.ranges_m < 5000]).astype(int).T
                near = np.nonzero(frame.depth_m[v, u] < 5000)  # a line that ends at the horizon has sky beside it
                np.testing.assert_allclose(heights_m(frame, v[near], u[near]), 0, atol=1e-3)


def test_true_lines_lie_on_painted_stripes():
    """Brightness along the true line exceeds that on both sides of it, where a stripe is wide enough to be seen."""
    with open_simulator(replace(CONFIG, width=960, height=540, frames=60, seed=8)) as simulator:
        for index in (10, 15, 27, 41, 48, 53):  # from near by, with painted stripes
            frame = simulator.frame(index)
            (at, ranges), (other, _) = (project_line(frame, line) for line in (frame.truth.left, frame.truth.right))
            width_px = np.linalg.norm(at - other, axis=1)
            seen = np.all((at > 5) & (at < [955, 535]), axis=1) & (width_px > 120) & (ranges < 1500)
            across = (other - at)[seen]
            grey = frame.image_rgb.mean(axis=2)
            before, on, after = (
                map_coordinates(grey, (at[seen] + step * across)[:, ::-1].T, order=1).mean()
                for step in (-0.06, 0.0, 0.06)
            )
            assert frame.truth.conditions["edge"] == EdgeKind.PAINT and seen.sum() >= 20
            assert on > max(before, after) + 20


def test_every_kind_of_edge_is_drawn():
    kinds = [random_runway(np.random.default_rng(seed)).edge for seed in range(200)]
    assert set(kinds) == set(EdgeKind)


def test_paint_lies_on_the_pavement():
    runways = [random_runway(np.random.default_rng(seed)) for seed in range(300)]
    assert {runway.width_m for runway in runways} == set(BARS)
    for runway in runways:
        assert np.all(np.abs(runway.paint[:, 1]) <= runway.width_m / 2 + 1e-3)


def test_edge_lines_end_with_what_is_drawn_of_them():
    for runway in (random_runway(np.random.default_rng(seed)) for seed in range(100)):
        (start, end), half = runway.span_m, runway.half_m
        if runway.edge == EdgeKind.PAVEMENT:
            x = runway.pavement[np.abs(np.abs(runway.pavement[:, 1]) - half) < 1e-3, 0]
        elif runway.edge == EdgeKind.PAINT:
            triangles = runway.paint.reshape(-1, 3, 7)
            x = triangles[np.ptp(triangles[..., 0], axis=1) > 300, :, 0]  # nothing else is as long as side stripes
        else:
            x = runway.lights_m[np.abs(np.abs(runway.lights_m[:, 1]) - half) < 1e-3, 0]
        assert start - 2.5 <= x.min() <= start + 1e-3 and x.max() == pytest.approx(end, abs=1e-2)


def test_textures_repeat_and_have_unit_spread():
    photograph = np.random.default_rng(1).integers(0, 255, (400, 500, 3), dtype=np.uint8)
    tiles = make_textures(np.random.default_rng(0), [photograph, photograph[:100]])
    assert {tile.shape for tile in tiles} == {(TILE, TILE)}
    noise = fractal_noise(np.random.default_rng(2))
    assert noise.mean() == pytest.approx(0, abs=1e-3) and noise.std() == pytest.approx(1, rel=1e-3)


def test_haze_keeps_the_clear_picture():
    frame = next(frames(replace(CONFIG, visibility_m=(500.0, 500.0))))
    assert frame.truth.visibility_m == 500.0
    assert frame.truth.clear_rgb is not None and not np.array_equal(frame.truth.clear_rgb, frame.image_rgb)


def test_a_folder_without_usable_photographs(tmp_path):
    (tmp_path / "small.png").write_bytes(encode_image(np.zeros((20, 20, 3), np.uint8), "png"))
    with pytest.raises(ValueError, match="256 px"):
        open_simulator(replace(CONFIG, photographs=str(tmp_path)))


def test_what_is_not_drawn_is_refused():
    with pytest.raises(ValueError, match=r"airfield .*'approach'"):
        SimConfig(preset="airfield", trajectory="approach")
    given = {"exposure": ExposureConfig(rain_mm_h=10.0), "fov_deg": 60.0, "range_m": (100.0, 200.0), "end_m": 20.0}
    for name, value in given.items():
        with pytest.raises(ValueError, match=f"pad .*{name}"):
            SimConfig(preset="pad", trajectory="random", **{name: value})
    with pytest.raises(ValueError, match=r"photographs .*'train'"):
        SimConfig(preset="train", photographs="pictures")


def test_a_foreground_hides_the_scene_and_keeps_its_truth():
    plain, behind = (next(frames(replace(CONFIG, foreground_share=share))) for share in (0.0, 1.0))
    assert not np.array_equal(plain.image_rgb, behind.image_rgb)
    np.testing.assert_array_equal(plain.depth_m, behind.depth_m)
    np.testing.assert_array_equal(plain.truth.left.p0_m, behind.truth.left.p0_m)
    np.testing.assert_array_equal(behind.truth.clear_rgb, plain.image_rgb)  # in clear air too
    assert plain.truth.clear_rgb is None
    assert next(frames(replace(CONFIG, foreground_share=1.0, keep_clear=False))).truth.clear_rgb is None


def test_a_pad_lies_above_the_water():
    frame = next(frames(replace(CONFIG, preset="pad")))
    assert frame.truth.left.p0_m[2] == frame.deck_z_m < 0
    assert frame.world_from_camera.translation[2] < frame.deck_z_m
