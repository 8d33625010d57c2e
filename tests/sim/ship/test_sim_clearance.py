import numpy as np
import pytest

from deckline.sim.ship.clearance import before_end, clear_of_runway, edge_distance, has_room, runway_distance
from deckline.sim.ship.layout import class_layout
from deckline.sim.ship.mesh import box, join, rectangle
from deckline.sim.ship.ship_class import load_class


@pytest.fixture(scope="module")
def cvn():
    return class_layout(load_class("cvn"))


def test_runway_distance_is_the_distance_to_the_nearer_line(cvn):
    along = (cvn.right_m[1] - cvn.right_m[0]) / np.linalg.norm(cvn.right_m[1] - cvn.right_m[0])
    right = np.array([-along[1], along[0]])
    middle = cvn.right_m.mean(axis=0)
    np.testing.assert_allclose(
        runway_distance(cvn, middle + np.outer([5.0, 0.0, -3.0], right)), [5.0, 0.0, -3.0], atol=1e-9
    )
    left_middle = cvn.left_m.mean(axis=0)
    assert runway_distance(cvn, left_middle - 7.0 * right) == pytest.approx(7.0)


def test_edge_distance_changes_sign_at_the_edge(cvn):
    x = 120.0
    port, starboard = cvn.edges_at(x)
    points = np.array([[x, port + 2.0], [x, starboard + 1.0], [3.0, 0.0]])
    np.testing.assert_allclose(edge_distance(cvn, points), [2.0, -1.0, 3.0])


def test_has_room_refuses_the_runway_and_the_water(cvn):
    on_runway = rectangle(*cvn.centre_m.mean(axis=0), 5.0, 5.0)
    assert not has_room(cvn, True, on_runway)
    assert has_room(cvn, False, on_runway)
    beside = rectangle(150.0, 28.0, 5.0, 5.0)
    assert has_room(cvn, True, beside)
    assert not has_room(cvn, True, beside + np.array([0.0, 20.0]))


def test_before_end_follows_the_runway(cvn):
    along = (cvn.centre_m[1] - cvn.centre_m[0]) / np.linalg.norm(cvn.centre_m[1] - cvn.centre_m[0])
    reach = max(np.linalg.norm(line[1] - line[0]) for line in (cvn.left_m, cvn.right_m))
    points = cvn.centre_m[0] + np.outer([-500.0, reach + 1.9, reach + 2.1], along)
    np.testing.assert_array_equal(before_end(cvn, points, 2.0), [True, True, False])


def test_clear_of_runway_drops_what_stands_there_and_keeps_the_rest(cvn):
    middle = cvn.centre_m.mean(axis=0)
    offending, below, beside = (
        box(*middle, 0.0, (2, 2, 2), 0.0, (1, 1, 1)),
        box(*middle, 5.0, (2, 2, 2), 0.0, (1, 1, 1)),
        box(150.0, 28.0, 0.0, (2, 2, 2), 0.0, (1, 1, 1)),
    )
    kept = clear_of_runway(cvn, join([offending, below, beside]))
    floor = offending[np.repeat((offending[::3, 2] == 0) & (offending[1::3, 2] == 0) & (offending[2::3, 2] == 0), 3)]
    np.testing.assert_array_equal(kept, join([floor, below, beside]))
