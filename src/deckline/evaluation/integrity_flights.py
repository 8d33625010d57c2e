"""Flights without pictures: the simulator's path, ship and navigation, and a modelled detector.

Thousands of frames a minute, so that rare things can be counted. What a picture would show of its own, such as glare or
clutter, is not in them: see `deckline eval integrity --rendered`.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from deckline.config import Sensors
from deckline.evaluation.integrity_faults import Shot
from deckline.evaluation.integrity_points import PointNoise, seen_points, sparse_depth
from deckline.evaluation.localization_flights import miscalibrate
from deckline.sim import SimConfig
from deckline.sim.camera.measure import measure_pose
from deckline.sim.flight.approach import approach_view
from deckline.sim.flight.motion import draw_motion, ship_pose
from deckline.sim.flight.views import Viewpoint
from deckline.sim.ship.layout import class_layout
from deckline.sim.ship.ship_class import load_class
from deckline.sim.simulate import draw_visibility, truth_segments
from deckline.types import Detection, Frame, Truth

POINTS, MOTION, AIR = 31, 32, 33  # random streams


def point_flight(config: SimConfig, sensors: Sensors, noise: PointNoise) -> Iterator[Shot]:
    """Every frame of an approach of a named preset, with the detector's points.

    The pose is the navigation unit's; calibration, deck height and depths are wrong as in `eval localization`.
    """
    layout = class_layout(load_class(config.preset))
    motion = draw_motion(config.motion, False, np.random.default_rng([config.seed, MOTION]))
    visibility_m = draw_visibility(config.visibility_m, np.random.default_rng([config.seed, AIR]))
    size = (config.height + config.frames, config.width, 3)
    grain = np.random.default_rng([config.seed, POINTS]).integers(0, 256, size, np.uint8)
    far_m, depth_sigma = noise.seen_share * visibility_m, sensors.depth_fraction
    for index in range(config.frames):
        view = approach_view(config, layout, index, motion)
        segments = truth_segments(layout.at_pose(ship_pose(layout, motion, view.time_s)))
        rng = np.random.default_rng([config.seed, POINTS, index])
        camera, pose = view.camera, view.world_from_camera
        left, right = (seen_points(segment, pose, camera, far_m, noise, rng) for segment in segments)
        depth = sparse_depth(camera, pose, segments, [left, right], depth_sigma, rng)
        truth = Truth(*segments, visibility_m=visibility_m, world_from_body=view.world_from_body)
        frame = _frame(view, config, truth, grain[index : index + config.height], index)
        frame = replace(frame, depth_m=depth, deck_z_m=float(layout.world_from_ship.translation[2]))
        yield Shot(miscalibrate(frame, sensors, config.seed), Detection(left, right))


def _frame(view: Viewpoint, config: SimConfig, truth: Truth, image: NDArray[np.uint8], index: int) -> Frame:
    """Pose, camera and truth; the picture is grain, another in every frame, as a camera's is."""
    return Frame(
        f"point_{config.seed}_{index}",
        view.time_s,
        image,
        view.camera,
        view.body_from_camera,
        world_from_body=measure_pose(view.world_from_body, view.time_s, config.navigation, config.seed),
        truth=truth,
    )
