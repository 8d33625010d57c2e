"""Where things are in a picture, by a camera, poses and planes that owe nothing to deckline's."""

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

from deckline.geometry import Camera
from deckline_sim.ship.layout import Layout

CONTRAST = 10.0  # grey levels that paint must stand out
FULL = 0.7  # of a line's usual contrast
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
    layout: Layout | None


def turn(axis, angle):
    """Rotation matrix about x, y or z."""
    return Rotation.from_euler(axis, angle).as_matrix()


def moved_ship(layout, motion, time_s):
    """world_from_ship (4, 4) of a ship that sails, heaves, and rolls and pitches about its middle at the waterline."""
    yaw = layout.world_from_ship.rotation.as_euler("ZYX")[0]
    sizes = np.array([motion.roll_rad, motion.pitch_rad, motion.heave_m])
    roll, pitch, heave = sizes * np.sin(2 * np.pi * time_s / np.array([22.0, 12.0, 18.0]) + motion.phases_rad)
    middle = np.array([layout.length_m / 2, 0.0, layout.deck_height_m])
    rotation = turn("z", yaw) @ turn("y", pitch) @ turn("x", roll)
    at_rest = np.array(layout.world_from_ship.translation)
    sailed = motion.speed_m_s * time_s * np.array([np.cos(yaw), np.sin(yaw), 0.0])
    pivot = at_rest + turn("z", yaw) @ middle + sailed - [0.0, 0.0, heave]
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation, pivot - rotation @ middle
    return out


def project(camera, points):
    """Pixels (N, 2) of points (N, 3) of the optical frame, by OpenCV."""
    matrix = np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])
    return cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, np.array(camera.distortion))[0][:, 0]


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
        if not np.all((pixels > 0) & (pixels < np.array(shot.image.shape[::-1]) - 1.001)):  # NaN too
            continue
        level = map_coordinates(shot.image, pixels[:, ::-1].T, order=1)
        low, high = level.min(), level.max()
        painted = np.clip((level - low) / max(high - low, 1e-9), LOW, HIGH) - LOW
        px_per_m = np.linalg.norm(pixels[-1] - pixels[0]) / (across[-1] - across[0])
        if high - low < CONTRAST or painted[[0, -1]].any() or px_per_m * half_width_m < 1.2:
            continue
        found.append(((painted @ across) / painted.sum() * px_per_m, high - low))
    if not found:
        return np.zeros(0)
    offsets, contrast = np.transpose(found)
    return offsets[contrast > FULL * np.median(contrast)]  # not where a dash begins or ends


def local_means(offsets):
    """Means (M,) over neighbouring places: one place alone may lie between two rungs of a ladder and two pixels."""
    return np.array([part.mean() for part in np.array_split(offsets, max(len(offsets) // NEIGHBOURS, 1))])


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


def recorded(frame):
    """A frame as a shot, the deck's axes from its two true lines."""
    body = frame.world_from_body.as_matrix()
    left, right = frame.truth.left, frame.truth.right
    deck = np.eye(4)
    deck[:3, 0] = left.p1_m - left.p0_m
    deck[:3, 2] = np.cross(deck[:3, 0], right.p0_m - left.p0_m)
    deck[:3, 1] = np.cross(deck[:3, 2], deck[:3, 0])
    deck[:3, :3] /= np.linalg.norm(deck[:3, :3], axis=0)
    deck[:3, 3] = left.p0_m
    grey = frame.image_rgb.mean(axis=2)
    return Shot(grey, frame.depth_m, frame.camera, body @ frame.body_from_camera.as_matrix(), deck, None)
