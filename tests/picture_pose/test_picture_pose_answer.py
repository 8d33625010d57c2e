from dataclasses import replace

import numpy as np

from approach_scene import CAMERA, frame
from deckline.picture_pose.answer import with_camera
from deckline.picture_pose.states import Belief, States


def test_the_camera_of_an_answer_gives_the_rays_that_its_belief_corrects():
    mean = np.zeros(States.SIZE)
    mean[[States.FOCAL, States.CX, States.CY]] = 0.1, 0.03, -0.02
    belief = Belief(0.0, np.eye(3), mean, np.eye(States.SIZE))
    blind = replace(frame(), world_from_body=None)
    pixels = np.array([[10.0, 20.0], [300.0, 170.0], [CAMERA.cx, CAMERA.cy]])
    found = with_camera(blind, belief).camera
    corrected = (CAMERA.rays(pixels) - [0.03, -0.02, 0.0]) / [1.1, 1.1, 1.0]
    np.testing.assert_allclose(found.rays(pixels), corrected, atol=1e-12)
    assert np.abs(found.project(CAMERA.rays(pixels)) - pixels).max() > 5.0
