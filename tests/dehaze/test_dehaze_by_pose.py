import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform
from sea_scene import AIRLIGHT, CAMERA, DECK_Z_M, EYE_Z_M, SEA_Z_M, frame_of, ray_z, sea_pair, world_from_body

from deckline.dehaze import GeometryDehazer
from deckline.dehaze.by_pose import downscale_frame, invert_haze, measure_sky_noise, with_noise
from deckline.dehaze.filters import estimate_noise
from deckline.dehaze.haze_fit import HazeFit, NoFit
from deckline.dehaze.pixel_map import luma
from deckline.dehaze.sea_view import SeaView, view_sea
from deckline.dehaze.transmission import GeometryConfig
from deckline.geometry import camera_mount
from deckline.haze import beta_from_visibility, visibility_from_beta
from deckline.types import Frame
from deckline_lab.evaluation.metrics import below_horizon, psnr_db
from deckline_sim import SimConfig, frames

BETA = beta_from_visibility(1200.0)


def dehaze(image: np.ndarray, **changes: object) -> np.ndarray:
    """An image of the sea through the geometry dehazer, with the frame's pose and deck height unless changed."""
    return GeometryDehazer().restore(frame_of(image, **changes)).image_rgb


@pytest.fixture(scope="module")
def rendered() -> list[Frame]:
    """Frames that nothing was tuned on."""
    return list(
        frames(SimConfig(trajectory="random", visibility_m=(500, 2000), seed=1100, width=480, height=270, frames=4))
    )


def test_rendered_frames_come_much_nearer_to_the_clear_ones(rendered):
    gains = []
    for frame in rendered:
        sea = below_horizon(frame.camera, frame.world_from_camera)
        after = psnr_db(GeometryDehazer().restore(frame).image_rgb, frame.truth.clear_rgb, sea)
        gains.append(after - psnr_db(frame.image_rgb, frame.truth.clear_rgb, sea))
    assert min(gains) > 5
    assert np.median(gains) > 10


def test_the_sea_height_is_the_frames():
    hazy, _ = sea_pair(BETA)
    as_config = GeometryDehazer(GeometryConfig(sea_below_deck_m=12.0)).restore(frame_of(hazy)).image_rgb
    known = dehaze(hazy, sea_z_m=DECK_Z_M + 12.0)
    np.testing.assert_array_equal(known, as_config)
    assert (known != dehaze(hazy)).any()
    without_deck = GeometryDehazer().restore(frame_of(hazy, deck_z_m=None, sea_z_m=SEA_Z_M))
    near = ray_z(world_from_body()) > 60 / 1000
    assert psnr_db(without_deck.image_rgb, sea_pair(BETA)[1], near) > 27


def test_the_sky_is_left_alone():
    hazy, _ = sea_pair(BETA)
    sky = ray_z(world_from_body()) < -0.02
    np.testing.assert_array_equal(dehaze(hazy)[sky], hazy[sky])


def test_an_object_before_the_sky_is_restored_where_it_reaches_the_sea():
    hazy, _ = sea_pair(BETA)
    t, colour = np.exp(-BETA * 250), np.array([35, 36, 38])
    hazy[30:110, 150:170] = AIRLIGHT + t * (colour - AIRLIGHT)
    floating = hazy.copy()
    floating[45:110, 150:170] = sea_pair(BETA)[0][45:110, 150:170]
    mast = (slice(34, 42), slice(154, 166))
    assert (ray_z(world_from_body())[mast] < 0).all()
    standing = dehaze(hazy)[mast]
    np.testing.assert_allclose(standing, np.broadcast_to(colour, standing.shape), atol=12)
    np.testing.assert_array_equal(dehaze(floating)[mast], floating[mast])


def test_paint_as_bright_as_the_haze_stays_paint():
    """A deck with a white line at the deck plane's range: the line comes out bright, the deck dark."""
    hazy, _ = sea_pair(BETA)
    deck_m = 40 / ray_z(world_from_body())  # ray lengths to the deck's plane
    block, line = (slice(85, 115), slice(110, 210)), (slice(85, 115), slice(158, 164))
    for part, colour in ((block, np.full(3, 40.0)), (line, np.full(3, 165.0))):
        t = np.exp(-BETA * deck_m[part])[..., None]
        hazy[part] = np.rint(AIRLIGHT + t * (colour - AIRLIGHT))
    result = dehaze(hazy).astype(float)
    assert result[90:110, 159:163].mean() == pytest.approx(165, abs=20)
    assert result[90:110, 120:150].mean() == pytest.approx(40, abs=20)


