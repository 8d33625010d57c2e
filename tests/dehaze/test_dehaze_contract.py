"""What holds for every dehazer: on images alone, on frames with a pose, and at the edge of what cameras give."""

import dataclasses
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest
from odd_pictures import draw
from sea_scene import AIRLIGHT, CAMERA, frame_of, ray_z, sea_pair, world_from_body

from deckline.config import Engine
from deckline.dehaze import Dehazer, OnnxDehazer, restore
from deckline.haze import beta_from_visibility
from deckline.runtime import shipped_weights
from deckline.types import Frame
from deckline_lab.evaluation.metrics import psnr_db
from deckline_lab.rivals.catalog import ALL_DEHAZERS
from deckline_sim import SimConfig, frames

BETA = beta_from_visibility(1200.0)
CLEAR_DB = 32.0  # a clear image comes out at least this near to itself
# What has to see haze before it acts. The dark channel prior takes every image for a hazy one (11 to 20 dB).
KEEP_CLEAR = ("none", "geometry")


@pytest.fixture(scope="module", params=list(ALL_DEHAZERS))
def dehazer(request: pytest.FixtureRequest) -> Dehazer:
    return ALL_DEHAZERS[request.param]()


def sized(image: np.ndarray) -> Frame:
    """A frame with pose and deck height of an image of any size."""
    return frame_of(image, camera=CAMERA.resized(image.shape[1], image.shape[0]))


def random_image(height: int, width: int) -> np.ndarray:
    return np.random.default_rng([height, width]).integers(0, 256, (height, width, 3), dtype=np.uint8)


@pytest.mark.parametrize("with_pose", [False, True])
@pytest.mark.parametrize("size", [(1, 1), (1, 40), (7, 1), (2, 3), (33, 31), (97, 203), (361, 1283)])
def test_shape_type_determinism_and_input(dehazer: Dehazer, size: tuple[int, int], with_pose: bool) -> None:
    image = random_image(*size)
    before = image.copy()
    first, second = (restore(dehazer, sized(image)).image_rgb if with_pose else dehazer(image) for _ in range(2))
    assert first.shape == image.shape
    assert first.dtype == np.uint8
    np.testing.assert_array_equal(first, second)
    np.testing.assert_array_equal(image, before)
    assert not np.shares_memory(first, image)


@pytest.mark.parametrize("size", [(1, 1), (31, 33), (64, 96)])
@pytest.mark.parametrize("level", [0, 255])
def test_extremes_stay_in_range(dehazer: Dehazer, size: tuple[int, int], level: int) -> None:
    """A wrapped value would make white from black; half the range is far from either."""
    image = np.full((*size, 3), level, dtype=np.uint8)
    for result in (dehazer(image), restore(dehazer, sized(image)).image_rgb):
        if dehazer.name in KEEP_CLEAR:
            assert (result == level).all()
        if level == 0:
            assert result.mean() < 128


