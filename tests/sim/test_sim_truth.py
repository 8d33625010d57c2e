"""True lines and surfaces lie where rendered pixels show them."""

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from pixel_truth import Shot, deck_and_sea, local_means, middle_offsets, moved_ship, recorded, sight_lines, turn

from deckline.geometry import Camera
from deckline_sim.camera.lens import Lens, pinhole_for
from deckline_sim.camera.sensor import DISPLAY_GAMMA
from deckline_sim.config import DRAWN, Preset, SimConfig
from deckline_sim.flight.viewpoints import ShipMotion, pose_towards, ship_pose
from deckline_sim.scene.view import RenderScene
from deckline_sim.scene.weather import random_weather
from deckline_sim.ship.deck_paint import paint_edge
from deckline_sim.ship.mesh import boxes
from deckline_sim.ship.paint_shapes import layers
from deckline_sim.ship.random_plan import random_edge
from deckline_sim.ship.ship import build_ship
from deckline_sim.ship.ship_class import SHIP_CLASSES, DeckSurface, load_class
from deckline_sim.simulate import frames

SUN = np.array([0.6, 0.0, 0.8])
CALM = replace(random_weather(np.random.default_rng(5), fair=True), wet=0.0)
RANDOM_SHIPS = tuple(f"train {seed}" for seed in range(2))
SIZE = (640, 360)
RANGES_M = (25.0, 120.0, 500.0)
FOVS_DEG = (70.0, 36.0, 12.0)  # one for each range
BARREL = (-0.18, 0.05, 0.002, -0.001, 0.0)  # at a corner of 1; scaled to the view's corner
SWING = ShipMotion(speed_m_s=12.9, roll_rad=0.0251, pitch_rad=0.0216, heave_m=1.63, phases_rad=(0.7, 1.9, 4.0))
TIME_S = 3.0


def clean(ship, style):
    """The ship with nothing but its edge markings on an even dark deck, and a crate at the bow."""
    layout = ship.layout
    coat = layers([paint_edge(line, style) for line in (layout.left_m, layout.right_m)])
    surface = DeckSurface((0.15, 0.15, 0.15), grain=0.0, wear=0.0, noise_offset=(0.0, 0.0))
    return replace(bare(ship), coat=coat, surface=surface)


def bare(ship):
    """The ship with all its paint and no solids but a crate at the bow."""
    crate = boxes((ship.layout.length_m - 2.0, 0.0, 0.0), (1.0, 1.0, 1.0), (0.1, 0.1, 0.1))
    return replace(ship, solids=crate, lights=ship.lights[:0], background=ship.background[:0])


def edge_style(name):
    style = load_class(name).plan.edge if name in SHIP_CLASSES else random_edge(np.random.default_rng(int(name[-1])))
    return replace(style, opacity=1.0, smear=0.0, rgb=(0.86, 0.87, 0.88))


def built(name):
    preset, _, seed = name.partition(" ")
    return build_ship(preset, np.random.default_rng(int(seed or 0)))


def shoot(renderer, ship, range_m, fov_deg, moving, distorted):
    """The loaded ship from before its ramp, 5 m to the right, rolled a little."""
    layout, motion = ship.layout, SWING if moving and not ship.layout.on_land else ShipMotion()
    there = moved_ship(layout, motion, TIME_S)
    ramp = layout.centre_m[0]
    delta = layout.centre_m[1] - ramp
    along, right = delta / np.hypot(*delta), np.array([-delta[1], delta[0]]) / np.hypot(*delta)
    height = 4.0 + 0.07 * (range_m + 70.0)
    eye, target = ((there @ [*(ramp + s * along + t * right), -up, 1.0])[:3]
                   for s, t, up in ((-range_m, 5.0, height), (40.0, 0.0, 0.0)))  # fmt: skip
    view = pose_towards(eye, target, np.deg2rad([4.0, 0.0, 1.0]))
    axes_of_body = turn("z", np.pi / 2) @ turn("x", np.pi / 2)  # optical x, y, z are the body's y, z, x
    camera = Camera.from_fov(*SIZE, np.deg2rad(fov_deg))
    if distorted:
        corner2 = (SIZE[0] / camera.fx / 2) ** 2 + (SIZE[1] / camera.fy / 2) ** 2
        k1, k2, p1, p2, k3 = BARREL
        lens = (k1 / corner2, k2 / corner2**2, p1 / corner2**0.5, p2 / corner2**0.5, k3)
        camera = replace(camera, distortion=lens, cx=camera.cx + 7.3, cy=camera.cy - 4.6)
    return take(renderer, layout, motion, camera, view, axes_of_body)