def test_water_beside_an_object_has_no_halo():
    """What an object adds to the sea around it: nothing but what it does far off, where the fit moves a little."""
    hazy = sea_pair(beta_from_visibility(900.0), texture=1.0)[0].repeat(4, axis=0).repeat(4, axis=1)
    hull = cv2.ellipse(np.zeros(hazy.shape[:2], np.uint8), (640, 300), (150, 50), 12, 0, 360, 1, -1)
    ship = hazy.copy()
    t, colour = np.exp(-beta_from_visibility(900.0) * 250), np.array([60, 62, 65])
    ship[hull > 0] = np.rint(AIRLIGHT + t * (colour - AIRLIGHT))
    alone, beside = (dehaze(image, camera=CAMERA.resized(1280, 720)).astype(int) for image in (hazy, ship))
    added = (beside - alone).mean(axis=2)
    away_px = cv2.distanceTransform(1 - hull, cv2.DIST_L2, 5)
    sea = ray_z(world_from_body()).repeat(4, axis=0).repeat(4, axis=1) > 0.01
    near, far = (added[sea & (away_px > low) & (away_px <= high)].mean() for low, high in ((1, 5), (10, 14)))
    assert near - far < 4


def test_a_depth_camera_replaces_the_bounds():
    """A grey block that neither bound can place: its depth alone gives its colour back."""
    hazy, _ = sea_pair(BETA)
    block, colour = (slice(100, 140), slice(120, 180)), np.array([110.0, 112.0, 115.0])
    range_m = 150.0
    hazy[block] = np.rint(AIRLIGHT + np.exp(-BETA * range_m) * (colour - AIRLIGHT))
    depth = np.full(hazy.shape[:2], np.nan, np.float32)
    depth[block] = range_m / CAMERA.ray_lengths()[block]
    result = dehaze(hazy, depth_m=depth)[block]
    np.testing.assert_allclose(result, np.broadcast_to(colour, result.shape), atol=3)


def test_the_inversion_is_exact_without_noise_and_modest_with_it():
    airlight = AIRLIGHT.astype(np.float32)[:, None, None]
    haze = HazeFit(AIRLIGHT, 1e-3, 0.0, 0.0, np.stack([50 - AIRLIGHT, np.zeros(3)]))  # a sea of 50 levels
    view = SeaView(np.full((8, 9), 0.1, np.float32), np.full((8, 9), 500, np.float32), 50.0)
    scene = np.random.default_rng(1).uniform(0, 255, (3, 8, 9)).astype(np.float32)
    t, clear_t = np.full((8, 9), 0.3, np.float32), np.ones((8, 9), np.float32)
    hazy = airlight + t * (scene - airlight)
    exact = GeometryConfig(level_sigma=1e-3, airlight_sigma=0.0, airlight_chroma_sigma=0.0)
    parts = invert_haze(view, t, clear_t, haze, exact)
    grey = luma(hazy)
    np.testing.assert_allclose(parts.gain * grey + parts.chroma * (hazy - grey) + parts.offset, scene, atol=0.01)
    nothing = invert_haze(view, np.zeros_like(t), clear_t, haze, GeometryConfig())
    np.testing.assert_array_equal(nothing.gain, 0)
    np.testing.assert_array_equal(nothing.chroma, 0)
    np.testing.assert_allclose(nothing.offset, 50, atol=1e-4)
    modest = invert_haze(view, t, clear_t, haze, GeometryConfig(level_sigma=5.0))
    assert (modest.chroma < 0.75 * modest.gain).all()
    assert (modest.gain < 1 / t).all()


def test_noise_is_estimated_from_a_sky_with_clouds():
    rng = np.random.default_rng(7)
    for sigma in (1.0, 4.0, 20.0):
        pairs = rng.normal(0, sigma, (20_000, 2, 3))
        pairs[:400, 1] += 60  # edges
        assert estimate_noise(pairs[:, 1] - pairs[:, 0]) == pytest.approx(sigma, rel=0.05)
    assert estimate_noise(np.zeros((0, 3))) == 0
    assert estimate_noise(np.zeros((50, 3))) == 0


