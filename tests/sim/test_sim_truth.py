"""Where the true lines and surfaces are in rendered pixels, by a camera, poses and planes computed here."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from deckline.geometry import Camera
from deckline.sim.layout import Layout
from deckline.sim.lens import Lens, pinhole_for
from deckline.sim.markings import edge_coat, random_edge
from deckline.sim.mesh import box
from deckline.sim.motion import Motion, ship_pose
from deckline.sim.paint import layers
from deckline.sim.plan import DeckSurface
from deckline.sim.sensor import DISPLAY_GAMMA
from deckline.sim.ship import build_ship
from deckline.sim.ship_class import SHIP_CLASSES, load_class
from deckline.sim.viewpoint import looking
from deckline.sim.weather import random_weather

SUN = np.array([0.6, 0.0, 0.8])
CALM = replace(random_weather(np.random.default_rng(5), fair=True), wet=0.0)
RANDOM_SHIPS = tuple(f"train {seed}" for seed in range(5))
SIZE = (640, 360)
RANGES_M = (25.0, 120.0, 500.0)
FOVS_DEG = (70.0, 36.0, 12.0)  # one for each range
BARREL = (-0.18, 0.05, 0.002, -0.001, 0.0)  # at a corner of 1; scaled to the view's corner
SWING = Motion(speed_m_s=12.9, roll_rad=0.0251, pitch_rad=0.0216, heave_m=1.63, phases_rad=(0.7, 1.9, 4.0))
TIME_S = 3.0
CONTRAST = 10.0  # grey levels that paint must stand out
NEIGHBOURS = 10  # places averaged
PART_M = 260.0  # of a line that is looked at
LOW, HIGH = 0.3, 0.7  # of a profile's range: darker is deck, lighter is paint


@dataclass(frozen=True, eq=False)
class Shot:
    """One picture, and all that is needed to say where things are in it."""

    image: np.ndarray  # (H, W) grey levels
    depth: np.ndarray  # (H, W)
    camera: Camera
    world_from_camera: np.ndarray  # (4, 4)
    world_from_ship: np.ndarray  # (4, 4)
    layout: Layout


def turn(axis, angle):
    """Rotation matrix about x, y or z."""
    a, b = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    out = np.eye(3)
    out[a, a] = out[b, b] = np.cos(angle)
    out[b, a], out[a, b] = np.sin(angle), -np.sin(angle)
    return out


def moved_ship(layout, motion, time_s):
    """world_from_ship (4, 4) of a ship that sails, heaves, and rolls and pitches about its middle at the waterline."""
    x, y, z, w = layout.world_from_ship.rotation.as_quat()
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    roll, pitch, heave = (
        size * np.sin(2 * np.pi * time_s / period + phase)
        for size, period, phase in zip(
            (motion.roll_rad, motion.pitch_rad, motion.heave_m), (22.0, 12.0, 18.0), motion.phases_rad, strict=True
        )
    )
    middle = np.array([layout.length_m / 2, 0.0, layout.deck_height_m])
    rotation = turn("z", yaw) @ turn("y", pitch) @ turn("x", roll)
    at_rest = np.array(layout.world_from_ship.translation)
    sailed = motion.speed_m_s * time_s * np.array([np.cos(yaw), np.sin(yaw), 0.0])
    pivot = at_rest + turn("z", yaw) @ middle + sailed - [0.0, 0.0, heave]
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation, pivot - rotation @ middle
    return out


def project(camera, points):
    """Pixels (N, 2) of points (N, 3) of the optical frame by Brown's lens."""
    x, y = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2]
    k1, k2, p1, p2, k3 = camera.distortion
    r2 = x**2 + y**2
    bulge = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    u = x * bulge + 2 * p1 * x * y + p2 * (r2 + 2 * x**2)
    v = y * bulge + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y
    return np.column_stack([camera.fx * u + camera.cx, camera.fy * v + camera.cy])


