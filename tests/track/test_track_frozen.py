"""A picture shown again is told from a picture of a scene that rests."""

from dataclasses import replace

import numpy as np
from point_flight import Flight, draw_errors, one_frame
from scipy.spatial.transform import RigidTransform

from deckline.track.integrity import FrozenImageMonitor
from deckline.types import DepthMode, RunwayEstimate, Status

NOTHING = RunwayEstimate(Status.NOT_SEEN, DepthMode.NONE, {}, {})


def frames(count=6):
    flight = Flight(start_m=200.0, seed=2)
    errors, rng = draw_errors(flight), np.random.default_rng(1)
    shown = []
    for index in range(count):
        frame, estimate, _ = one_frame(flight, index / 5, errors, rng)
        image = rng.integers(0, 256, frame.image_rgb.shape, np.uint8)
        shown.append((replace(frame, image_rgb=image), estimate))
    return shown


def verdicts(shown):
    monitor, found = FrozenImageMonitor(), []
    for frame, estimate in shown:
        monitor = monitor.update(frame, estimate)
        found.append(monitor.is_frozen)
    return found


def test_pictures_that_change_are_not_frozen():
    assert not any(verdicts(frames()))


def test_the_same_picture_from_a_moving_aircraft_is_frozen_at_once():
    shown = frames(3)
    again = [(replace(frame, image_rgb=shown[0][0].image_rgb), NOTHING) for frame, _ in shown]
    assert verdicts(again) == [False, True, True]


def test_the_same_picture_from_an_aircraft_at_rest_is_a_scene_at_rest():
    (frame, _), *_ = frames(1)
    still = [(replace(frame, time_s=float(i)), NOTHING) for i in range(3)]
    assert not any(verdicts(still))
    moved = RigidTransform.from_translation([1.0, 0.0, 0.0]) * frame.world_from_body
    assert verdicts([still[0], (replace(frame, time_s=1.0, world_from_body=moved), NOTHING)]) == [False, True]


def test_lines_that_rest_in_the_image_while_the_pose_moves_are_frozen_after_three():
    shown = frames(6)
    rested = [(frame, shown[0][1]) for frame, _ in shown]
    assert verdicts(rested) == [False, False, False, True, True, True]
