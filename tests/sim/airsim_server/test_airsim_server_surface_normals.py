from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.geometry import Camera
from deckline_sim.airsim_server.objects import object_pose
from deckline_sim.airsim_server.settings import NORMALS
from deckline_sim.airsim_server.surface_normals import draw_normals, surface_normals
from deckline_sim.scene.view import Label

CAMERA = Camera.from_fov(40, 24, np.deg2rad(80.0))


def plane_depth(normal, distance_m):
    """Depth of a plane whose unit normal points at the camera, NaN where no ray meets it."""
    u, v = np.meshgrid(np.arange(40.0), np.arange(24.0))
    rays = CAMERA.rays(np.stack([u, v], -1).reshape(-1, 2))
    depth = -distance_m / (rays / rays[:, 2:] @ normal)
    return np.where(depth > 0, depth, np.nan).reshape(24, 40).astype(np.float32)


@pytest.mark.parametrize("normal", [[0.0, 0.0, -1.0], [0.0, -1.0, 0.0], [0.48, -0.6, -0.64]])
@pytest.mark.parametrize("distance_m", [2.0, 3000.0])
def test_a_plane_has_its_normal_where_it_is_seen_and_none_beside_it(normal, distance_m):
    depth = plane_depth(np.array(normal), distance_m)
    normals = surface_normals(depth, CAMERA)
    seen = ~np.isnan(depth)
    np.testing.assert_allclose(normals[seen], np.broadcast_to(normal, normals[seen].shape), atol=1e-3)
    assert not normals[~seen].any()


def test_surfaces_keep_their_normals_at_their_common_edge():
    near, far = np.array([0.0, 0.0, -1.0]), np.array([0.0, -0.8, -0.6])
    depth = plane_depth(far, 50.0)
    depth[8:16, 10:20] = plane_depth(near, 5.0)[8:16, 10:20]
    normals = surface_normals(depth, CAMERA)
    expected = np.broadcast_to(far, normals.shape).copy()
    expected[8:16, 10:20] = near
    expected[np.isnan(depth)] = 0.0
    np.testing.assert_allclose(normals, expected, atol=1e-3)


def test_a_picture_of_one_pixel_faces_the_camera():
    camera = Camera.from_fov(1, 1, 0.1)
    np.testing.assert_allclose(surface_normals(np.array([[7.0]], np.float32), camera)[0, 0], [0.0, 0.0, -1.0])


def test_colours_are_north_east_and_up():
    normals = np.array([[[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 0.0, 0.0]]])
    north_up = draw_normals(normals, Rotation.identity())  # as if the optical axes were north, east, down
    np.testing.assert_array_equal(north_up, [[[255, 127, 127], [127, 127, 255], [127, 127, 127]]])


def test_deck_and_sea_face_up_and_the_sky_has_no_normal(world):
    start = world.state.world_from_body
    above = RigidTransform.from_components(start.translation - [0.0, 0.0, 40.0], start.rotation)
    near = object_pose(world, "Touchdown", world.state, 0.0).translation - above.translation
    above = RigidTransform.from_translation(near * [0.9, 0.9, 0.0]) * above
    place = ("front_center", NORMALS, replace(world.state, world_from_body=above), 0.0)
    picture, labels = world.normals(*place), world.labels(*place)
    for label in (Label.DECK, Label.SURFACE):
        pixels = picture[labels == label].astype(int)
        assert len(pixels) > 20 and (np.abs(pixels - [127, 127, 255]).max(axis=1) <= 2).mean() > 0.9
    assert (picture[labels == 0] == 127).all()
