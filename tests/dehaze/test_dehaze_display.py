from dataclasses import replace

import numpy as np
import pytest

from approach_scene import Halved, frame
from deckline.config import Models
from deckline.dehaze import DehazeResult, dehaze_for_display, dehaze_frame
from deckline.dehaze.base import IdentityDehazer
from deckline.geometry import Camera
from deckline.types import Value
from picture_scene import picture_result


class ByHorizon(IdentityDehazer):
    def restore(self, frame):
        return DehazeResult(frame.image_rgb.copy(), visibility_heights=Value(20.0, 2.0))


class Refusing(IdentityDehazer):
    def __call__(self, image_rgb):
        raise ValueError("no such\nimage")


@pytest.mark.parametrize(("height_m", "visibility_m"), [(None, None), (15.0, (300.0, 30.0))])
def test_the_cameras_height_gives_the_visibility_in_metres(height_m, visibility_m):
    found = dehaze_frame(frame(), ByHorizon(), Models(camera_height_m=height_m)).visibility_m
    assert (found and (found.value, found.sigma)) == visibility_m


@pytest.mark.parametrize(("long_side_px", "size"), [(None, (180, 320)), (640, (180, 320)), (160, (90, 160))])
def test_a_picture_has_at_most_the_longer_side_that_is_asked_for(long_side_px, size):
    at = frame()
    dehazed = dehaze_frame(at, IdentityDehazer(), long_side_px=long_side_px)
    assert dehazed.image_rgb.shape == (*size, 3)
    assert not np.shares_memory(dehazed.image_rgb, at.image_rgb)


def test_a_frame_that_the_dehazer_refuses_is_shown_as_it_is_with_the_reason():
    shown = dehaze_for_display(frame(), Refusing(), long_side_px=320)
    np.testing.assert_array_equal(shown.image_rgb, frame().image_rgb)
    assert shown.note == "not dehazed: no such image"
    with pytest.raises(ValueError, match="no such"):
        dehaze_frame(frame(), Refusing())


@pytest.mark.parametrize(("strength", "level"), [(0.0, 120), (0.5, 90), (1.0, 60)])
def test_the_stated_strength_is_used(strength, level):
    assert np.all(dehaze_frame(frame(), Halved(), Models(strength=strength)).image_rgb == level)


@pytest.mark.parametrize("is_assumed", [True, False])
def test_a_pose_of_the_picture_and_an_assumed_camera_dehaze_as_the_frame_that_came(is_assumed):
    given = []

    class Watching(IdentityDehazer):
        def restore(self, frame):
            given.append(frame)
            return DehazeResult(frame.image_rgb.copy())

    at = picture_result().frame
    camera = Camera.assumed(at.camera.width, at.camera.height) if is_assumed else at.camera
    dehaze_frame(replace(at, camera=camera, deck_z_m=0.0), Watching())
    (found,) = given
    assert (found.world_from_body, found.deck_z_m, found.camera.known) == (None, None, not is_assumed)