def take(renderer, layout, motion, camera, world_from_body, body_from_optical):
    """A picture through the renderer and the lens."""
    matrix = np.eye(4)
    matrix[:3, :3] = world_from_body.rotation.as_matrix() @ body_from_optical
    matrix[:3, 3] = world_from_body.translation
    source = pinhole_for(camera)
    posed = ship_pose(layout, motion, TIME_S)
    view = renderer.render(RenderScene(source, type(posed).from_matrix(matrix), CALM, TIME_S, world_from_ship=posed))
    if camera.has_distortion:
        view = Lens(renderer.context).warp(view, source, camera)
    grey = 255.0 * np.clip(view.radiance.mean(axis=2), 0.0, 1.0) ** (1 / DISPLAY_GAMMA)
    return Shot(grey.astype(float), view.depth_m, camera, matrix, moved_ship(layout, motion, TIME_S), layout)


CASES = pytest.mark.parametrize(
    ("moving", "distorted"), [(False, False), (True, True)], ids=["still pinhole", "moving lens"]
)
SHIPS = pytest.mark.parametrize("name", SHIP_CLASSES + RANDOM_SHIPS)


@CASES
@SHIPS
def test_the_middle_of_the_paint_is_the_true_line(renderer, name, moving, distorted):
    style, ship = edge_style(name), built(name)
    renderer.load(clean(ship, style), SUN)
    places = 0
    for range_m, fov_deg in zip(RANGES_M, FOVS_DEG, strict=True):
        shot = shoot(renderer, ship, range_m, fov_deg, moving, distorted)
        for line in (ship.layout.left_m, ship.layout.right_m):
            offsets = middle_offsets(shot, line, style.width_m / 2)
            places += len(offsets)
            assert len(offsets) > 20  # dashes far away stand close
            assert np.abs(local_means(offsets)).max() < 0.4
            assert abs(offsets.mean()) < 0.2  # paint is drawn in texels of up to 3 px with four samples each
            assert np.percentile(np.abs(offsets), 80) < 0.5
            if name in SHIP_CLASSES and not distorted:
                assert abs(np.median(offsets)) < 0.1
                assert np.percentile(np.abs(offsets), 99) < 0.5
    assert places > 300


def test_a_line_half_a_metre_off_is_noticed(renderer):
    style, ship = edge_style("cvn"), built("cvn")
    layout = replace(ship.layout, left_m=ship.layout.left_m + np.array([0.0, 0.5]))
    renderer.load(clean(replace(ship, layout=layout), style), SUN)
    shot = shoot(renderer, ship, RANGES_M[1], FOVS_DEG[1], True, True)
    moved = middle_offsets(shot, ship.layout.left_m, style.width_m / 2)
    px_per_m = shot.camera.fx / (RANGES_M[1] + 110.0)  # at the line's middle
    assert np.median(moved) == pytest.approx(0.5 * px_per_m, rel=0.3)


@CASES
@pytest.mark.parametrize("name", SHIP_CLASSES)
def test_depth_is_the_distance_to_deck_and_sea(renderer, name, moving, distorted):
    ship = built(name)
    renderer.load(clean(ship, edge_style(name)), SUN)
    for range_m, fov_deg in ((40.0, 80.0), (200.0, 25.0)):
        shot = shoot(renderer, ship, range_m, fov_deg, moving, distorted)
        v, u = np.mgrid[3 : SIZE[1] : 7, 4 : SIZE[0] : 11].reshape(2, -1)
        got = shot.depth[v, u]
        deck, sea = deck_and_sea(shot, np.column_stack([u, v]).astype(float))
        assert min(np.isfinite(deck).sum(), np.isfinite(sea).sum()) > 40
        upwards = (sight_lines(shot.camera, np.column_stack([u, v])) @ shot.world_from_camera[2, :3]) < -0.01
        assert np.isnan(got[upwards & np.isnan(deck)]).sum() > 40  # the sky has none
        tolerance = 1e-3 if distorted else 3e-5  # the lens interpolates between the pinhole's pixels
        for expected in (deck, sea):
            there = np.isfinite(expected)
            np.testing.assert_allclose(got[there], expected[there], rtol=tolerance)


@pytest.mark.parametrize("preset", sorted({*get_args(Preset)} - {"train", *DRAWN}))
def test_recorded_pictures_show_the_lines_where_their_truth_has_them(renderer, preset):
    config = SimConfig(
        preset, "random", frames=5, seed=3, width=SIZE[0], height=SIZE[1], fov_deg=40.0, range_m=(50, 300)
    )
    half_width, found = load_class(preset).plan.edge.width_m / 2, {"left": [], "right": []}
    for frame in frames(config):
        shot = recorded(frame)
        for side, offsets in found.items():
            segment = getattr(frame.truth, side)
            line = (np.linalg.inv(shot.world_from_ship) @ np.array([[*segment.p0_m, 1.0], [*segment.p1_m, 1.0]]).T).T
            np.testing.assert_allclose(line[:, 2], 0.0, atol=1e-6)
            offsets.extend(middle_offsets(shot, line[:, :2], half_width))
    for offsets in found.values():
        assert len(offsets) > 150
        assert abs(np.median(offsets)) < 0.25
        assert np.percentile(np.abs(offsets), 75) < 0.5
