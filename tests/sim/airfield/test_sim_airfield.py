"""Airfields: truth lies on what is drawn, the same configuration draws the same frame, paint follows the standard."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from deckline.labels.truth import project_line
from deckline.sim.airfield.ground import TILE, fractal_noise
from deckline.sim.airfield.picture import make_textures
from deckline.sim.airfield.runway import BARS, random_runway
from deckline.sim.config import FilmConfig, SimConfig
from deckline.sim.simulate import frames, open_simulator
from deckline.types import EdgeKind

CONFIG = SimConfig(preset="airfield", trajectory="random", frames=24, width=320, height=180, seed=4)


@pytest.fixture(scope="module")
def drawn() -> list:
    return list(frames(CONFIG))


def test_a_frame_depends_on_its_index_alone(drawn):
    with open_simulator(CONFIG) as simulator:
        again = simulator.frame(7)
    np.testing.assert_array_equal(again.image_rgb, drawn[7].image_rgb)
    assert not np.array_equal(drawn[6].image_rgb, drawn[7].image_rgb)


def test_depth_is_that_of_the_plane(drawn):
    frame = drawn[0]
    v, u = np.nonzero(np.isfinite(frame.depth_m))
    rays = frame.camera.rays(np.stack([u, v], axis=1).astype(float)) * frame.depth_m[v, u, None]
    world = frame.world_from_camera.apply(rays)
    np.testing.assert_allclose(world[:, 2], 0.0, atol=0.02 * np.abs(frame.depth_m[v, u]).max() / 100)


def test_true_lines_lie_on_painted_stripes():
    """Brightness along the true line exceeds that on both sides of it, where a stripe is wide enough to be seen."""
    config = replace(CONFIG, width=960, height=540, frames=60, seed=8)
    brighter = []
    for frame in frames(config):
        edge, truth = frame.truth.conditions.get("edge"), frame.truth
        line = None if truth.left is None else project_line(frame, truth.left)
        other = None if truth.left is None else project_line(frame, truth.right)
        if edge != EdgeKind.PAINT or line is None or other is None:
            continue
        (at, ranges), width_px = line, np.linalg.norm(line[0] - other[0], axis=1)
        seen = np.all((at > 5) & (at < [955, 535]), axis=1) & (width_px > 120) & (ranges < 1500)
        if seen.sum() < 20:
            continue
        across = (other[0] - at)[seen] / width_px[seen, None]
        grey = frame.image_rgb.mean(axis=2)
        level = [
            map_coordinates(grey, (at[seen] + step * width_px[seen, None] * across)[:, ::-1].T, order=1).mean()
            for step in (-0.06, 0.0, 0.06)
        ]
        brighter.append(level[1] > max(level[0], level[2]))
    assert len(brighter) >= 5 and np.mean(brighter) >= 0.8  # snow and night hide a few


def test_every_kind_of_edge_is_drawn():
    kinds = [random_runway(np.random.default_rng(seed)).edge for seed in range(200)]
    assert set(kinds) == set(EdgeKind)


def test_threshold_bars_fit_the_width():
    for width, count in BARS.items():
        assert count * 1.8 * 1.9 < width + 1.8  # stripes and the gaps between them, ICAO Annex 14, 5.2.4


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


def test_only_random_views():
    with pytest.raises(ValueError, match="airfield has trajectory random alone"):
        SimConfig(preset="airfield", trajectory="approach")
    with pytest.raises(ValueError, match="pad draws its own film"):
        SimConfig(preset="pad", trajectory="random", film=FilmConfig(rain_mm_h=10.0))


def test_a_foreground_hides_the_scene_and_keeps_its_truth():
    plain, behind = (next(frames(replace(CONFIG, foreground_share=share))) for share in (0.0, 1.0))
    assert not np.array_equal(plain.image_rgb, behind.image_rgb)
    np.testing.assert_array_equal(plain.depth_m, behind.depth_m)
    np.testing.assert_array_equal(plain.truth.left.p0_m, behind.truth.left.p0_m)


def test_a_pad_lies_above_the_water():
    frame = next(frames(replace(CONFIG, preset="pad")))
    assert frame.truth.left.p0_m[2] == frame.deck_z_m < 0
    assert frame.world_from_camera.translation[2] < frame.deck_z_m
