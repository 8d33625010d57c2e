"""The aircraft in films."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.geometry import Camera, camera_mount
from deckline_sim.landing.aircraft import AIRCRAFT_TYPES
from deckline_sim.landing.airframe import LENGTH_M, LIGHT, SHADE, SPAN_M, airframe_mesh, draw_aircraft
from deckline_sim.ship.mesh import quads

CAMERA = Camera.from_fov(320, 180, np.deg2rad(60.0))
AIRLIGHT = (200.0, 210.0, 220.0)
BACKGROUND = 100


def plate(half_m):
    """An upright white square that faces aft, towards a camera behind it."""
    low, high = -half_m, half_m
    return quads([[[0, low, low], [0, low, high], [0, high, high], [0, high, low]]], (1.0, 1.0, 1.0))


def draw(mesh, distance_m, visibility_m=np.inf, turn=None):
    image = np.full((180, 320, 3), BACKGROUND, np.uint8)
    body = RigidTransform.from_components([distance_m, 0.0, 0.0], turn or Rotation.identity())
    return draw_aircraft(image, mesh, body, CAMERA, camera_mount(), AIRLIGHT, visibility_m)


def test_a_plate_is_as_large_as_the_pinhole_camera_shows_it():
    image = draw(plate(2.0), 40.0)
    covered = (image[..., 0].astype(float) - BACKGROUND) / (image[90, 160, 0].astype(float) - BACKGROUND)
    side_px = 4.0 * CAMERA.fx / 40.0
    assert covered.sum() == pytest.approx(side_px**2, rel=0.03)
    rows, columns = np.nonzero(covered > 0.5)
    assert (rows.mean(), columns.mean()) == pytest.approx((CAMERA.cy, CAMERA.cx), abs=0.2)


def test_a_face_has_the_light_of_its_angle_and_the_haze_of_its_distance():
    white = np.array(AIRLIGHT) * (SHADE + (1 - SHADE) * max(0.0, -LIGHT[0]))
    assert draw(plate(2.0), 40.0)[90, 160] == pytest.approx(white, abs=1)
    through = 0.02 ** (40.0 / 100.0)  # 2 % contrast at the visibility
    hazy = through * white + (1 - through) * np.array(AIRLIGHT)
    assert draw(plate(2.0), 40.0, visibility_m=100.0)[90, 160] == pytest.approx(hazy, abs=1)


def test_what_faces_away_or_lies_behind_the_camera_is_not_drawn():
    assert np.all(draw(plate(2.0), 40.0, turn=Rotation.from_euler("z", np.pi)) == BACKGROUND)
    assert np.all(draw(plate(2.0), -40.0) == BACKGROUND)


def test_the_nearer_plate_hides_the_farther_one():
    near, far = plate(2.0), plate(4.0)
    near[:, 0] -= 5.0
    near[:, 6:] = 0.0
    for mesh in (np.concatenate([near, far]), np.concatenate([far, near])):
        assert np.all(draw(mesh, 40.0)[90, 160] == 0)


def test_the_airframe_has_the_size_of_an_a4_and_its_hook():
    points = airframe_mesh("A4")[:, :3]
    assert np.ptp(points[:, 0]) == pytest.approx(LENGTH_M, rel=0.03)
    assert np.ptp(points[:, 1]) == pytest.approx(SPAN_M, rel=0.01)
    assert np.linalg.norm(points - AIRCRAFT_TYPES["A4"].hook_m, axis=1).min() < 0.15
    normals = airframe_mesh("A4")[:, 3:6]
    assert np.linalg.norm(normals, axis=1) == pytest.approx(np.ones(len(normals)), abs=1e-5)


def test_an_aircraft_outside_the_picture_leaves_it_as_it_is():
    image = np.full((180, 320, 3), BACKGROUND, np.uint8)
    body = RigidTransform.from_translation([40.0, 400.0, 0.0])
    shown = draw_aircraft(image, airframe_mesh("A4"), body, CAMERA, camera_mount(), AIRLIGHT, 1000.0)
    assert np.array_equal(shown, image)
    assert shown is not image
