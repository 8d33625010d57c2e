"""What is carried from picture to picture, without any pose."""

from dataclasses import replace

import numpy as np
import pytest

from deckline.detect.prior import ImagePrior
from deckline.geometry import Camera
from deckline.types import DepthMode, Detection, Frame, LinePoints, RunwayEstimate, Status

CAMERA = Camera.from_fov(1280, 720, np.deg2rad(90))
LEFT, RIGHT = np.array([[600.0, 400.0], [560.0, 500.0]]), np.array([[640.0, 400.0], [700.0, 510.0]])
DETECTION = Detection(*(LinePoints(points, np.ones(2), np.full(2, 0.3)) for points in (LEFT, RIGHT)))
SEEN = RunwayEstimate(Status.OK, DepthMode.NONE, {}, {})


def frame_at(time_s: float) -> Frame:
    return Frame("f", time_s, np.zeros((720, 1280, 3), np.uint8), CAMERA)


def test_the_last_box_is_carried_with_half_its_longer_side_around_it():
    memory = ImagePrior()
    assert memory.predict(frame_at(0.0)) is None
    memory.update(frame_at(0.0), DETECTION, SEEN)
    later = frame_at(0.2)
    assert memory.predict(later) == (560.0 - 70, 400.0 - 70, 700.0 + 70, 510.0 + 70)
    smaller = replace(later, camera=CAMERA.resized(640, 360), image_rgb=later.image_rgb[::2, ::2])
    assert memory.predict(smaller) is None


@pytest.mark.parametrize("time_s", [9.9, 15.1, np.nan])
def test_what_is_old_or_of_another_flight_is_forgotten(time_s):
    memory = ImagePrior()
    memory.update(frame_at(10.0), DETECTION, SEEN)
    assert memory.predict(frame_at(time_s)) is None
    assert memory.predict(frame_at(10.0)) is None


@pytest.mark.parametrize("status", [Status.ONE_LINE, Status.NOT_SEEN])
def test_what_was_not_seen_whole_replaces_nothing(status):
    memory, later = ImagePrior(), frame_at(1.0)
    memory.update(frame_at(0.0), DETECTION, SEEN)
    before = memory.predict(later)
    memory.update(frame_at(0.5), Detection(DETECTION.left, LinePoints.empty()), replace(SEEN, status=status))
    assert memory.predict(later) == before
