from dataclasses import replace

import numpy as np
import pytest
from sea_scene import CAMERA, frame_of, sea_pair, world_from_body

from deckline.dehaze.base import IdentityDehazer
from deckline.dehaze.by_horizon import HorizonDehazer, attitude_from_horizon, find_horizon_of
from deckline.dehaze.horizon import Horizon, NoHorizon
from deckline.geometry import Camera, camera_mount
from deckline.haze import beta_from_visibility
from deckline_lab.evaluation.metrics import psnr_db
from runway_scene import horizon_line

HEIGHT_M = 60.0


def alone(image: np.ndarray) -> object:
    return frame_of(image, world_from_body=None, deck_z_m=None)


@pytest.mark.parametrize(("pitch_deg", "roll_deg"), [(-8.0, 3.0), (5.0, -20.0), (0.0, 0.0)])
def test_a_horizon_gives_the_attitude_that_drew_it(pitch_deg: float, roll_deg: float) -> None:
    camera = replace(CAMERA, cx=CAMERA.cx + 12, cy=CAMERA.cy - 7)
    true = (world_from_body(pitch_deg, roll_deg) * camera_mount()).rotation
    middle, slope = horizon_line(camera, true)
    found = attitude_from_horizon(camera, Horizon(camera.width, middle, 1.0, slope, 0.01))
    np.testing.assert_allclose(found.as_matrix()[2], true.as_matrix()[2], atol=1e-9)


@pytest.mark.parametrize("visibility_m", [800.0, 2000.0])
def test_a_sea_without_pose_comes_nearer_to_the_clear_one_with_its_visibility(visibility_m: float) -> None:
    hazy, clear = sea_pair(beta_from_visibility(visibility_m))
    restored = HorizonDehazer().restore(alone(hazy))
    heights = restored.visibility_heights
    assert abs(heights.value - visibility_m / HEIGHT_M) < 2 * heights.sigma + 0.05 * heights.value
    assert heights.sigma < heights.value
    assert psnr_db(restored.image_rgb, clear) > psnr_db(hazy, clear) + 3


@pytest.mark.parametrize(
    ("known", "share", "is_dehazed"), [(True, 0.025, True), (False, 0.025, False), (False, 0.01, True)]
)
def test_a_camera_that_is_not_known_needs_a_surer_horizon(known, share, is_dehazed, monkeypatch):
    hazy, _ = sea_pair(beta_from_visibility(1000.0))
    frame = alone(hazy) if known else replace(alone(hazy), camera=Camera.unknown(CAMERA.width, CAMERA.height))
    found = find_horizon_of(frame)
    assert isinstance(found, Horizon)
    vague = replace(found, middle_sigma_px=share * CAMERA.height)
    monkeypatch.setattr("deckline.dehaze.by_horizon.find_horizon_of", lambda frame: vague)
    restored = HorizonDehazer(IdentityDehazer()).restore(frame).image_rgb
    assert np.array_equal(restored, hazy) != is_dehazed


@pytest.mark.parametrize("level", [0, 128, 255])
def test_leaves_pictures_without_a_horizon_to_the_other(level: int) -> None:
    image = np.full((90, 160, 3), level, np.uint8)
    np.testing.assert_array_equal(HorizonDehazer(IdentityDehazer())(image), image)
    restored = HorizonDehazer().restore(alone(np.full((180, 320, 3), level, np.uint8)))
    assert restored.visibility_heights is None


def test_a_lens_that_bends_lines_has_no_straight_horizon() -> None:
    image, _ = sea_pair(1e-3)
    bent = replace(alone(image), camera=replace(CAMERA, distortion=(-0.2, 0.0, 0.0, 0.0, 0.0)))
    assert isinstance(find_horizon_of(bent), NoHorizon)
