import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from deckline.geometry import Camera, attitude, camera_mount
from deckline_lab.evaluation.metrics import below_horizon, distance_px, normal_pixel_error, psnr_db, ssim


def images(shape=(48, 61, 3)):
    rng = np.random.default_rng(0)
    clear = rng.integers(0, 256, shape).astype(np.uint8)
    return clear, np.clip(clear * 0.7 + rng.normal(40, 15, shape), 0, 255).astype(np.uint8)


def test_psnr_agrees_with_scikit_image_and_a_closed_form():
    clear, hazy = images()
    assert psnr_db(hazy, clear) == pytest.approx(peak_signal_noise_ratio(clear, hazy, data_range=255), rel=1e-12)
    flat = np.full((5, 5, 3), 100, dtype=np.uint8)
    assert psnr_db(flat, flat + 10) == pytest.approx(20 * np.log10(25.5))
    assert psnr_db(flat, flat) == float("inf")


@pytest.mark.parametrize("shape", [(48, 61, 3), (11, 11, 3), (120, 33, 3)])
def test_ssim_agrees_with_scikit_image(shape):
    clear, hazy = images(shape)
    options = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False}
    peer = structural_similarity(clear, hazy, **options, data_range=255, channel_axis=2)
    assert ssim(hazy, clear) == pytest.approx(peer, abs=1e-6)
    assert ssim(clear, clear) == pytest.approx(1.0)


def test_images_that_cannot_be_compared_are_named():
    clear, hazy = images()
    for metric in (psnr_db, ssim):
        with pytest.raises(ValueError, match=r"\(48, 61, 3\).*\(47, 61, 3\)"):
            metric(clear, hazy[1:])
        with pytest.raises(ValueError, match=r"uint8.*float64 and uint8"):
            metric(clear.astype(float), hazy)
    with pytest.raises(ValueError, match=r"11 px.*\(8, 61\)"):
        ssim(clear[:8], hazy[:8])


@pytest.mark.parametrize("distortion", [(0.0,) * 5, (-0.2, 0.05, 0.001, -0.001, 0.0)])
def test_normal_pixel_error_is_the_distance_to_the_true_image_line(distortion):
    camera = Camera(1280, 720, 640, 640, 639.5, 359.5, distortion)
    ends = np.array([[-3.0, 4.0, 10.0], [-1.0, 4.0, 200.0]])
    between = ends[0] + np.linspace(0, 1, 9)[:, None] * (ends[1] - ends[0])
    assert normal_pixel_error(camera.project(between), ends, camera).max() < 1e-6
    if not any(distortion):
        a, b = camera.project(ends)
        normal = np.array([-(b - a)[1], (b - a)[0]]) / np.linalg.norm(b - a)
        moved = camera.project(between) + np.outer([0, 1, -2, 3, 4, 5, 6, -7, 8], normal)
        np.testing.assert_allclose(normal_pixel_error(moved, ends, camera), [0, 1, 2, 3, 4, 5, 6, 7, 8], atol=1e-9)


def test_a_line_through_the_lens_is_refused():
    camera = Camera(1280, 720, 640, 640, 639.5, 359.5)
    with pytest.raises(ValueError, match=r"\[0\.0, 0\.0, 2\.0\]"):
        normal_pixel_error(np.zeros((1, 2)), np.array([[0, 0, 1.0], [0, 0, 2.0]]), camera)
    with pytest.raises(ValueError, match=r"\(2, 3\).*\(3, 3\)"):
        normal_pixel_error(np.zeros((1, 2)), np.eye(3), camera)


def test_psnr_counts_the_marked_pixels_alone():
    reference = np.full((4, 6, 3), 100, np.uint8)
    image = reference.copy()
    image[:2] += 10
    image[2:] += 50
    where = np.zeros((4, 6), bool)
    where[:2] = True
    assert psnr_db(image, reference, where) == pytest.approx(20 * np.log10(255 / 10))
    with pytest.raises(ValueError, match=r"\(4, 6\)"):
        psnr_db(image, reference, np.zeros((4, 6), bool))


def test_a_level_camera_sees_the_horizon_at_its_middle():
    camera = Camera(8, 6, 5.0, 5.0, 3.5, 2.5)
    level = below_horizon(camera, camera_mount())
    assert not level[:3].any()
    assert level[3:].all()
    banked = RigidTransform.from_rotation(attitude(np.pi, 0.0, 0.0)) * camera_mount()
    assert below_horizon(camera, banked)[:3].all()


def test_distance_is_taken_without_the_lens():
    lens = Camera(640, 360, 500.0, 500.0, 319.5, 179.5, (-0.2, 0.03, 0.0, 0.0, 0.0))
    ends = np.array([[-3.0, 2.0, 6.0], [6.0, 2.0, 12.0]])
    straight = ends[0] + np.linspace(0, 1, 12)[:, None] * (ends[1] - ends[0])
    bent = lens.project(straight)
    assert distance_px(bent[1:-1], bent, lens).max() < 1e-5
    assert distance_px(bent[1:-1], bent, Camera(640, 360, 500.0, 500.0, 319.5, 179.5)).max() > 0.5
