"""Several frames joined for one view: registration, noise, weights, and pictures that must be left out."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform
from test_detect_coarse_to_fine import NONE, Oracle, check_lines, draw
from test_detect_scheduler import BLANK, BOX, HERE, OracleDetector

from deckline.config import Models, RunConfig
from deckline.dehaze.base import IdentityDehazer
from deckline.detect import joined as joined_module
from deckline.detect.anchors import NetworkOutput
from deckline.detect.coarse_to_fine import DetectConfig
from deckline.detect.crop import CONTRAST_FLOOR, Crop, crop_around, normalise, sample_crop
from deckline.detect.joined import MAX_AGE_S, FrameStack, view_joined, view_place_joined
from deckline.detect.motion import DeckMotion, KeptPicture, SeenMotion, plane_homography
from deckline.detect.registration import CELL_PX, grey, measure_affine, measure_shift
from deckline.detect.scheduler import SearchScheduler
from deckline.detect.search import Search
from deckline.flight import Flight
from deckline.geometry import Camera, attitude, intersect_plane
from deckline.types import Frame, RunwayPrior

CAMERA = Camera(256, 144, 640.0, 640.0, 127.5, 71.5)
CROP, SIZE = Crop(64.0, 36.0, 0.25), (512, 288)
RANGE_M, HEIGHT_M, STEP_S = 600.0, 120.0, 0.1
RUNWAY = RunwayPrior(np.array([[0.0, -12, 0], [200, -12, 0]]), np.array([[0.0, 12, 0], [200, 12, 0]]), 0.0, 0.0)
STILL = np.zeros(2)
FRAMES = 8


def texture(x_m, y_m, seed):
    """Grey levels of a deck: waves longer than what a pixel shows at this range."""
    rng = np.random.default_rng(seed)
    level = np.full(x_m.shape, 120.0)
    for _ in range(24):
        kx, ky = rng.choice([-1, 1], 2) * 2 * np.pi / rng.uniform([120.0, 15.0], [600.0, 90.0])
        level += 6.0 * np.sin(kx * x_m + ky * y_m + rng.uniform(0, 2 * np.pi))
    return level


def take(index, *, ahead_m=6.5, aside_m=0.3, seed=0, noise=2.0, gain=1.0, ship_m_s=STILL, pose_index=None):
    """One frame of a flight over a textured deck at z 0; `pose_index`: the frame whose pose it claims to have."""

    def pose(k):
        turn = attitude(0.01 * k, -0.197 + 0.002 * np.cos(k), 0.002 * np.sin(k))
        return RigidTransform.from_components([-RANGE_M + ahead_m * k, aside_m * k, -HEIGHT_M], turn)

    frame = Frame(
        f"{index}.png", index * STEP_S, np.zeros((144, 256, 3), np.uint8), CAMERA, world_from_body=pose(index)
    )
    v, u = np.mgrid[0:144, 0:256].astype(float)
    camera = frame.world_from_camera
    rays = camera.rotation.apply(CAMERA.rays(np.stack([u.ravel(), v.ravel()], axis=1)))
    on_deck = (
        intersect_plane(camera.translation, rays, 0.0).reshape(144, 256, 3) - np.array([*ship_m_s, 0.0]) * frame.time_s
    )
    level = np.nan_to_num(texture(on_deck[..., 0], on_deck[..., 1], seed), nan=120.0)
    grain = np.random.default_rng([seed, index]).normal(0.0, noise, (144, 256, 3))
    image = np.clip(np.rint(gain * level[..., None] + grain), 0, 255).astype(np.uint8)
    known = index if pose_index is None else pose_index
    return replace(frame, image_rgb=image, world_from_body=pose(known))


def stack_of(frames):
    stack = FrameStack(FRAMES)
    for frame in frames:
        stack.add(frame, frame.image_rgb)
    return stack


def join(frames, velocity=STILL):
    return stack_of(frames).join(CROP, SIZE, DeckMotion(RUNWAY, velocity))


def join_pictures(frames):
    return stack_of([replace(frame, world_from_body=None) for frame in frames]).join(CROP, SIZE, None)


def clean(index, **how):
    return sample_crop(take(index, noise=0.0, **how).image_rgb, CROP, SIZE)


def rms(pixels):
    return float(np.sqrt(np.nanmean(np.square(pixels))))


def test_a_crop_that_magnifies_is_joined_on_fewer_samples_and_shows_the_same(monkeypatch):
    stack = stack_of([take(k) for k in range(8)])
    box, motion = (100.0, 70.0, 124.0, 84.0), DeckMotion(RUNWAY, STILL)
    crop = crop_around(box, (256, 144), SIZE, 0.6, 24.0)
    fewer = stack.join(crop, SIZE, motion)
    monkeypatch.setattr(joined_module, "REDUCTIONS", (1,))
    all_samples = stack.join(crop, SIZE, motion)
    assert not np.array_equal(fewer.pixels, all_samples.pixels)
    assert fewer.frames == all_samples.frames == 8 and fewer.pixels.shape == all_samples.pixels.shape
    difference = rms(fewer.pixels - all_samples.pixels)
    assert difference < 0.02 * np.std(all_samples.pixels)


def test_the_homography_is_that_of_points_on_a_moving_plane():
    old, new, velocity = take(0), take(5), np.array([3.0, -2.0])
    kept = [KeptPicture(f.image_rgb, f.camera, f.world_from_camera, f.time_s) for f in (old, new)]
    pixels = np.array([[60.0, 90.0], [130.0, 75.0], [200.0, 140.0]])
    on_deck = intersect_plane(
        new.world_from_camera.translation, new.world_from_camera.rotation.apply(CAMERA.rays(pixels)), 0.0
    )
    earlier = on_deck - np.array([*velocity, 0.0]) * (new.time_s - old.time_s)
    expected = CAMERA.project(old.world_from_camera.inv().apply(earlier))
    rays = CAMERA.rays(pixels) @ plane_homography(*kept, 0.0, velocity).T
    np.testing.assert_allclose(CAMERA.project(rays), expected, atol=1e-9)
    assert plane_homography(*kept, -HEIGHT_M, velocity) is None  # as high as the camera


def test_pictures_of_a_flight_are_registered_to_a_tenth_of_a_pixel():
    joined = join([take(k, noise=0.0) for k in range(8)])
    assert joined.frames == 8
    shift_px = measure_shift(grey(clean(7)), grey(joined.pixels)) * CROP.step
    assert np.abs(shift_px).max() < 0.1
    assert rms(joined.pixels - clean(7)) < 1.0  # of a texture of 20 levels


@pytest.mark.parametrize("shift", [(0.0, 0.0), (7.3, -5.2), (-30.0, 21.0)])
def test_a_shift_is_measured_to_a_tenth_of_a_pixel_in_noise(shift):
    image, other = take(0).image_rgb, take(0, seed=0, noise=2.0).image_rgb
    reference = sample_crop(image, CROP, SIZE)
    moved = Crop(CROP.left - shift[0] * CROP.step, CROP.top - shift[1] * CROP.step, CROP.step)
    found = measure_shift(grey(reference), grey(sample_crop(other, moved, SIZE)))
    np.testing.assert_allclose(np.array(found) * CROP.step, np.multiply(shift, CROP.step), atol=0.1)
    assert measure_shift(grey(reference), grey(clean(0, seed=5))) is None
    far = Crop(CROP.left - 20 * CELL_PX * CROP.step, CROP.top, CROP.step)
    assert measure_shift(grey(reference), grey(sample_crop(image, far, SIZE))) is None
    small = grey(reference)[:64, :96]
    assert measure_shift(small, small) is None  # no larger than what is looked for


@pytest.mark.parametrize(("degrees", "zoom", "shift"), [(0.0, 1.0, (3.3, -2.1)), (2.0, 0.97, (0.0, 5.0))])
def test_a_turn_and_a_zoom_are_measured_in_noise(degrees, zoom, shift):
    sharp, (width, height) = grey(clean(0)), SIZE
    to_other = np.vstack([cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), degrees, zoom), [0, 0, 1]])
    to_other[:2, 2] += shift
    other = cv2.warpAffine(sharp, to_other[:2], SIZE, borderMode=cv2.BORDER_REFLECT)
    found = measure_affine(sharp, other + np.random.default_rng(0).normal(0.0, 4.0, other.shape).astype(np.float32))
    near = np.array([[150.0, 80.0, 1.0], [350.0, 200.0, 1.0]])
    np.testing.assert_allclose(near @ found.T, near @ to_other.T, atol=0.2 * CELL_PX)
    assert measure_affine(sharp, grey(clean(0, seed=5))) is None
    assert measure_affine(sharp, np.full_like(sharp, 120.0)) is None


@pytest.mark.parametrize("ahead_m", [6.5, 0.0])  # flying, and hovering without any baseline
def test_noise_falls_by_the_square_root_of_the_number(ahead_m):
    how = {"ahead_m": ahead_m, "aside_m": ahead_m / 20}
    frames = [take(k, **how) for k in range(8)]
    one, several, truth = sample_crop(frames[-1].image_rgb, CROP, SIZE), join(frames), clean(7, **how)
    assert several.frames == 8
    assert several.noise_gain == pytest.approx(1 / np.sqrt(8), rel=0.05)
    assert rms(several.pixels - truth) / rms(one - truth) < 1.2 / np.sqrt(8)


@pytest.mark.parametrize("ahead_m", [0.0, 6.5, 15.0])  # hovering, at 65 and at 150 m/s
def test_pictures_without_poses_are_joined_by_what_they_show(ahead_m):
    joined = join_pictures([take(k, ahead_m=ahead_m) for k in range(8)])
    assert joined.frames == 8
    assert rms(joined.pixels - clean(7, ahead_m=ahead_m)) < 3.0  # of a texture of 20 levels


def test_pictures_tell_how_fast_a_place_comes_nearer():
    motion = SeenMotion()
    assert stack_of([take(k, ahead_m=12.0) for k in range(8)]).join(CROP, SIZE, motion).frames == 8
    assert motion.expansion_per_s == pytest.approx(120.0 / 516.0, abs=0.03)


def test_the_contrast_floor_falls_with_the_noise():
    faint = np.zeros((288, 512, 3), np.float32)
    faint[:, ::2] = 2.0  # contrast of one grey level
    assert np.std(normalise(faint)) == pytest.approx(1 / CONTRAST_FLOOR, rel=0.01)
    assert np.std(normalise(faint, CONTRAST_FLOOR / np.sqrt(8))) == pytest.approx(np.sqrt(8) / CONTRAST_FLOOR, rel=0.01)


@pytest.mark.parametrize("join", [join, join_pictures])
def test_a_scene_cut_another_flight_and_a_picture_of_another_size_are_left_out(join):
    assert join([take(k, seed=9 * (k < 5)) for k in range(8)]).frames == 3
    assert join([take(k, seed=9 * (k % 2 == 0)) for k in range(8)]).frames == 4
    assert join([take(k, seed=9 * (k < 7)) for k in range(8)]) is None
    small = replace(take(0), image_rgb=take(0).image_rgb[::2, ::2], camera=Camera(128, 72, 320.0, 320.0, 63.5, 35.5))
    assert join([small, take(1), take(2)]).frames == 2


def test_a_pose_that_jumps_leaves_no_smeared_picture():
    frames = [take(k) for k in range(8)]
    pose = frames[3].world_from_body
    turned = RigidTransform.from_components(pose.translation, attitude(0.0, 0.0, 0.1) * pose.rotation)  # by 64 px
    frames[3] = replace(frames[3], world_from_body=turned)
    joined = join(frames)
    assert joined.frames == 7
    assert rms(joined.pixels - clean(7)) < 1.5


@pytest.mark.parametrize("lag", [1, 2])
def test_late_poses_are_made_good_by_the_picture(lag):
    joined = join([take(k, pose_index=max(k - lag, 0)) for k in range(8)])
    assert joined.frames >= 5
    assert rms(joined.pixels - clean(7)) < 2.5


def test_poses_that_stop_leave_no_smeared_picture():
    joined = join([take(k, pose_index=min(k, 4)) for k in range(8)])
    assert joined is None or rms(joined.pixels - clean(7)) < 0.3 * np.std(clean(7))


def test_a_ship_under_way_is_followed_by_its_velocity_or_the_picture():
    velocity = np.array([0.0, 8.0])
    frames = [take(k, ship_m_s=velocity) for k in range(8)]
    truth = clean(7, ship_m_s=velocity)
    for known in (velocity, STILL):
        joined = join(frames, known)
        assert joined.frames == 8
        assert rms(joined.pixels - truth) < 1.5


def test_exposure_that_flickers_is_brought_to_the_newest_frames():
    joined = join([take(k, gain=1.0 if k == 7 else 0.75 + 0.3 * (k % 2)) for k in range(8)])
    assert joined.frames == 8
    assert np.nanmean(joined.pixels) == pytest.approx(np.nanmean(clean(7)), rel=0.005)
    assert rms(joined.pixels - clean(7)) < 1.5
    assert join([take(0, gain=0.3), take(1, gain=1.0)]) is None  # another scene


def test_memory_and_age_are_bounded_and_repeated_pictures_count_once():
    stack = FrameStack(FRAMES)
    for k in range(30):
        frame = take(0)
        stack.add(replace(frame, time_s=k / 100), frame.image_rgb + np.uint8(k))
        assert len(stack) <= FRAMES
    assert len(stack) == FRAMES
    frame = take(0)
    stack.add(replace(frame, time_s=0.3), frame.image_rgb)
    stack.add(replace(frame, time_s=0.4), frame.image_rgb.copy())
    assert len(stack) == FRAMES
    stack.add(replace(frame, time_s=0.3 + MAX_AGE_S), take(1).image_rgb)
    assert len(stack) == 2
    stack.add(replace(frame, time_s=5.0), take(2).image_rgb)  # after a gap
    assert len(stack) == 1
    stack.add(replace(frame, time_s=5.1), take(3).image_rgb)
    assert len(stack) == 2
    stack.reset()
    assert stack.join(CROP, SIZE, DeckMotion(RUNWAY, STILL)) is None


def test_a_crop_that_shrinks_the_picture_is_not_joined():
    stack = stack_of([take(0), take(1)])
    assert stack.join(Crop(-40.0, 0.0, 1.1), SIZE, DeckMotion(RUNWAY, STILL)) is None


LEFT, RIGHT = HERE


def test_several_frames_are_viewed_once_and_only_where_one_is_not_sure():
    detector, seen, calls = OracleDetector(), draw((1280, 720), LEFT, RIGHT), []

    def joined(search, box):
        calls.append(box)
        return replace(detector.start_search(seen).search_prior(box), frames=8)

    scheduler, pictures = SearchScheduler(detector, 1.0), (seen, seen, BLANK)
    frames = [scheduler.detect(0.1 * k, picture, BOX, True, joined).frames for k, picture in enumerate(pictures)]
    assert frames == [1, 1, 8]
    assert len(calls) == 1


@pytest.mark.parametrize(("is_wide", "views"), [(False, 1), (True, 2)])
def test_a_wide_box_is_viewed_closer_before_pictures_are_joined(is_wide, views):
    before, wide = [], (490.0, 290.0, 810.0, 610.0)

    def joined(search, box):
        before.append(len(search.crops))

    scheduler = SearchScheduler(OracleDetector(config=DetectConfig(agreeing_probability=1.0)), 1.0)  # never sure
    scheduler.detect(0.0, BLANK, None, True)  # searched whole
    scheduler.detect(0.1, draw((1280, 720), LEFT, RIGHT), wide, True, joined, is_wide=is_wide)
    assert before == [views]


def test_a_joined_view_costs_one_inference_and_states_its_frames():
    oracle, stack = Oracle(), FrameStack(FRAMES)
    camera = Camera(1280, 720, 640.0, 640.0, 639.5, 359.5)
    rng = np.random.default_rng(0)
    sharp = draw((1280, 720), LEFT, RIGHT).astype(float)
    level = RigidTransform.from_components([-300.0, 0.0, -60.0], attitude(0.0, 0.0, 0.0))
    for k in range(4):
        image = np.clip(sharp + rng.normal(0, 2, sharp.shape), 0, 255).astype(np.uint8)
        frame = Frame(f"{k}", k / 30, image, camera, world_from_body=level)
        stack.add(frame, image)
    search = Search(image, oracle, DetectConfig())
    search.search_prior(BOX)
    before = len(oracle.views)
    view = view_joined(search, BOX, stack, DeckMotion(RUNWAY, STILL))
    assert len(oracle.views) == before + 1
    assert view.lines.frames == 4
    place = view_place_joined(search, BOX, stack, replace(frame, deck_z_m=0.0), STILL)
    assert (len(oracle.views), place.lines.frames) == (before + 2, 4)
    for joined in (view, place):
        check_lines(joined.lines, LEFT, RIGHT)
    assert view_place_joined(search, BOX, stack, frame, STILL).lines.frames == 4  # the deck's height is not known


class NoiseShy(Oracle):
    """Sees lines only in views whose noise is small beside them: blue has noise alone."""

    def __call__(self, view):
        noise = np.std(np.diff(view[2], axis=1))
        return super().__call__(view) if noise < 0.0125 * np.ptp(view[0]) else NetworkOutput(*NONE)


def test_a_flight_joins_its_frames_until_it_is_reset():
    lines = (613.9, 487.5, 624.1, 436.3), (665.1, 487.5, 654.9, 436.3)  # RUNWAY from 300 m before and 60 m above it
    sharp, rng = draw((1280, 720), *lines).astype(float), np.random.default_rng(0)
    camera, deck = Camera(1280, 720, 640.0, 640.0, 639.5, 359.5), replace(RUNWAY, sigma_m=2.0)
    place = RigidTransform.from_components([-300.0, 0.0, -60.0], attitude(0.0, 0.0, 0.0))

    def fly(flight, count):
        for k in range(count):
            image = np.clip(np.rint(30 + 0.5 * sharp + rng.normal(0, 8.0, sharp.shape)), 0, 255).astype(np.uint8)
            frame = Frame(f"{k}", k / 30, image, camera, world_from_body=place, deck_z_m=0.0)
            yield flight(frame, prior=deck).detection

    with Flight(RunConfig(), IdentityDehazer(), OracleDetector(NoiseShy())) as flight:
        frames = [detection.frames for detection in fly(flight, 10)]
        assert frames[0] == 1 and frames[-1] == RunConfig().models.join_frames
        flight.reset()
        first, *_, last = fly(flight, 6)
        assert (first.frames, len(first.left), last.frames) == (1, 0, 6)
        check_lines(last, *lines)
    with Flight(RunConfig(models=Models(join_frames=1)), IdentityDehazer(), OracleDetector(NoiseShy())) as flight:
        assert {detection.frames for detection in fly(flight, 10)} == {1}
