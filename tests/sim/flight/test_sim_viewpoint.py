import numpy as np

from deckline.geometry import Camera, camera_mount
from deckline.sim.flight.viewpoint import Viewpoint, looking, runway_in_view, runway_point
from deckline.sim.ship.layout import class_layout
from deckline.sim.ship.paint import axes
from deckline.sim.ship.ship_class import load_class

CVN = class_layout(load_class("cvn"))
PAPER_SHIP = class_layout(load_class("paper"))


def test_nose_points_at_the_target():
    position, target = np.array([10.0, -5.0, -60.0]), np.array([-200.0, 40.0, 6.0])
    body = looking(position, target, np.zeros(3))
    nose = body.rotation.apply([1.0, 0.0, 0.0])
    np.testing.assert_allclose(nose, (target - position) / np.linalg.norm(target - position), atol=1e-12)
    assert abs(body.rotation.apply([0.0, 1.0, 0.0])[2]) < 1e-12  # wings level


def test_camera_pose_is_the_body_then_the_mount():
    body = looking(np.array([1.0, 2.0, -30.0]), np.array([50.0, 0.0, 0.0]), np.array([0.1, 0.2, 0.3]))
    mount = camera_mount((1.0, 0.5, 0.2))
    view = Viewpoint(body, Camera.from_fov(64, 36, 1.0), 0.0, mount)
    np.testing.assert_allclose(view.world_from_camera.as_matrix(), body.as_matrix() @ mount.as_matrix(), atol=1e-12)


def test_runway_points_are_measured_from_the_ramp():
    for layout in (PAPER_SHIP, CVN):
        end = axes(*layout.centre_m)[2]
        np.testing.assert_allclose(
            runway_point(layout, end), layout.world_from_ship.apply([*layout.centre_m[1], 0.0]), atol=1e-9
        )
        raised = runway_point(layout, -40.0, 5.0, 12.0)
        assert raised[2] - runway_point(layout, 0.0)[2] == -12.0
        assert np.linalg.norm((raised - runway_point(layout, 0.0))[:2]) == np.hypot(40.0, 5.0)


def test_part_of_the_runway_in_view():
    layout = CVN
    camera = Camera.from_fov(640, 360, np.deg2rad(60.0))

    def seen(along_m, up_m, ahead_m):
        position = runway_point(layout, along_m, 0.0, up_m)
        return runway_in_view(
            Viewpoint(looking(position, runway_point(layout, ahead_m), np.zeros(3)), camera, 0.0), layout
        )

    assert seen(-400.0, 30.0, 100.0) == 1.0
    assert seen(-400.0, 30.0, -900.0) == 0.0
    assert 0.1 < seen(100.0, 20.0, 200.0) < 0.9
