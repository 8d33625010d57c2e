import numpy as np
import pytest

from deckline.evaluation.integrity_flights import point_flight
from deckline.evaluation.integrity_points import PointNoise
from deckline.evaluation.localization_flights import DEPTH_RANGE_M, FlightsConfig
from deckline.evaluation.metrics import normal_pixel_error
from deckline.geometry import intersect_plane
from deckline.sim.flight.approach import approach_view
from deckline.sim.ship.layout import class_layout
from deckline.sim.ship.ship_class import load_class

EXACT = FlightsConfig(frames=6, navigation="exact", visibility="clear")
PERFECT = PointNoise(sigma_px=0.0, outlier_share=0.0, missed_share=0.0)


def ends(shot, side: str) -> np.ndarray:
    line = getattr(shot.frame.truth, side)
    return shot.frame.true_world_from_camera.inv().apply(np.stack([line.p0_m, line.p1_m]))


@pytest.fixture(scope="module")
def exact():
    return list(point_flight(EXACT.approach(0), PERFECT))


@pytest.mark.parametrize("side", ["left", "right"])
def test_points_without_noise_lie_on_the_true_lines(exact, side):
    for shot in exact:
        points = getattr(shot.detection, side).points_px
        assert len(points) == 40
        assert (
            normal_pixel_error(points, ends(shot, side), shot.frame.camera).max() < 0.02
        )  # between samples of the line


def test_depth_is_that_of_the_deck_and_ends_where_the_camera_s_does(exact):
    near = exact[-1].frame
    at = np.rint(exact[-1].detection.left.points_px[::5]).astype(int)
    pose = near.world_from_camera
    deck = intersect_plane(pose.translation, pose.rotation.apply(near.camera.rays(at)), near.deck_z_m)
    expected = pose.inv().apply(deck)[:, 2]
    measured = near.depth_m[at[:, 1], at[:, 0]]
    within = expected < DEPTH_RANGE_M
    np.testing.assert_allclose(measured[within], expected[within], rtol=1e-5)
    assert np.isnan(measured[~within]).all()
    assert np.isnan(exact[0].frame.depth_m).all()


def test_the_flight_is_the_simulator_s(exact):
    """Same path, same lines, same errors of the pose as in a rendered approach."""
    config = EXACT.approach(0)
    view = approach_view(config, class_layout(load_class("paper")), 3)
    np.testing.assert_allclose(exact[3].frame.world_from_body.as_matrix(), view.world_from_body.as_matrix())
    np.testing.assert_allclose(exact[3].frame.truth.left.p0_m[2], exact[3].frame.deck_z_m)


def test_noise_is_as_stated():
    noise = PointNoise(sigma_px=0.5, outlier_share=0.0, missed_share=0.0, correlation=0.6)
    errors = []
    for shot in point_flight(FlightsConfig(frames=20, visibility="clear").approach(1), noise):
        points = shot.detection.left.points_px
        e = ends(shot, "left")
        normal = np.cross(e[0], e[1]) @ np.linalg.inv(shot.frame.camera.matrix)
        steep = abs(normal[0]) / np.hypot(normal[0], normal[1])  # of a step in u, normal to the line
        signed = (shot.frame.camera.rays(points) @ shot.frame.camera.matrix.T @ normal) / np.hypot(*normal[:2]) / steep
        errors.append(signed * np.sign(normal[0]))
    scatter = np.array(errors)
    assert scatter.std() == pytest.approx(0.5, rel=0.1)
    assert np.mean(scatter[:, 1:] * scatter[:, :-1]) / scatter.var() == pytest.approx(0.6, abs=0.08)


def test_missed_lines_and_outliers():
    blind = next(iter(point_flight(EXACT.approach(0), PointNoise(missed_share=1.0))))
    assert len(blind.detection.left) == len(blind.detection.right) == 0
    wild = next(iter(point_flight(EXACT.approach(0), PointNoise(sigma_px=0.0, outlier_share=1.0, missed_share=0.0))))
    assert normal_pixel_error(wild.detection.left.points_px, ends(wild, "left"), wild.frame.camera).max() > 3.0


def test_haze_hides_what_is_far():
    hazy = FlightsConfig(frames=6, navigation="exact", visibility="1000")
    shots = list(point_flight(hazy.approach(0), PERFECT))
    assert len(shots[0].detection.left) == 0  # 800 m away, with 700 m to be seen
    assert len(shots[3].detection.left) == 40
    assert shots[0].frame.truth.visibility_m == 1000.0


def test_every_picture_is_another_one(exact):
    assert not np.array_equal(exact[0].frame.image_rgb, exact[1].frame.image_rgb)
