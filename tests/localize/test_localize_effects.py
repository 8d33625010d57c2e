"""What a line says that common errors do to it, against what they do: one at a time, to exact points."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.geometry import wrap_angle
from deckline.localize import DeckConfig, LocalizeConfig, NoiseConfig, localize
from deckline.types import DepthMode, Detection, Segment
from runway_scene import CAMERA, DECK_Z_M, LEFT, PARALLEL_RIGHT, approach, azimuth, line_points

TURN_X, TURN_Y, REPORTED, FOCAL, SCALE, ALONG, ACROSS = range(7)
STEPS = np.array([1e-4, 1e-4, 1e-2, 1e-4, 1e-3, 1e-4, 1e-4])
HEADING = np.array([np.cos(azimuth(LEFT)), np.sin(azimuth(LEFT)), 0.0])
BESIDE = np.array([-HEADING[1], HEADING[0], 0.0])


def tilted(line, hub, slopes):
    """A line of the deck when it slopes about its hub."""
    ends = [p + np.array([0, 0, (p - hub) @ HEADING * slopes[0] + (p - hub) @ BESIDE * slopes[1]])
            for p in (line.p0_m, line.p1_m)]  # fmt: skip
    return Segment(*ends)


def plane_depth(frame, hub, slopes):
    """Exact depth of the sloping deck, up to 150 m."""
    v, u = np.mgrid[0 : frame.camera.height, 0 : frame.camera.width]
    pose = frame.world_from_camera
    rays = pose.rotation.apply(frame.camera.rays(np.column_stack([u.ravel(), v.ravel()]).astype(float)))
    normal = np.array([0.0, 0.0, 1.0]) - slopes[0] * HEADING - slopes[1] * BESIDE
    with np.errstate(divide="ignore"):
        depth = ((hub - pose.translation) @ normal / (rays @ normal)).reshape(v.shape)
    return np.where((depth > 0) & (depth < 150.0), depth, np.nan).astype(np.float32)


def seen(index, step, config, fine, hub=LEFT.p0_m):
    """Lines of both sides with one error, and by how much their true z differs at the points where they are told.

    Slopes turn the deck about its hub.
    """
    exact = approach(90.0, 11.0, right=PARALLEL_RIGHT)
    slopes = step * np.array([index == ALONG, index == ACROSS])
    lines = [tilted(line, hub, slopes) for line in (LEFT, PARALLEL_RIGHT)]
    points = Detection(*(line_points(exact, line) for line in lines))
    frame = replace(exact, depth_m=plane_depth(exact, hub, slopes)) if fine else exact
    turn = Rotation.from_rotvec(step * np.array([index == TURN_X, index == TURN_Y, 0.0]))
    pose = RigidTransform.from_components(frame.world_from_body.translation, turn * frame.world_from_body.rotation)
    zoom = 1 + step * (index == FOCAL)
    frame = replace(
        frame,
        world_from_body=pose,
        deck_z_m=DECK_Z_M + step * (index == REPORTED),
        camera=replace(CAMERA, fx=zoom * CAMERA.fx, fy=zoom * CAMERA.fy),
        depth_m=None if frame.depth_m is None else frame.depth_m * np.float32(1 + step * (index == SCALE)),
    )
    estimate = localize(frame, points, config, np.random.default_rng(0))
    assert estimate.mode is (DepthMode.FINE if fine else DepthMode.COARSE)
    rise = {s: slopes @ [(line.point_m - hub) @ HEADING, (line.point_m - hub) @ BESIDE]
            for s, line in estimate.lines.items()}  # fmt: skip
    return estimate.lines, rise


@pytest.mark.parametrize("fine", [True, False])
@pytest.mark.parametrize("index", range(7))
@pytest.mark.parametrize(
    "config",
    [
        LocalizeConfig(),
        LocalizeConfig(noise=NoiseConfig(deck_z_m=1.5), deck=DeckConfig(tilt_rad=0.01)),
        LocalizeConfig(runway_width_m=float((PARALLEL_RIGHT.p0_m - LEFT.p0_m) @ BESIDE)),
    ],
)
def test_an_effect_is_the_derivative_of_the_estimate(index, fine, config):
    step = STEPS[index]
    level, _ = seen(index, 0.0, config, fine)
    hub = (level["left"].point_m + level["right"].point_m) / 2
    (before, before_rise), (after, after_rise) = (seen(index, by, config, fine, hub) for by in (-step, step))
    for side in ("left", "right", "centre"):
        if after[side].errors is None:
            continue
        away = after[side].point_m - before[side].point_m
        z = away[2] - after_rise[side] + before_rise[side]
        turned = float(wrap_angle(after[side].azimuth_rad - before[side].azimuth_rad))
        right = np.array([-np.sin(before[side].azimuth_rad), np.cos(before[side].azimuth_rad), 0.0])
        sloped = after[side].errors.slopes_rad - before[side].errors.slopes_rad
        sloped = sloped - 2 * step * np.array([index == ALONG, index == ACROSS])
        found = np.array([away @ right, turned, z, *sloped]) / (2 * step)
        said = (after[side].errors.effects + before[side].errors.effects)[:, index] / 2
        assert np.all(np.abs(found - said) <= 0.02 * np.abs(said) + [0.05, 3e-3, 0.05, 3e-3, 3e-3]), (side, found, said)
