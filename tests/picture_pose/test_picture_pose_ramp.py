"""The near ends of the lines as a sight of the ramp."""

from dataclasses import replace

import numpy as np
import pytest
from runway_picture import CAMERA, LEVEL, MOUNT, Place, belief_of, frame_at, pose_of, see

from deckline.localize import localize
from deckline.picture_pose.model import Mount, ramp_innovation
from deckline.picture_pose.ramp import CONTRADICTED_SIGMA, RampFix, check_closing, sight_ramp
from deckline.picture_pose.states import ACCELERATION_M_S15, States
from deckline.types import LinePoints, Reason
from runway_scene import keep

PLACE = Place(distance_m=120.0, height_m=11.0)


def sight(detection, place=PLACE, belief=None):
    frame = frame_at(0.0)
    estimate = localize(frame, detection, LEVEL, np.random.default_rng(0))
    return sight_ramp(frame, detection, estimate, belief or belief_of(place), LEVEL)


def test_the_ray_meets_the_middle_of_the_ramp():
    found = sight(see(PLACE))
    true = CAMERA.rays(CAMERA.project((pose_of(PLACE) * MOUNT).inv().apply(np.zeros((1, 3)))))[0]
    off = ramp_innovation(belief_of(PLACE), found.ray, found.sigma_m, Mount.of(MOUNT)).residuals[0]
    assert found.ray[2] == 1.0
    assert abs(found.ray[1] - true[1]) * CAMERA.fy < 5.0  # half of the gap between two points
    assert abs(off) < 2 * found.sigma_m < 20.0


def test_its_distance_does_not_depend_on_that_of_the_belief():
    belief = belief_of(PLACE)
    mean = belief.mean.copy()
    mean[States.DISTANCE] += 40.0
    one, other = (sight(see(PLACE), belief=b) for b in (belief, replace(belief, mean=mean)))
    np.testing.assert_allclose(one.ray, other.ray, atol=1e-9)
    assert one.sigma_m == pytest.approx(other.sigma_m)


OVER_DECK, LOW = Place(distance_m=-30.0, height_m=4.0), Place(distance_m=8.0, height_m=8.0)
SEEN = see(PLACE)
V = SEEN.left.points_px[:, 1]
FAR_HALF = keep(SEEN.left, np.median(V) > V)


@pytest.mark.parametrize(
    ("seen", "place"),
    [
        (see(OVER_DECK), OVER_DECK),  # the lines run out of the picture
        (see(LOW), LOW),
        (replace(SEEN, right=LinePoints.empty()), PLACE),
        (replace(SEEN, left=FAR_HALF), PLACE),  # ends that contradict each other
        (replace(SEEN, region_px=(0.0, 0.0, 1279.0, V.max() + 1.0)), PLACE),  # the searched part cuts the lines
    ],
    ids=["over deck", "low", "one line", "ends apart", "cut"],
)
def test_lines_whose_near_ends_are_not_seen_show_no_ramp(seen, place):
    assert sight(seen, place) is None


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_ramp_that_comes_nearer_as_no_aircraft_flies_is_a_zoom(sign):
    """The error of the way is that of both places, of the speed, and of an acceleration."""
    sigma_m = float(np.sqrt(3.0**2 + 4.0**2 + (0.8 * 2.0) ** 2 + ACCELERATION_M_S15[0] ** 2 * 0.8**3 / 3))
    first = RampFix(1.0, 200.0, 3.0, 40.0, 2.0)
    for off, is_flagged in ((0.99, False), (1.01, True)):
        way_m = 0.8 * 40.0 + sign * off * CONTRADICTED_SIGMA * sigma_m
        flag = check_closing(first, RampFix(1.8, 200.0 - way_m, 4.0, 40.0, 2.0))
        assert (flag is not None) is is_flagged
    assert flag.reason is Reason.FOCAL
    assert f"{way_m:.0f} m in 0.8 s, expected 32 m" in flag.message