def test_read_only_and_strided_input(dehazer: Dehazer) -> None:
    image = random_image(48, 80)[:, ::-1]
    image.flags.writeable = False
    np.testing.assert_array_equal(dehazer(image), dehazer(image.copy()))


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (np.zeros((4, 4, 3), dtype=np.float32), "float32"),
        (np.zeros((4, 4), dtype=np.uint8), r"\(4, 4\)"),
        (np.zeros((4, 4, 4), dtype=np.uint8), r"\(4, 4, 4\)"),
        (np.zeros((0, 4, 3), dtype=np.uint8), r"\(0, 4, 3\)"),
    ],
)
def test_wrong_images_are_refused(dehazer: Dehazer, image: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        dehazer(image)


def test_the_shipped_network_leaves_images_without_a_pose_to_the_horizon() -> None:
    hazy, _ = sea_pair(BETA)
    frame = dataclasses.replace(frame_of(hazy), world_from_body=None)
    other, shipped = ALL_DEHAZERS["horizon"](), ALL_DEHAZERS["coarse-t"]()
    np.testing.assert_array_equal(shipped(hazy), other(hazy))
    np.testing.assert_array_equal(restore(shipped, frame).image_rgb, other(hazy))


def test_names_are_their_keys() -> None:
    assert {key: build().name for key, build in ALL_DEHAZERS.items()} == {key: key for key in ALL_DEHAZERS}


def test_a_model_of_another_kind_is_refused() -> None:
    with pytest.raises(ValueError, match=r"\.onnx.*'dehaze'"):
        OnnxDehazer(shipped_weights("hybrid"))


@pytest.mark.parametrize("name", ["none", "geometry"])
def test_4k_agrees_with_a_third_of_its_width(name: str) -> None:
    """The dark channel prior and the network take seconds at 3840x2160."""
    hazy, _ = sea_pair(BETA)
    small = cv2.resize(hazy, (1280, 720), interpolation=cv2.INTER_LINEAR)
    large = cv2.resize(hazy, (3840, 2160), interpolation=cv2.INTER_LINEAR)
    results = [restore(ALL_DEHAZERS[name](), sized(image)) for image in (large, small)]
    assert results[0].image_rgb.shape == (2160, 3840, 3)
    assert results[0].note == results[1].note == ""
    averaged = cv2.resize(results[0].image_rgb, (1280, 720), interpolation=cv2.INTER_AREA)
    assert psnr_db(averaged, results[1].image_rgb) > 35


def test_contrast_beyond_the_range_is_clipped_not_wrapped(dehazer: Dehazer) -> None:
    """White and black far away, where no haze would let so much light or dark through: they stay white and black."""
    hazy, _ = sea_pair(BETA)
    white, black = np.s_[60:70, 60:90], np.s_[60:70, 200:230]
    hazy[white], hazy[black] = 255, 0
    result = restore(dehazer, frame_of(hazy)).image_rgb
    assert result[62:68, 64:86].min() > 200
    assert result[62:68, 204:226].max() < 60


def test_night_stays_night(dehazer: Dehazer) -> None:
    image = np.random.default_rng(7).poisson(3.0, (180, 320, 3)).astype(np.uint8)
    lamps = np.s_[120:123, 100:220:12]
    image[lamps] = 255
    restored = restore(dehazer, frame_of(image))
    assert np.median(restored.image_rgb) < 12
    assert restored.image_rgb[lamps].mean() > 150
    if dehazer.name.startswith("geometry"):
        assert "too dark to see the haze" in restored.note
        np.testing.assert_array_equal(restored.image_rgb, image)


def test_unknown_depth_changes_nothing_and_one_bad_depth_no_other_pixel(dehazer: Dehazer) -> None:
    image, depth = sea_pair(BETA)[0], np.full((180, 320), 150.0, np.float32)
    holes = depth.copy()
    holes[100, 50], holes[100, 150] = np.nan, np.inf
    given = (None, depth * np.nan, depth * np.inf, depth, holes)
    without, *unknown, whole, spoilt = (restore(dehazer, frame_of(image, depth_m=each)).image_rgb for each in given)
    np.testing.assert_array_equal(unknown, [without, without])
    elsewhere = np.isfinite(holes)
    # A network looks at the whole picture: two other pixels may move every one by rounding.
    most = 1 if isinstance(dehazer, OnnxDehazer) else 0
    assert np.abs(spoilt[elsewhere].astype(int) - whole[elsewhere]).max() <= most


@pytest.fixture(scope="module")
def clear_frames() -> list[Frame]:
    """Clear views of the paper's deck, and of random ships in other light."""
    config = SimConfig(trajectory="random", visibility_m=(500, 2000), seed=1101, width=480, height=270, frames=2)
    config = dataclasses.replace(config, frames_per_ship=1)
    both = (("paper", (60.0, 800.0)), ("train", (30.0, 1500.0)))
    configs = [dataclasses.replace(config, preset=preset, range_m=range_m) for preset, range_m in both]
    hazy = [frame for config in configs for frame in frames(config)]
    return [dataclasses.replace(frame, image_rgb=frame.truth.clear_rgb, depth_m=None) for frame in hazy]


@pytest.mark.parametrize("name", [*KEEP_CLEAR, "coarse-t"])
def test_an_image_without_haze_is_nearly_unchanged(clear_frames: list[Frame], name: str) -> None:
    """The network leaves not every one: docs/experiments/2026-11-dehazing-blend.md has the figures."""
    bare = [dataclasses.replace(frame, world_from_body=None) for frame in clear_frames[:2]]
    dehazer = OnnxDehazer(shipped_weights(name)) if name == "coarse-t" else ALL_DEHAZERS[name]()
    for frame in [*clear_frames, *bare]:
        assert psnr_db(restore(dehazer, frame).image_rgb, frame.image_rgb) >= CLEAR_DB


def test_threads_do_not_mix_pictures(dehazer: Dehazer) -> None:
    """One dehazer, asked from four threads at once."""
    pictures = [np.clip(sea_pair(BETA * (1 + k))[0] + np.uint8(2 * k), 0, 255) for k in range(4)]
    alone = [restore(dehazer, frame_of(picture)).image_rgb for picture in pictures]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda picture: restore(dehazer, frame_of(picture)).image_rgb, pictures))
    for a, b in zip(alone, together, strict=True):
        np.testing.assert_array_equal(a, b)


