"""Pictures that repeat while time goes on."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from deckline.geometry import distort
from deckline.monitors import FrozenImageMonitor
from deckline.monitors.frozen_image import FROZEN
from track.point_flight import Flight, draw_errors, one_frame
from track.steady_view import NOTHING


@pytest.fixture
def moving_frames():
    """Frames of a moving aircraft, each with another picture, and their estimates."""
    flight = Flight(start_m=200.0, seed=2)
    errors, rng = draw_errors(flight), np.random.default_rng(1)
    shown = []
    for index in range(6):
        frame, estimate, _ = one_frame(flight, index / 5, errors, rng)
        image = rng.integers(0, 256, frame.image_rgb.shape, np.uint8)
        shown.append((replace(frame, image_rgb=image), estimate))
    return shown


def verdicts(shown, monitor=None):
    monitor = monitor or FrozenImageMonitor()
    flags = [monitor.update(frame, estimate, None) for frame, estimate in shown]
    assert set(flags) <= {(), (FROZEN,)}
    return [bool(flag) for flag in flags]


def test_pictures_that_change_are_not_frozen(moving_frames):
    assert not any(verdicts(moving_frames))


def test_the_same_picture_from_a_moving_aircraft_is_frozen_at_once_until_a_reset(moving_frames):
    (first, _), *_ = moving_frames
    again = [(replace(frame, image_rgb=first.image_rgb), NOTHING) for frame, _ in moving_frames[:3]]
    monitor = FrozenImageMonitor()
    assert verdicts(again, monitor) == [False, True, True]
    monitor.reset()
    assert verdicts(again, monitor) == [False, True, True]


def test_the_same_picture_from_an_aircraft_at_rest_is_frozen_when_it_lasts(moving_frames):
    (frame, _), *_ = moving_frames
    still = [(replace(frame, time_s=0.125 * i), NOTHING) for i in range(6)]
    assert verdicts(still) == [False, False, False, True, True, True]
    moved = RigidTransform.from_translation([1.0, 0.0, 0.0]) * frame.world_from_body
    assert verdicts([still[0], (replace(frame, time_s=1.0, world_from_body=moved), NOTHING)]) == [False, True]


@pytest.mark.parametrize("distortion", [(0.0,) * 5, (-0.25, 0.08, 0.0, 0.0, 0.0)])
def test_lines_that_rest_in_the_image_while_the_pose_moves_are_frozen_after_three(moving_frames, distortion):
    """A line's ends lie in the lens's picture, its coefficients in one without distortion."""
    first, estimate = moving_frames[0]
    camera = replace(first.camera, distortion=distortion)
    bent = {side: replace(line, ends_px=distort(line.ends_px, camera)) for side, line in estimate.pixel_lines.items()}
    rested = [(replace(frame, camera=camera), replace(estimate, pixel_lines=bent)) for frame, _ in moving_frames]
    assert verdicts(rested) == [False, False, False, True, True, True]
