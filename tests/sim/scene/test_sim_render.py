"""The renderer: pictures, depth, labels, textures, projection."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform

from deckline.geometry import Camera, camera_mount, intersect_plane
from deckline_sim.camera.sensor import DISPLAY_GAMMA
from deckline_sim.flight.viewpoints import pose_towards
from deckline_sim.scene import gl
from deckline_sim.scene.gl import RendererError, light_from_ship, noise_field
from deckline_sim.scene.render import KEPT_TARGETS, Renderer
from deckline_sim.scene.view import Label, RenderQuality, RenderScene, sea_uniforms
from deckline_sim.scene.weather import random_weather, sun_direction
from deckline_sim.ship.deck_paint import paint_edge
from deckline_sim.ship.layout import class_layout, random_layout, world_points
from deckline_sim.ship.mesh import boxes
from deckline_sim.ship.paint_shapes import axes, layers
from deckline_sim.ship.ship import Ship
from deckline_sim.ship.ship_class import DeckSurface, load_class
from deckline_sim.ship.structure import deck_mesh

SUN = np.array([0.6, 0.0, 0.8])
CVN, PAPER = load_class("cvn"), load_class("paper")
CVN_EDGE, PAPER_EDGE = CVN.plan.edge, PAPER.plan.edge
LAYOUT = class_layout(CVN)
CAMERA = Camera.from_fov(640, 360, np.deg2rad(60.0))
CALM = replace(random_weather(np.random.default_rng(5), fair=True), wet=0.0, sun_rgb=(0.9, 0.9, 0.85))


def shown(view):
    """Levels 0..255 as a plain display shows them."""
    return 255.0 * np.clip(view.radiance, 0.0, 1.0) ** (1 / DISPLAY_GAMMA)


def clean_ship(layout, style, solids=None):
    """Nothing but the edge markings on an even dark deck, and a crate at the bow unless solids are given."""
    if solids is None:
        solids = boxes((layout.length_m - 2.0, 0.0, 0.0), (1.0, 1.0, 1.0), (0.1, 0.1, 0.1))
    surface = DeckSurface((0.1, 0.1, 0.1), grain=0.0, wear=0.0, noise_offset=(0.0, 0.0))
    coat = layers([paint_edge(layout.left_m, style), paint_edge(layout.right_m, style)])
    return Ship(layout, coat, surface, solids, 15.0, texels_per_m=12.0)


def camera_pose(layout, range_m, height_m, lateral_m, nudge=(0.0, 0.0, 0.0), look_m=40.0):
    """world_from_camera before the ramp, looking parallel to the runway before the nudge (roll, pitch, yaw)."""
    along, right, _ = axes(*layout.centre_m)
    spots = layout.centre_m[0] + lateral_m * right + np.array([[-range_m], [look_m]]) * along
    position, target = world_points(layout, spots[:1], height_m)[0], world_points(layout, spots[1:])[0]
    return pose_towards(position, target, np.array(nudge)) * camera_mount()


def test_the_water_closes_over_what_reaches_below_it(renderer):
    keel = boxes((-30.0, 0.0, 35.0), (2.0, 20.0, 25.0), (1.0, 0.0, 0.0))  # from 10 to 35 m below the deck
    renderer.load(clean_ship(LAYOUT, CVN_EDGE, keel), SUN)
    pose = camera_pose(LAYOUT, 150.0, 25.0, 0.0)
    points = world_points(LAYOUT, np.full((2, 2), [-31.0, 0.0])) + np.array([[0.0, 0.0, 19.0], [0.0, 0.0, 21.5]])
    (u, v), (u1, v1) = np.rint(CAMERA.project(pose.inv().apply(points))).astype(int)
    view = renderer.render(RenderScene(CAMERA, pose, CALM))
    assert view.radiance[v, u, 0] > 4 * view.radiance[v, u, 1]
    assert view.radiance[v1, u1, 0] < 2 * view.radiance[v1, u1, 1]
    rays = pose.rotation.apply(CAMERA.rays(np.array([[u1, v1]])))
    water = pose.inv().apply(intersect_plane(pose.translation, rays, LAYOUT.sea_z_m))[0, 2]
    assert view.depth_m[v1, u1] == pytest.approx(water, rel=1e-4)


def test_other_ships_keep_their_distance(renderer):
    other = boxes((900.0, 0.0, LAYOUT.sea_z_m), (20.0, 80.0, 60.0), (1.0, 0.0, 0.0))
    renderer.load(replace(clean_ship(LAYOUT, CVN_EDGE), background=other), SUN)
    away = RigidTransform.from_translation([5000.0, 300.0, 1.0]) * LAYOUT.world_from_ship
    pose = camera_pose(LAYOUT, 300.0, 60.0, 0.0)
    moved = RigidTransform.from_translation([5000.0, 300.0, 0.0]) * pose
    at_rest = renderer.render(RenderScene(CAMERA, pose, CALM, with_ship=False))
    elsewhere = renderer.render(RenderScene(CAMERA, moved, CALM, with_ship=False, world_from_ship=away))
    u, v = np.rint(CAMERA.project(pose.inv().apply([[890.0, 0.0, LAYOUT.sea_z_m - 50.0]])))[0].astype(int)
    other_at = np.abs(at_rest.depth_m - at_rest.depth_m[v, u]) < 15.0
    assert 1150.0 < at_rest.depth_m[v, u] < 1210.0
    assert other_at.sum() > 50
    np.testing.assert_allclose(elsewhere.depth_m[other_at], at_rest.depth_m[other_at], rtol=1e-4)


def test_lamps_shine_when_lit_and_not_through_solids(renderer):
    spot = LAYOUT.centre_m[0] + 60.0 * axes(*LAYOUT.centre_m)[0]
    lights = np.array([[*spot, -0.5, 0.0, 1.0, 0.0, 1.0]], dtype=np.float32)
    pose, seen = camera_pose(LAYOUT, 100.0, 20.0, 0.0), []
    (u, v), *_ = np.rint(CAMERA.project(pose.inv().apply(world_points(LAYOUT, spot[None], 0.5)))).astype(int)
    wall = boxes((spot[0] - 20.0, spot[1] + 3.0, 0.0), (1.0, 20.0, 20.0), (0.3, 0.3, 0.3))
    for lamps, solids in ((0.0, None), (1.0, None), (1.0, wall)):
        renderer.load(replace(clean_ship(LAYOUT, CVN_EDGE, solids), lights=lights), SUN)
        view = renderer.render(RenderScene(CAMERA, pose, replace(CALM, lamps=lamps)))
        red, green, _ = view.radiance[v - 1 : v + 2, u - 1 : u + 2].sum(axis=(0, 1))
        seen.append(green - red)
    assert seen[1] > seen[0] + 0.5
    assert seen[2] < seen[0] + 0.1


def test_land_lies_around_a_runway_on_land(renderer):
    weather = replace(CALM, ground_rgb=(0.5, 0.4, 0.1), field_rgb=(0.5, 0.4, 0.1), fade_m=1e6)
    layout = class_layout(load_class("runway"))
    renderer.load(clean_ship(layout, CVN_EDGE), SUN)
    pose = camera_pose(layout, 300.0, 60.0, 0.0)
    land = renderer.render(RenderScene(CAMERA, pose, weather, with_ship=False))
    below = land.radiance[340:]
    assert np.median(below[..., 0]) > 4 * np.median(below[..., 2])
    assert np.isfinite(land.depth_m[340:]).all()


def test_one_sample_leaves_edges_jagged_and_the_rest_alone(renderer):
    wall = boxes((40.0, 0.0, 0.0), (1.0, 20.0, 12.0), (1.0, 0.0, 0.0))
    renderer.load(clean_ship(LAYOUT, CVN_EDGE, wall), SUN)
    pose = camera_pose(LAYOUT, 30.0, 10.0, 0.0, nudge=(0.1, 0.0, 0.0))
    smooth, jagged = (
        shown(renderer.render(RenderScene(CAMERA, pose, CALM, quality=RenderQuality(samples=n)))) for n in (4, 1)
    )
    changed = np.abs(smooth.astype(int) - jagged).max(axis=2) > 8
    assert 0 < changed.mean() < 0.03


def test_the_deck_is_all_of_its_outline_and_faces_up():
    for layout in (LAYOUT, class_layout(PAPER), *(random_layout(np.random.default_rng(k)) for k in range(5))):
        mesh = deck_mesh(layout)
        np.testing.assert_allclose(mesh[:, 3:6], np.broadcast_to([0.0, 0.0, -1.0], (len(mesh), 3)), atol=1e-6)
        corners = mesh[:, :3].reshape(-1, 3, 3).astype(float)
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
        assert area == pytest.approx(np.trapezoid(layout.starboard_m - layout.port_m, layout.stations_m), rel=1e-6)
        assert len(corners) < 2 * len(layout.stations_m) - 2


@pytest.mark.parametrize("level", [0.2, 1.0])
def test_a_deck_in_daylight_reflects_its_display_colour_in_linear_light(renderer, level):
    surface = DeckSurface((level,) * 3, 0.0, 0.0, (0.0, 0.0))
    renderer.load(replace(clean_ship(LAYOUT, CVN_EDGE), surface=surface), SUN)
    pose = camera_pose(LAYOUT, 30.0, 40.0, 0.0, look_m=80.0)
    seen = renderer.render(RenderScene(CAMERA, pose, CALM)).radiance[120:240, 280:360].reshape(-1, 3)
    light = np.array(CALM.ambient_rgb) + 0.8 * np.array(CALM.sun_rgb) + CALM.flood_rgb
    srgb = ((level + 0.055) / 1.055) ** 2.4
    np.testing.assert_allclose(np.median(seen, axis=0), srgb * light, rtol=1e-2)


@pytest.mark.parametrize("elevation_deg", [25.0, 45.0])
def test_shadow_is_as_long_as_the_sun_is_low(renderer, elevation_deg):
    layout, height = class_layout(CVN), 12.0
    crate = boxes((80.0, -10.0, 0.0), (6.0, 6.0, height), (0.5, 0.5, 0.5))
    elevation = np.deg2rad(elevation_deg)
    sun = np.array([0.0, np.cos(elevation), np.sin(elevation)])  # light travels to starboard
    weather = replace(CALM, sun_rgb=(1.0, 1.0, 1.0), shadow=1.0)
    bare = replace(clean_ship(layout, CVN_EDGE, crate), coat=layers([]))
    renderer.load(bare, sun)
    pose = camera_pose(layout, -60.0, 70.0, 0.0, look_m=81.0)
    across = np.arange(-30.0, 30.0, 0.1)
    points = world_points(layout, np.column_stack([np.full_like(across, 80.0), across]))
    pixels = np.rint(CAMERA.project(pose.inv().apply(points))).astype(int)
    level = renderer.render(RenderScene(CAMERA, pose, weather)).radiance[pixels[:, 1], pixels[:, 0]].mean(axis=1)
    lit = level[across > 25.0].mean()
    dark = (level < 0.6 * lit) & (across > -6.5)
    np.testing.assert_allclose(level[across < -18.0], lit, rtol=0.02)  # towards the sun
    assert across[dark].max() == pytest.approx(-7.0 + height / np.tan(elevation), abs=0.5)
    assert dark[(across > -6.0) & (across < -7.5 + height / np.tan(elevation))].all()
    even = renderer.render(RenderScene(CAMERA, pose, replace(weather, shadow=0.0))).radiance[pixels[:, 1], pixels[:, 0]]
    np.testing.assert_allclose(even[across > -6.0], np.broadcast_to(even[-1], even[across > -6.0].shape), rtol=1e-3)


def test_light_is_not_clipped(renderer):
    renderer.load(clean_ship(LAYOUT, CVN_EDGE), SUN)
    pose = pose_towards(np.array([-300.0, 0.0, -50.0]), np.array([-300.0 - 60.0, 0.0, -50.0 - 80.0]), np.zeros(3))
    view = renderer.render(RenderScene(CAMERA, pose * camera_mount(), replace(CALM, cloud_cover=0.0, sun_disc=30.0)))
    assert view.radiance.max() > 5.0
    assert np.isnan(view.depth_m).all()
    blinding = renderer.render(RenderScene(CAMERA, pose * camera_mount(), replace(CALM, cloud_cover=0.0, sun_disc=1e9)))
    assert np.isfinite(blinding.radiance).all()


def test_wrong_use_is_named(renderer):
    renderer.load(clean_ship(LAYOUT, CVN_EDGE), SUN)
    pose = camera_pose(LAYOUT, 100.0, 10.0, 0.0)
    with pytest.raises(ValueError, match=r"\(0\.1, 0"):
        renderer.render(RenderScene(replace(CAMERA, distortion=(0.1, 0.0, 0.0, 0.0, 0.0)), pose, CALM))
    with pytest.raises(ValueError, match=r"0\.00 m.*10\.00 m"):
        renderer.render(RenderScene(CAMERA, camera_pose(LAYOUT, 100.0, -30.0, 0.0), CALM))


def test_missing_egl_names_the_packages(monkeypatch):
    def refuse(**_):
        raise Exception("libEGL.so not loaded")

    monkeypatch.setattr(gl.moderngl, "create_context", refuse)
    with pytest.raises(RendererError, match=r"libEGL.so.*libegl1 libgl1-mesa-dri libegl-mesa0"):
        gl.open_context()


def test_two_renderers_do_not_disturb_each_other(renderer):
    layout = class_layout(PAPER)
    ship, pose = clean_ship(layout, PAPER_EDGE), camera_pose(layout, 80.0, 15.0, 0.0)
    renderer.load(ship, SUN)
    alone = renderer.render(RenderScene(CAMERA, pose, CALM))
    with Renderer() as other:
        other.load(ship, -SUN * [1, 1, -1])
        between = other.render(RenderScene(CAMERA, pose, CALM))
        again = renderer.render(RenderScene(CAMERA, pose, CALM))
    after = renderer.render(RenderScene(CAMERA, pose, CALM))
    for view in (again, after):
        np.testing.assert_array_equal(view.radiance, alone.radiance)
        np.testing.assert_array_equal(view.depth_m, alone.depth_m)
    np.testing.assert_array_equal(between.depth_m, alone.depth_m)
    assert np.abs(between.radiance - alone.radiance).max() > 0.01


def test_frame_buffers_of_old_sizes_are_given_back(renderer):
    layout = class_layout(PAPER)
    renderer.load(clean_ship(layout, PAPER_EDGE), SUN)
    pose = camera_pose(layout, 80.0, 15.0, 0.0)
    for width in range(64, 64 + 2 * KEPT_TARGETS):
        assert renderer.render(RenderScene(Camera.from_fov(width, 36, 1.0), pose, CALM)).depth_m.shape == (36, width)
    assert len(renderer.targets) == KEPT_TARGETS


def test_labels_name_the_surface_of_the_depth(renderer):
    layout = class_layout(PAPER).at_pose(
        RigidTransform.from_translation([3.0, 0.0, -1.0]) * class_layout(PAPER).world_from_ship
    )
    renderer.load(clean_ship(class_layout(PAPER), PAPER_EDGE), SUN)
    seen_from = camera_pose(layout, 60.0, 15.0, 5.0, nudge=(0.1, -0.1, 0.0))
    where = layout.world_from_ship
    depth = renderer.render(RenderScene(CAMERA, seen_from, CALM, world_from_ship=where)).depth_m
    labels = renderer.labels(RenderScene(CAMERA, seen_from, CALM, world_from_ship=where))
    assert labels.dtype == np.uint8 and labels.shape == depth.shape
    assert set(np.unique(labels)) == {Label.SKY, Label.SURFACE, Label.DECK, Label.STRUCTURE}
    np.testing.assert_array_equal(labels == Label.SKY, np.isnan(depth))
    rays = CAMERA.rays(np.argwhere(labels > Label.SKY)[:, ::-1].astype(float))
    near = depth[labels > Label.SKY] < 1000.0  # farther away single precision makes more than a centimetre
    points = seen_from.apply(rays * depth[labels > Label.SKY][:, None])[near]
    kinds = labels[labels > Label.SKY][near]
    np.testing.assert_allclose(points[kinds == Label.SURFACE, 2], layout.sea_z_m, atol=0.01)
    np.testing.assert_allclose(where.inv().apply(points[kinds == Label.DECK])[:, 2], 0.0, atol=0.01)
    crate = where.inv().apply(points[kinds == Label.STRUCTURE])
    assert np.all(np.abs(crate[:, 0] - (layout.length_m - 2.0)) < 1.01)
    again = renderer.render(RenderScene(CAMERA, seen_from, CALM, world_from_ship=where)).depth_m
    np.testing.assert_array_equal(again, depth)


@given(st.integers(0, 2**32 - 1))
def test_every_caster_lies_on_the_map_and_light_runs_along_its_depth(seed):
    rng = np.random.default_rng(seed)
    sun, points = sun_direction(rng), rng.uniform(-200.0, 200.0, (30, 3))
    matrix = light_from_ship(sun, points)
    spots = points @ matrix[:3, :3].T + matrix[:3, 3]
    assert np.all((spots > 0.0) & (spots < 1.0))
    step = matrix[:3, :3] @ sun
    np.testing.assert_allclose(step[:2], 0.0, atol=1e-12)
    assert step[2] > 0


def test_a_sun_along_the_ship_is_no_exception():
    matrix = light_from_ship(np.array([1.0, 0.0, 0.0]), np.eye(3))
    assert np.all(np.isfinite(matrix))
    assert np.linalg.matrix_rank(matrix) == 4


def test_noise_is_tileable_and_centred():
    noise = noise_field(64).astype(float)
    np.testing.assert_allclose(noise.mean(axis=(0, 1)), 127.5, atol=2.0)
    inner = np.abs(np.diff(noise, axis=0)).mean()
    assert np.abs(noise[0] - noise[-1]).mean() < 1.5 * inner


def test_long_waves_run_faster():
    weather = random_weather(np.random.default_rng(0))
    drift = np.array(sea_uniforms(weather, 2.0)["drift_m"])
    assert drift[0] > drift[1] > drift[2] > 0
    assert drift[0] == pytest.approx(2.0 * np.sqrt(9.81 * weather.wave_length_m / (2 * np.pi)))
    assert sea_uniforms(weather, 0.0)["drift_m"] == [0.0] * 4