def test_the_networks_threads_change_no_level() -> None:
    image = sea_pair(BETA)[0]
    one, two = (OnnxDehazer(shipped_weights("coarse-t"), engine=Engine(threads=threads))(image) for threads in (1, 2))
    assert np.abs(one.astype(int) - two).max() <= 1


def test_haze_is_thinned_where_it_is_known(dehazer: Dehazer) -> None:
    """Whatever acts at all takes the near sea away from the airlight; no test here is passed by doing nothing."""
    hazy, _ = sea_pair(BETA)
    near = ray_z(world_from_body()) > 60 / 400
    before = np.abs(hazy[near] - AIRLIGHT).mean()
    after = np.abs(restore(dehazer, frame_of(hazy)).image_rgb[near] - AIRLIGHT).mean()
    assert after >= before - 0.5
    if dehazer.name != "none":
        assert after > before + 5


@pytest.mark.parametrize("strength", [0.0, 0.25, 1.0])
def test_strength_is_the_share_of_the_removal(dehazer: Dehazer, strength: float) -> None:
    hazy, _ = sea_pair(BETA)
    full = restore(dehazer, frame_of(hazy)).image_rgb.astype(float)
    part = restore(dehazer, frame_of(hazy), strength).image_rgb
    assert part is not hazy
    np.testing.assert_allclose(part, hazy + strength * (full - hazy), atol=0.51)


ODD = draw(np.random.default_rng(0))
ON_LAND = ("snow", "indoor")
CAST_LEVELS, CHANGE_LEVELS = 4.0, 16.0  # of the mean colour against the mean grey; rms


@pytest.mark.parametrize(
    ("picture", "with_pose"),
    # A pose that puts a sea into a room or a field of snow misleads.
    [(picture, with_pose) for picture in ODD for with_pose in (False, True) if not (with_pose and picture in ON_LAND)],
)
@pytest.mark.parametrize("name", ["coarse-t", "veil"])
def test_pictures_that_are_no_haze_at_sea_stay_nearly_as_they_are(name: str, picture: str, with_pose: bool) -> None:
    image = ODD[picture]
    frame = sized(image) if with_pose else dataclasses.replace(sized(image), world_from_body=None)
    restored = restore(ALL_DEHAZERS[name](), frame)
    change = restored.image_rgb.astype(float) - image
    by_channel = change.mean(axis=(0, 1))
    assert np.abs(by_channel - by_channel.mean()).max() < CAST_LEVELS
    assert np.sqrt(np.mean(change**2)) < CHANGE_LEVELS
    assert restored.note or change.any()
    if not np.ptp(image, axis=2).any():
        assert np.ptp(restored.image_rgb, axis=2).max() <= 1  # grey stays grey
    if not image.std() > 1:
        assert not change.any()