def add_noise(image: np.ndarray, seed: int) -> np.ndarray:
    """The image with normal noise of 5 levels."""
    return np.clip(np.rint(image + np.random.default_rng(seed).normal(0, 5, image.shape)), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("size", [(320, 180), (160, 90)])
def test_the_sky_shows_the_noise(size):
    view = view_sea(CAMERA.resized(*size), world_from_body() * camera_mount(), SEA_Z_M)
    hazy, _ = sea_pair(BETA)
    noisy = add_noise(hazy, 8)
    assert measure_sky_noise(hazy, view) == 0
    assert measure_sky_noise(noisy, view) == pytest.approx(5, rel=0.05)
    blocks = hazy + np.random.default_rng(9).normal(0, 5, (len(hazy), 320 // 8, 3)).repeat(8, axis=1)
    compressed = np.clip(np.rint(blocks), 0, 255).astype(np.uint8)
    assert measure_sky_noise(compressed, view) < 1
    ramp = np.linspace(20, 200, hazy.shape[1])[None, :, None].repeat(len(hazy), axis=0).repeat(3, axis=2)
    assert measure_sky_noise(np.rint(ramp).astype(np.uint8), view, 8) < 0.6  # of rounding
    assert measure_sky_noise(compressed, view, 8) == pytest.approx(5, rel=0.1)
    assert with_noise(GeometryConfig(level_sigma=3.0), 1.0).level_sigma == 3.0
    assert with_noise(GeometryConfig(level_sigma=3.0), 5.0).level_sigma == 10.0


def test_noise_is_not_blown_up():
    """What haze hides is restored as water and not as noise: far less of it than 1 / t would make."""
    hazy, clear = sea_pair(BETA)
    noisy = add_noise(hazy, 9)
    far = (ray_z(world_from_body()) > 60 / 1000) & (ray_z(world_from_body()) < 60 / 400)
    assert np.exp(-BETA * 400) < 0.3
    assert psnr_db(dehaze(noisy), clear, far) > 24


def test_a_smaller_frame_shows_the_same_view():
    hazy, _ = sea_pair(BETA)
    frame = frame_of(hazy, depth_m=np.ones(hazy.shape[:2], np.float32))
    small = downscale_frame(frame, 160)
    assert small.image_rgb.shape == (90, 160, 3)
    np.testing.assert_allclose(small.image_rgb, hazy.reshape(90, 2, 160, 2, 3).mean(axis=(1, 3)), atol=0.51)
    smaller = downscale_frame(frame, 80).image_rgb.astype(float)  # by two halves, each rounded
    np.testing.assert_allclose(smaller, hazy.reshape(45, 4, 80, 4, 3).mean(axis=(1, 3)), atol=1.01)
    corner = np.array([[-0.5, -0.5]])  # the picture's outer corner is the same ray in both
    np.testing.assert_allclose(small.camera.rays(corner), frame.camera.rays(corner))
    assert small.depth_m is not None and small.depth_m.shape == (90, 160)
    assert downscale_frame(frame, 320).image_rgb is hazy


@pytest.mark.parametrize("eye_z_m", [EYE_Z_M, 300.0])
def test_without_a_height_the_visibility_is_in_heights_and_the_haze_goes_all_the_same(eye_z_m):
    hazy, clear = sea_pair(BETA)
    pose = world_from_body()
    moved = RigidTransform.from_components([40.0, 0.0, eye_z_m], pose.rotation)
    result = GeometryDehazer().restore(frame_of(hazy, deck_z_m=None, world_from_body=moved))
    assert not result.note and result.visibility_m is None
    visibility = result.visibility_heights
    assert visibility.value * -EYE_Z_M == pytest.approx(visibility_from_beta(BETA), rel=0.1)
    assert visibility.sigma < 0.4 * visibility.value
    depth_m = np.full(hazy.shape[:2], 30.0, np.float32)  # of true metres, which no height turns into others
    with_depth = GeometryDehazer().restore(frame_of(hazy, deck_z_m=None, world_from_body=moved, depth_m=depth_m))
    np.testing.assert_array_equal(with_depth.image_rgb, result.image_rgb)
    known = GeometryDehazer().restore(frame_of(hazy))
    assert psnr_db(result.image_rgb, clear) > psnr_db(known.image_rgb, clear) - 1 > psnr_db(hazy, clear) + 3


@pytest.mark.parametrize(
    ("changes", "cause", "numbers"),
    [
        ({"world_from_body": None}, NoFit.NO_POSE, ()),
        ({"sea_z_m": -25.0}, NoFit.SEA_ABOVE_DECK, ("-25 m", "-20 m")),
        ({"deck_z_m": EYE_Z_M - 25}, NoFit.BELOW_SEA, ("5.0 m",)),
        ({"world_from_body": world_from_body(-60.0)}, NoFit.NO_HORIZON, ()),
    ],
)
def test_what_is_missing_is_noted_and_the_image_unchanged(changes, cause, numbers):
    hazy, _ = sea_pair(BETA)
    frame = frame_of(hazy, **changes)
    solution, result = GeometryDehazer().solve(frame), GeometryDehazer().restore(frame)
    assert solution.cause is cause
    assert all(number in solution.detail for number in numbers)
    assert solution.reason in result.note
    np.testing.assert_array_equal(result.image_rgb, hazy)
    assert not np.shares_memory(result.image_rgb, hazy)


def test_a_window_without_pixels_is_refused():
    with pytest.raises(ValueError, match=r"window_px.*\b0\b"):
        GeometryConfig(window_px=0)
