from dataclasses import replace

import numpy as np
import pytest

from deckline.localize.model import NUISANCES, State
from deckline.localize.solver import solve
from runway_scene import LEFT, NOISE, PARALLEL_RIGHT, STILL, approach, azimuth, detection, observe_lines, with_depth

FRAME = with_depth(approach(80.0, 8.0, right=PARALLEL_RIGHT))


def solve_from_offset(frame, found, mode="auto", deck_z_m=LEFT.p0_m[2]):
    """The solution from a start that is off by 0.3 m, 0.01 rad and 0.4 m of height."""
    observations, *_ = observe_lines(frame, found, mode)
    middles = np.stack([(line.p0_m + line.p1_m)[:2] / 2 for line in (LEFT, PARALLEL_RIGHT)])
    start = State(middles + 0.3, np.full(2, azimuth(LEFT) + 0.01), LEFT.p0_m[2] + 0.4, np.zeros(NUISANCES))
    return solve(observations, start, NOISE, STILL.deck, deck_z_m)


def test_iteration_converges_to_the_truth():
    solution = solve_from_offset(FRAME, detection(FRAME, PARALLEL_RIGHT))
    np.testing.assert_allclose(solution.state.azimuths_rad, azimuth(LEFT), atol=1e-6)
    assert solution.state.z_m == pytest.approx(LEFT.p0_m[2], abs=1e-5)
    assert abs(solution.height_score) < 1e-3
    assert solution.names == ("left", "right")


def test_depth_noise_larger_than_stated_inflates_the_depths_alone():
    frame = replace(FRAME, depth_m=FRAME.depth_m.copy())
    found = detection(frame, PARALLEL_RIGHT, 16)
    rng = np.random.default_rng(1)
    for u, v in np.rint(np.concatenate([found.left.points_px, found.right.points_px])).astype(int):
        frame.depth_m[v - 1 : v + 2, u - 1 : u + 2] *= 1 + rng.normal(0, 0.05)  # 1 % is stated
    solution = solve_from_offset(frame, found, "fine")
    assert (solution.inflation["left"], solution.inflation["right"]) == (1.0, 1.0)
    assert 3.5 < solution.inflation["depth"] < 6.5


def test_reported_height_that_contradicts_the_depths_has_a_large_innovation():
    frame = with_depth(approach(60.0, 6.0, right=PARALLEL_RIGHT))
    found = detection(frame, PARALLEL_RIGHT)
    assert solve_from_offset(frame, found, deck_z_m=LEFT.p0_m[2] + 1.0).height_score > 5
