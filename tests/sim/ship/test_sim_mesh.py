import numpy as np
import pytest

from deckline_sim.ship import mesh as m

WHITE = (1.0, 1.0, 1.0)


def test_a_box_encloses_its_volume_with_outward_normals(volume):
    mesh = m.boxes((3.0, -2.0, 0.0), (4.0, 2.0, 5.0), WHITE, 0.7)
    a, b, c = (mesh[k::3, :3].astype(float) for k in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    # Divergence theorem with the stored normals, independent of the winding.
    enclosed = np.sum(area * np.sum((a - [3.0, -2.0, 0.0]) * mesh[::3, 3:6], axis=1)) / 3
    assert enclosed == pytest.approx(40.0, rel=1e-5)
    assert volume(mesh) == pytest.approx(40.0, rel=1e-5)
    assert mesh[:, 2].min() == -5.0  # up is negative z


@pytest.mark.parametrize("turn", [1, -1])
def test_loft_points_outwards_whichever_way_its_polygons_run(turn, volume):
    low, top = m.rectangle(0, 0, 4, 2)[::turn], m.rectangle(0, 0, 2, 1)[::turn]
    mesh = m.loft([m.at_height(low, 0.0), m.at_height(top, -3.0)], WHITE)
    assert volume(mesh) == pytest.approx(3 / 3 * (8 + 2 + np.sqrt(16)), rel=1e-6)  # a pyramid's frustum


def test_loft_of_an_angular_polygon_is_right_where_a_middle_would_mislead():
    shape = np.array([[0, 0], [10, 0], [10, 10], [9, 10], [9, 1], [0, 1]], dtype=float)  # an L
    mesh = m.loft([m.at_height(shape, 0.0), m.at_height(shape, -1.0)], WHITE, (False, False))
    inner = mesh[::3][np.abs(mesh[::3, 0] - 9.0) < 1e-6]
    walls_at_9 = inner[np.abs(inner[:, 3]) > 0.9]
    assert len(walls_at_9) and np.all(walls_at_9[:, 3] < 0)  # the L's inner wall looks towards -x


def test_loft_leaves_out_faces_without_area():
    mesh = m.loft([m.at_height(m.rectangle(0, 0, 1, 1), 0.0), np.full((4, 3), [0, 0, -2.0])], WHITE)
    assert len(mesh) == 3 * 8  # four walls of one triangle each, four triangles of the floor
    np.testing.assert_allclose(np.linalg.norm(mesh[:, 3:6], axis=1), 1.0, atol=1e-6)


def test_instances_stretch_turn_move_and_tint(volume):
    base = m.boxes((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (0.5, 1.0, 1.0))
    mesh = m.instances(base, [10.0, 0.0, -1.0], np.pi / 2, [4.0, 2.0, 3.0], (0.5, 0.5, 2.0))
    np.testing.assert_allclose(np.ptp(mesh[:, :3], axis=0), [2, 4, 3], atol=1e-5)
    np.testing.assert_allclose(mesh[0, 6:], [0.25, 0.5, 1.0])
    assert volume(mesh) == pytest.approx(24.0, rel=1e-5)
    a, b, c = (mesh[k::3, :3] for k in range(3))
    normal = np.cross(b - a, c - a)
    np.testing.assert_allclose(mesh[::3, 3:6], normal / np.linalg.norm(normal, axis=1, keepdims=True), atol=1e-5)


def test_rods_reach_from_end_to_end_with_outward_normals():
    starts, ends = np.array([[0.0, 0, 0], [1, 1, 0]]), np.array([[0.0, 0, -6], [4, 5, 0]])
    for own, start, end in zip(np.split(m.rods(starts, ends, 0.2, WHITE), 2), starts, ends, strict=True):
        along = (end - start) / np.linalg.norm(end - start)
        reach = (own[:, :3] - start) @ along
        assert reach.min() == pytest.approx(0.0, abs=1e-5)
        assert reach.max() == pytest.approx(np.linalg.norm(end - start), rel=1e-5)
        away = own[:, :3] - start - reach[:, None] * along
        np.testing.assert_allclose(np.linalg.norm(away, axis=1), 0.1 * np.sqrt(2), rtol=1e-4)
        assert np.all(np.sum(away * own[:, 3:6], axis=1) > 0)


def test_dome_approaches_a_ball(volume):
    mesh = m.dome(1.0, 2.0, -10.0, 2.0, WHITE)
    np.testing.assert_allclose(np.linalg.norm(mesh[:, :3] - [1, 2, -10], axis=1), 2.0, rtol=1e-5)
    assert 0.6 * 4 / 3 * np.pi * 8 < volume(mesh) < 4 / 3 * np.pi * 8


@pytest.mark.parametrize("corners", [3, 4])
@pytest.mark.parametrize("direction", [(0.0, 1.0, 0.0), (0.0, -1.0, 0.0)])
def test_facing_turns_faces_to_a_direction(corners, direction):
    face = np.array([[[0.0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]]])[:, :corners]
    for either in (face, face[:, ::-1]):
        normals = m.facing(either, WHITE, direction)[:, 3:6]
        np.testing.assert_allclose(normals, np.tile(direction, (len(normals), 1)), atol=1e-7)
