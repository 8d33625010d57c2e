"""The gate keeps what agrees, and names what does not."""

import numpy as np
import pytest
from scipy.stats import norm
from steady_view import seen, view

from deckline.track import TrackConfig
from deckline.track.gate import gated
from deckline.track.measurement import measure
from deckline.track.state import Pose, initial_state, predict, updated
from deckline.types import DepthMode

CONFIG = TrackConfig(runway_width_m=15.0)


def followed(frames=20):
    """A state that has seen so many frames, and the pose."""
    rng = np.random.default_rng(5)
    pose = Pose(view(0.0).world_from_camera.translation, np.zeros(3), np.zeros(3))
    state = initial_state(0.0, seen(rng).lines["left"], None, CONFIG)
    for index in range(frames):
        state = predict(state, index / 10, pose.position_m, CONFIG)
        measured = measure(state, seen(rng).lines, DepthMode.FINE, pose, 0.1, CONFIG)
        state = updated(state, measured.values, measured.design, measured.noise)
    return state, pose, rng


def test_a_measurement_as_expected_passes_whole():
    state, pose, rng = followed()
    measured = measure(state, seen(rng).lines, DepthMode.FINE, pose, 0.1, CONFIG)
    found = gated(state, measured, 5.0)
    assert found.left_out == {}
    assert found.degrees == 5
    spread = measured.design @ state.covariance @ measured.design.T + measured.noise
    assert found.distance2 == pytest.approx(measured.values @ np.linalg.inv(spread) @ measured.values)


@pytest.mark.parametrize("side", ["left", "right"])
def test_one_line_elsewhere_is_left_out_by_name(side):
    state, pose, rng = followed()
    lines = seen(rng).lines
    lines[side] = seen(rng, aside_m=4.0).lines[side]
    found = gated(state, measure(state, lines, DepthMode.FINE, pose, 0.1, CONFIG), 5.0)
    assert list(found.left_out) == [side]
    assert "to the right" in found.left_out[side]
    assert len(found.kept.values) == 3


def test_everything_elsewhere_leaves_nothing():
    state, pose, rng = followed()
    lines = seen(rng, z_m=-14.0, spacing_m=25.0, aside_m=9.0).lines
    found = gated(state, measure(state, lines, DepthMode.FINE, pose, 0.1, CONFIG), 5.0)
    assert found.kept is None
    assert set(found.left_out) == {"left", "right", "height"}
    assert "lower than expected" in found.left_out["height"]


def test_no_lines_no_measurement():
    state, pose, _ = followed(1)
    assert measure(state, {}, DepthMode.FINE, pose, 0.1, CONFIG) is None


def test_the_gate_is_as_rare_as_its_standard_deviations_say():
    state, pose, rng = followed()
    measured = measure(state, seen(rng).lines, DepthMode.FINE, pose, 0.1, CONFIG)
    spread = measured.design @ state.covariance @ measured.design.T + measured.noise
    root, out = np.linalg.cholesky(spread), 0
    for _ in range(400):
        values = root @ rng.standard_normal(len(spread))
        drawn = type(measured)(measured.sides, values, measured.design, measured.noise, measured.x_m)
        out += bool(gated(state, drawn, 1.5).left_out)
    assert out / 400 == pytest.approx(2 * norm.sf(1.5), abs=0.05)