def sight_lines(camera, pixels):
    """Rays (N, 3) with z = 1 that `project` sends to pixels (N, 2), by Newton's method with a numerical Jacobian."""
    xy = (pixels - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
    step = 1e-6

    def through(values):
        return project(camera, np.column_stack([values, np.ones(len(values))]))

    for _ in range(8):
        here = through(xy)
        jacobian = np.stack([(through(xy + shift) - here) / step for shift in np.eye(2) * step], axis=-1)
        xy = xy + np.linalg.solve(jacobian, (pixels - here)[..., None])[..., 0]
    return np.column_stack([xy, np.ones(len(xy))])


def deck_pixels(shot, points):
    """Pixels (N, 2) of deck points (N, 2) of the ship frame, NaN behind the camera."""
    flat = np.column_stack([points, np.zeros(len(points)), np.ones(len(points))])
    optical = (np.linalg.inv(shot.world_from_camera) @ shot.world_from_ship @ flat.T).T[:, :3]
    optical[optical[:, 2] < 1.0] = np.nan
    return project(shot.camera, optical)


def grey_at(image, pixels):
    """Bilinear grey levels (N,) of an image (H, W) at pixels (N, 2), all of them inside."""
    u0, v0 = np.floor(pixels).astype(int).T
    fu, fv = (pixels - np.floor(pixels)).T
    top = image[v0, u0] * (1 - fu) + image[v0, u0 + 1] * fu
    bottom = image[v0 + 1, u0] * (1 - fu) + image[v0 + 1, u0 + 1] * fu
    return top * (1 - fv) + bottom * fv


def middle_offsets(shot, line, half_width_m):
    """Distance (N,), px, between a line and the middle of the paint across it, at places that show both its sides.

    The picture is read across the line on the deck; a place counts where deck, paint and deck follow each other.
    """
    delta = line[1] - line[0]
    right = np.array([-delta[1], delta[0]]) / np.hypot(*delta)
    across = np.linspace(-half_width_m - 0.7, half_width_m + 0.7, 121)
    found = []
    for share in np.linspace(0.0, min(1.0, PART_M / np.hypot(*delta)), 160)[1:-1]:
        at = line[0] + share * delta
        pixels = deck_pixels(shot, at + across[:, None] * right)
        if not np.all((pixels > 0) & (pixels < np.array(SIZE) - 1.001)):  # NaN too
            continue
        level = grey_at(shot.image, pixels)
        low, high = level.min(), level.max()
        painted = np.clip((level - low) / max(high - low, 1e-9), LOW, HIGH) - LOW
        px_per_m = np.linalg.norm(pixels[-1] - pixels[0]) / (across[-1] - across[0])
        if high - low < CONTRAST or painted[[0, -1]].any() or px_per_m * half_width_m < 1.2:
            continue
        found.append((painted @ across) / painted.sum() * px_per_m)
    return np.array(found)


def clean(ship, style):
    """The ship with nothing but its edge markings on an even dark deck, and a crate at the bow."""
    layout = ship.layout
    coat = layers([edge_coat(line, style) for line in (layout.left_m, layout.right_m)])
    surface = DeckSurface((0.15, 0.15, 0.15), grain=0.0, wear=0.0, noise_offset=(0.0, 0.0))
    return replace(bare(ship), coat=coat, surface=surface)


def bare(ship):
    """The ship with all its paint and no solids but a crate at the bow."""
    crate = box(ship.layout.length_m - 2.0, 0.0, 0.0, (1.0, 1.0, 1.0), 0.0, (0.1, 0.1, 0.1))
    return replace(ship, solids=crate, lights=ship.lights[:0], background=ship.background[:0])


def edge_style(name):
    style = load_class(name).plan.edge if name in SHIP_CLASSES else random_edge(np.random.default_rng(len(name)))
    return replace(style, opacity=1.0, smear=0.0, rgb=(0.86, 0.87, 0.88))


def built(name):
    preset, _, seed = name.partition(" ")
    return build_ship(preset, np.random.default_rng(int(seed or 0)))


def shoot(renderer, ship, range_m, fov_deg, moving, distorted):
    """The loaded ship from before its ramp, 5 m to the right, rolled a little."""
    layout, motion = ship.layout, SWING if moving and not ship.on_land else Motion()
    there = moved_ship(layout, motion, TIME_S)
    ramp = layout.centre_m[0]
    delta = layout.centre_m[1] - ramp
    along, right = delta / np.hypot(*delta), np.array([-delta[1], delta[0]]) / np.hypot(*delta)
    height = 4.0 + 0.07 * (range_m + 70.0)
    eye, target = ((there @ [*(ramp + s * along + t * right), -up, 1.0])[:3]
                   for s, t, up in ((-range_m, 5.0, height), (40.0, 0.0, 0.0)))  # fmt: skip
    view = looking(eye, target, np.deg2rad([4.0, 0.0, 1.0]))
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
    view = renderer.render(source, type(posed).from_matrix(matrix), CALM, TIME_S, world_from_ship=posed)
    if camera.has_distortion:
        view = Lens(renderer.context).warp(view, source, camera)
    grey = 255.0 * np.clip(view.radiance.mean(axis=2), 0.0, 1.0) ** (1 / DISPLAY_GAMMA)
    return Shot(grey.astype(float), view.depth_m, camera, matrix, moved_ship(layout, motion, TIME_S), layout)


def local_means(offsets):
    """Means (M,) over neighbouring places: one place alone may lie between two rungs of a ladder and two pixels."""
    return np.array([part.mean() for part in np.array_split(offsets, max(len(offsets) // NEIGHBOURS, 1))])


CASES = pytest.mark.parametrize(
    ("moving", "distorted"), [(False, False), (True, True)], ids=["still pinhole", "moving lens"]
)
SHIPS = pytest.mark.parametrize("name", SHIP_CLASSES + RANDOM_SHIPS)


@CASES
@SHIPS
def test_the_middle_of_the_paint_is_the_true_line(renderer, name, moving, distorted):
    style, ship = edge_style(name), built(name)
    renderer.load(clean(ship, style), SUN)
    for range_m, fov_deg in zip(RANGES_M, FOVS_DEG, strict=True):
        shot = shoot(renderer, ship, range_m, fov_deg, moving, distorted)
        for line in (ship.layout.left_m, ship.layout.right_m):
            offsets = middle_offsets(shot, line, style.width_m / 2)
            assert len(offsets) > 80
            assert np.abs(local_means(offsets)).max() < 0.25
            assert abs(offsets.mean()) < 0.1
            assert np.percentile(np.abs(offsets), 99) < 0.5


@pytest.mark.parametrize("name", SHIP_CLASSES)
def test_fully_painted_decks_have_their_edge_markings_on_the_true_lines(renderer, name):
    ship = built(name)
    renderer.load(bare(ship), SUN)
    half_width = load_class(name).plan.edge.width_m / 2
    for range_m, fov_deg in zip(RANGES_M, FOVS_DEG, strict=True):
        shot = shoot(renderer, ship, range_m, fov_deg, True, True)
        for line in (ship.layout.left_m, ship.layout.right_m):
            offsets = middle_offsets(shot, line, half_width)
            assert len(offsets) > 80
            assert abs(np.median(offsets)) < 0.15
            assert np.percentile(np.abs(offsets), 80) < 0.5


def test_a_line_half_a_metre_off_is_noticed(renderer):
    style, ship = edge_style("cvn"), built("cvn")
    layout = replace(ship.layout, left_m=ship.layout.left_m + np.array([0.0, 0.5]))
    renderer.load(clean(replace(ship, layout=layout), style), SUN)
    shot = shoot(renderer, ship, RANGES_M[1], FOVS_DEG[1], True, True)
    moved = middle_offsets(shot, ship.layout.left_m, style.width_m / 2)
    px_per_m = shot.camera.fx / (RANGES_M[1] + 110.0)  # at the line's middle
    assert np.median(moved) == pytest.approx(0.5 * px_per_m, rel=0.3)


def deck_and_sea(shot, pixels):
    """Depth (N,) of the deck and of the water or ground in pixels (N, 2).

    NaN in pixels of the other one, and within 2 px or 0.5 m of the deck's edge or near the bow with its crate.
    """
    deck, sea = surfaces(shot, pixels)
    for shift in ((-2, -2), (-2, 2), (2, -2), (2, 2)):
        near_deck, near_sea = surfaces(shot, pixels + shift)
        deck, sea = np.where(np.isnan(near_deck), np.nan, deck), np.where(np.isnan(near_sea), np.nan, sea)
    return deck, sea


def surfaces(shot, pixels):
    """Depth (N,) of the deck's plane inside its edge, and of the water's plane outside it."""
    layout, rays = shot.layout, sight_lines(shot.camera, pixels) @ shot.world_from_camera[:3, :3].T
    deck, (x, y, _) = meet(shot, rays, shot.world_from_ship[:3, 3], shot.world_from_ship[:3, 2])
    port, starboard = (np.interp(x, layout.stations_m, edge) for edge in (layout.port_m, layout.starboard_m))
    margin = np.minimum.reduce([x, y - port, starboard - y])
    before_bow = (deck > 0) & (x < layout.length_m - 12.0)
    sea, _ = meet(shot, rays, np.array([0.0, 0.0, layout.sea_z_m]), np.array([0.0, 0.0, 1.0]))
    return (
        np.where(before_bow & (margin > 0.5), deck, np.nan),
        np.where(before_bow & (margin < -0.5) & (sea > 0) & (sea < 4000.0), sea, np.nan),
    )


def meet(shot, rays, point, normal):
    """Depth (N,) at which rays (N, 3) from the camera meet a plane, and where that is in the ship frame (3, N)."""
    eye = shot.world_from_camera[:3, 3]
    depth = (point - eye) @ normal / (rays @ normal)
    hits = np.column_stack([eye + depth[:, None] * rays, np.ones(len(rays))])
    return depth, (np.linalg.inv(shot.world_from_ship) @ hits.T)[:3]


@CASES
@pytest.mark.parametrize("name", SHIP_CLASSES)
def test_depth_is_the_distance_to_deck_and_sea(renderer, name, moving, distorted):
    ship = built(name)
    renderer.load(clean(ship, edge_style(name)), SUN)
    for range_m, fov_deg in ((40.0, 80.0), (200.0, 25.0)):
        shot = shoot(renderer, ship, range_m, fov_deg, moving, distorted)
        v, u = np.mgrid[3 : SIZE[1] : 5, 4 : SIZE[0] : 7].reshape(2, -1)
        got = shot.depth[v, u]
        deck, sea = deck_and_sea(shot, np.column_stack([u, v]).astype(float))
        assert min(np.isfinite(deck).sum(), np.isfinite(sea).sum()) > 100
        tolerance = 1e-3 if distorted else 5e-5  # the lens interpolates between the pinhole's pixels
        for expected in (deck, sea):
            there = np.isfinite(expected)
            np.testing.assert_allclose(got[there], expected[there], rtol=tolerance)
