"""The gate accepts what agrees, and names what does not."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm
from steady_view import KNOWN, seen, view

from deckline.track.filter import predict, track_lines, update
from deckline.track.measurement import measure, select_consistent
from deckline.track.motion import Pose
from deckline.track.states import States, initial_state
from deckline.types import DepthMode, Reason, RunwayLine


def test_the_lines_lie_where_the_state_has_them():
    start = initial_state(0.0, RunwayLine(np.array([10.0, 20.0, -5.0]), 0.3, np.eye(3)), None, KNOWN)
    mean = np.zeros(States.SIZE)
    mean[[States.OFFSET, States.AZIMUTH, States.SPACING]] = 1.0, 0.01, 14.0
    state = replace(start, mean=mean)
    for side, right_m in (("left", -5.5), ("centre", 1.5), ("right", 8.5)):
        line = track_lines(state, None, 50.0, KNOWN)[side]
        np.testing.assert_allclose(line.point_m, state.point_m + 50.0 * state.along + right_m * state.right)
        assert line.azimuth_rad == pytest.approx(0.31)


@pytest.fixture
def settled():
    """A state that has seen 20 frames, and the pose."""
    rng = np.random.default_rng(5)
    pose = Pose(view(0.0).world_from_camera.translation, np.zeros(3), np.zeros(3))
    state = initial_state(0.0, seen(rng).lines["left"], None, KNOWN)
    for index in range(20):
        state = predict(state, index / 10, pose.position_m, KNOWN)
        measured = measure(state, seen(rng).lines, DepthMode.FINE, pose, KNOWN)
        state = update(state, measured.innovation, measured.design, measured.noise)
    return state, pose, rng


def test_a_measurement_as_expected_passes_whole(settled):
    state, pose, rng = settled
    measured = measure(state, seen(rng).lines, DepthMode.FINE, pose, KNOWN)
    found = select_consistent(state, measured, 5.0)
    assert found.excluded == ()
    assert found.degrees == 5
    variance = measured.design @ state.covariance @ measured.design.T + measured.noise
    assert found.distance2 == pytest.approx(measured.innovation @ np.linalg.inv(variance) @ measured.innovation)


@pytest.mark.parametrize("side", ["left", "right"])
def test_one_line_elsewhere_is_left_out_by_name(settled, side):
    state, pose, rng = settled
    lines = seen(rng).lines
    lines[side] = seen(rng, aside_m=4.0).lines[side]
    found = select_consistent(state, measure(state, lines, DepthMode.FINE, pose, KNOWN), 5.0)
    assert [diagnostic.reason for diagnostic in found.excluded] == [Reason(side)]
    assert len(found.accepted.innovation) == 3


def test_everything_elsewhere_leaves_nothing(settled):
    state, pose, rng = settled
    lines = seen(rng, z_m=-14.0, spacing_m=25.0, aside_m=9.0).lines
    found = select_consistent(state, measure(state, lines, DepthMode.FINE, pose, KNOWN), 5.0)
    assert found.accepted is None
    assert {diagnostic.reason for diagnostic in found.excluded} == {Reason.LEFT, Reason.RIGHT, Reason.HEIGHT}


@pytest.mark.parametrize("kept_out", [{Reason.LEFT}, {Reason.LEFT, Reason.HEIGHT}])
def test_what_is_kept_out_is_no_part_of_a_measurement_that_agrees(settled, kept_out):
    state, pose, rng = settled
    found = select_consistent(state, measure(state, seen(rng).lines, DepthMode.FINE, pose, KNOWN), 5.0, kept_out)
    assert len(found.excluded) == 1
    assert found.excluded[0].reason in kept_out


def test_the_gate_is_as_rare_as_its_standard_deviations_state(settled):
    state, pose, rng = settled
    measured = measure(state, seen(rng).lines, DepthMode.FINE, pose, KNOWN)
    variance = measured.design @ state.covariance @ measured.design.T + measured.noise
    root, out = np.linalg.cholesky(variance), 0
    for _ in range(400):
        values = root @ rng.standard_normal(len(variance))
        drawn = type(measured)(measured.sides, values, measured.design, measured.noise, measured.x_m)
        out += bool(select_consistent(state, drawn, 1.5).excluded)
    assert out / 400 == pytest.approx(2 * norm.sf(1.5), abs=0.05)
