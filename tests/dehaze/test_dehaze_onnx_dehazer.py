"""Images to tensors and back, and the network's image blended with geometry's."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sea_scene import CAMERA, frame_of, ray_z, sea_pair, world_from_body

from deckline.config import Engine
from deckline.dehaze import OnnxDehazer, by_pose
from deckline.dehaze.base import mix
from deckline.dehaze.by_pose import GeometryDehazer, GeometrySolution
from deckline.dehaze.onnx_dehazer import CHANGE_LEVELS, change_share, darkest_detail, fit_to_angles, limit_change
from deckline.dehaze.tensors import (
    MIN_SIDE_PX,
    average_down,
    image_to_tensor,
    pad,
    reduction_factor,
    tensor_to_image,
    upsample_guided,
)
from deckline.haze import beta_from_visibility
from deckline.runtime import shipped_weights
from deckline_lab.evaluation.metrics import psnr_db


def shipped(**given: bool) -> OnnxDehazer:
    return OnnxDehazer(shipped_weights("coarse-t"), engine=Engine(threads=1), **given)


def network(level: int) -> np.ndarray:
    return np.full((40, 64, 3), level, np.uint8)


@pytest.mark.parametrize(
    ("apart", "moved"), [(0, 0), (5, 0.3 * 5 / (1 + 1 / 16)), (20, 3), (60, 1.8), (150, 45 / 57.25)]
)
def test_the_network_moves_geometry_where_they_agree_and_never_far(apart: int, moved: float) -> None:
    ours, theirs = network(100 + apart), network(100)
    np.testing.assert_allclose(limit_change(theirs, ours), moved, atol=1e-3)
    np.testing.assert_allclose(limit_change(ours, theirs), -moved, atol=1e-3)
    assert (ours == 100 + apart).all()
    assert (theirs == 100).all()


def test_what_the_network_paints_is_held_to_the_angle_below_the_horizontal() -> None:
    """A gain and an offset that change with the angle are kept; a cloud that it adds is not."""
    rng = np.random.default_rng(4)
    image = rng.integers(60, 140, (90, 160, 3), dtype=np.uint8)
    down = np.linspace(-0.1, 0.4, 90, dtype=np.float32)[:, None].repeat(160, axis=1)
    gain = 1 + 2 * np.clip(down, 0, 1)[..., None]
    wanted = np.clip(gain * (image - 50.0) + 20, 0, 255)
    cloudy = wanted.copy()
    cloudy[30:60, :16] -= 20
    held = fit_to_angles(image, np.rint(cloudy).astype(np.uint8), down)(image)
    apart = held.astype(float) - wanted
    assert np.abs(apart[8:-8]).mean() < 4
    assert abs(apart[30:60, :16].mean() - apart[30:60, 16:].mean()) < 1


def test_a_picture_that_shows_nothing_gets_no_texture() -> None:
    """The network draws a pattern into a plain grey; held to the angle it is a smooth change."""
    rng = np.random.default_rng(5)
    plain = (140 + rng.normal(0, 1, (90, 160, 1))).round().astype(np.uint8).repeat(3, axis=2)
    pattern = np.clip(plain + 30 * np.sin(np.arange(160) / 3)[None, :, None] - 20, 0, 255).astype(np.uint8)
    down = np.linspace(0, 0.4, 90, dtype=np.float32)[:, None].repeat(160, axis=1)
    held = fit_to_angles(plain, pattern, down)(plain)
    assert held.std() < 2
    assert held.mean() == pytest.approx(pattern.mean(), abs=1)


@pytest.mark.parametrize(
    ("certainty", "done"), [(0.0, CHANGE_LEVELS[0]), (0.05, CHANGE_LEVELS[0]), (0.5, 20), (1.0, 40)]
)
def test_without_certainty_a_clear_image_retains_32_db(certainty: float, done: float) -> None:
    image = network(100)
    limited = mix(image, network(60), change_share(image, network(60), certainty))
    np.testing.assert_array_equal(limited, 100 - done)
    assert (psnr_db(limited, image) > 32) == (certainty < 0.5)


def test_the_change_is_limited_in_the_picture_that_comes_out_not_in_the_small_one(monkeypatch) -> None:
    """Fine waves that vanish in the picture that the network sees: their contrast is raised only as far as allowed."""
    pose = world_from_body(-22.0, 0.0)
    camera = CAMERA.resized(1280, 720)
    down = np.clip(ray_z(pose), 0.1, 1).repeat(4, axis=0).repeat(4, axis=1)[..., None]
    waves = np.random.default_rng(6).normal(0, 20, (720, 1280, 1))
    levels = np.clip(110 + 30 * (1 - down) ** 5 + waves, 0, 255).repeat(3, axis=2)
    image = np.rint(levels).astype(np.uint8)
    frame = replace(frame_of(image[::4, ::4], world_from_body=pose), image_rgb=image, camera=camera)
    dehazer = shipped()
    raised = np.clip(3.0 * np.arange(256) - 250, 0, 255).astype(np.uint8)
    monkeypatch.setattr(OnnxDehazer, "_run", lambda _, image, prior: raised[image])
    result = []
    for hidden in (0.0, 1.0):
        monkeypatch.setattr(by_pose, "hidden_sea_certainty", lambda image, view, hidden=hidden: hidden)
        result.append(psnr_db(dehazer.restore(frame).image_rgb, image))
    assert result[0] > 32
    assert result[1] < 28


def test_an_impossible_pose_leaves_the_image_with_its_reason() -> None:
    image = sea_pair(1e-3)[0]
    restored = shipped().restore(frame_of(image, world_from_body=world_from_body(eye_z_m=20.0)))
    assert "below the sea" in restored.note
    np.testing.assert_array_equal(restored.image_rgb, image)


def test_the_darkest_detail_is_a_share_of_the_brightest() -> None:
    image = np.full((180, 320, 3), 150, np.uint8)
    assert darkest_detail(image) == 0  # nothing stands out
    image[:10], image[10:20] = 50, 200
    assert darkest_detail(image) == pytest.approx(0.25)
    image[:10] = 0
    assert darkest_detail(image) == 0


def test_without_a_horizon_only_a_sea_that_haze_hides_is_changed_much() -> None:
    """Grey water looked down upon: a clear sea brightens up to the upper edge, a hazy one in the lower half only."""
    pose = world_from_body(-22.0, 0.0)
    down = np.clip(ray_z(pose), 0.1, 1)
    dehazer, kept = shipped(), []
    for levels in (90 + 100 * (1 - down) ** 5, 190 - 240 * np.exp(-0.6 / down)):
        image = np.repeat(np.rint(levels)[..., None], 3, axis=2).astype(np.uint8)
        assert 0.45 < darkest_detail(image) < 0.75  # which tells nothing
        kept.append(psnr_db(dehazer.restore(frame_of(image, world_from_body=pose)).image_rgb, image))
    assert kept[0] > 32
    assert kept[1] < 28


def test_a_clear_sea_that_the_network_alone_takes_for_a_hazy_one_is_unchanged() -> None:
    """Bright grey water under a sky like it: only the pose shows that it does not fade."""
    _, clear = sea_pair(beta_from_visibility(1200.0))
    image = np.rint(0.35 * clear + 0.65 * np.array([150.0, 165.0, 180.0])).astype(np.uint8)
    frame = frame_of(image)
    assert isinstance(GeometryDehazer().solve(frame), GeometrySolution)
    alone, both = (psnr_db(shipped(network_only=only).restore(frame).image_rgb, image) for only in (True, False))
    assert alone < 28
    assert both > 32


def test_every_level_survives_the_round_trip_and_values_outside_the_range_are_clipped() -> None:
    image = np.arange(256, dtype=np.uint8).reshape(16, 16, 1).repeat(3, axis=2)
    tensor = image_to_tensor(image)
    assert (tensor.shape, tensor.dtype) == ((1, 3, 16, 16), np.float32)
    assert (tensor.min(), tensor.max()) == (0.0, 1.0)
    np.testing.assert_array_equal(tensor_to_image(tensor), image)
    values = np.array([-np.inf, -0.4, 1.2, 300.0, np.inf, np.nan], dtype=np.float32)
    image = tensor_to_image(np.broadcast_to(values, (1, 3, 1, 6)))
    np.testing.assert_array_equal(image[0, :, 0], [0, 0, 255, 255, 255, 0])


@pytest.mark.parametrize(
    ("size", "factor"), [((720, 1280), 2), ((360, 640), 1), ((1080, 1920), 3), ((100, 100), 1), ((640, 480), 1)]
)
def test_reduction_factor(size: tuple[int, int], factor: int) -> None:
    assert reduction_factor(*size, working_long_side_px=640) == factor


def test_averaging_is_the_mean_of_blocks() -> None:
    tensor = np.arange(24, dtype=np.float32).reshape(1, 1, 4, 6)
    np.testing.assert_allclose(average_down(tensor, 2)[0, 0], [[3.5, 5.5, 7.5], [15.5, 17.5, 19.5]])


@given(st.integers(1, 150), st.integers(1, 150), st.integers(1, 12))
def test_padding_reaches_the_multiple_beside_the_image(height: int, width: int, multiple: int) -> None:
    image = np.random.default_rng(0).integers(0, 256, (height, width, 3), dtype=np.uint8)
    for least in (MIN_SIDE_PX, 70):
        out = pad(image, multiple, least)
        assert out.shape[0] % multiple == out.shape[1] % multiple == 0
        assert least <= out.shape[0] < max(height, least) + multiple
    np.testing.assert_array_equal(out[:height, :width], image)
    np.testing.assert_array_equal(out[-1, :width], out[height - 1, :width])


def test_errors() -> None:
    with pytest.raises(ValueError, match=r"5x4.*\b2\b"):
        average_down(np.zeros((1, 3, 4, 5), dtype=np.float32), 2)
    with pytest.raises(ValueError, match=r"working_long_side_px.*32.*\b3\b"):
        reduction_factor(10, 10, 3)
    with pytest.raises(ValueError, match="float64"):
        image_to_tensor(np.zeros((2, 2, 3)))


def test_a_linear_change_is_brought_up_exactly() -> None:
    """Where the result is a brightness times the picture plus an offset, full size shows it at every pixel."""
    blocks = np.random.default_rng(0).random((1, 3, 16, 24), dtype=np.float32)
    image = np.kron(blocks, np.ones((1, 1, 4, 4), np.float32))
    small = average_down(image, 4)
    # The ridge, 1e-4 on a variance of 1 / 12, takes 0.12 % off the slope.
    np.testing.assert_allclose(upsample_guided(image, small, 1.7 * small - 0.3, 4), 1.7 * image - 0.3, atol=0.003)
    assert upsample_guided(small, small, small, 1) is small
