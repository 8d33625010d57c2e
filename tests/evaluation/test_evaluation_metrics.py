import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from deckline.evaluation.metrics import (
    below_horizon,
    direction_error_rad,
    height_error_m,
    lateral_error_m,
    normal_pixel_error,
    psnr_db,
    ssim,
)
from deckline.geometry import Camera, attitude, camera_mount
from deckline.types import RunwayLine, Segment

TRUTH = Segment(np.array([10.0, 2.0, -20.0]), np.array([110.0, 2.0, -20.0]))


def images(shape=(48, 61, 3)):
    rng = np.random.default_rng(0)
    clear = rng.integers(0, 256, shape).astype(np.uint8)
    return clear, np.clip(clear * 0.7 + rng.normal(40, 15, shape), 0, 255).astype(np.uint8)


def line(point, azimuth):
    return RunwayLine(np.array(point, dtype=float), azimuth, np.eye(3))


def test_psnr_agrees_with_scikit_image_and_a_closed_form():
    clear, hazy = images()
    assert psnr_db(hazy, clear) == pytest.approx(peak_signal_noise_ratio(clear, hazy, data_range=255), rel=1e-12)
    flat = np.full((5, 5, 3), 100, dtype=np.uint8)
    assert psnr_db(flat, flat + 10) == pytest.approx(20 * np.log10(25.5))
    assert psnr_db(flat, flat) == float("inf")


def test_psnr_does_not_wrap_around():
    assert psnr_db(np.zeros((2, 2, 3), np.uint8), np.full((2, 2, 3), 255, np.uint8)) == pytest.approx(0.0)


@pytest.mark.parametrize("shape", [(48, 61, 3), (11, 11, 3), (120, 33, 3)])
def test_ssim_agrees_with_scikit_image(shape):
    clear, hazy = images(shape)
    peer = structural_similarity(
        clear,
        hazy,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
        data_range=255,
        channel_axis=2,
    )
    assert ssim(hazy, clear) == pytest.approx(peer, abs=1e-6)
    assert ssim(clear, clear) == pytest.approx(1.0)


def test_images_that_cannot_be_compared_are_named():
    clear, hazy = images()
    for metric in (psnr_db, ssim):
        with pytest.raises(ValueError, match=r"one shape, got \(48, 61, 3\) and \(47, 61, 3\)"):
            metric(clear, hazy[1:])
        with pytest.raises(ValueError, match="uint8 images, got float64 and uint8"):
            metric(clear.astype(float), hazy)
    with pytest.raises(ValueError, match="at least 11 px"):
        ssim(clear[:8], hazy[:8])


def test_line_errors_have_the_documented_signs():
    estimate = line([60.0, 3.5, -19.4], 0.0)
    assert lateral_error_m(estimate, TRUTH) == pytest.approx(1.5)
    assert height_error_m(estimate, TRUTH) == pytest.approx(0.6)
    turned = line([60.0, 2.0, -20.0], 0.02)
    assert direction_error_rad(turned, TRUTH) == pytest.approx(0.02)
    assert lateral_error_m(turned, TRUTH) == pytest.approx(-50 * np.tan(0.02))


@given(st.floats(-3.1, 3.1), st.floats(-300, 300))
def test_errors_do_not_depend_on_direction_of_travel_or_the_point_on_the_line(angle, along):
    if abs(np.cos(angle)) < 1e-3:
        return
    base = line([60.0, 4.0, -20.0], angle)
    same = line(base.point_m + along * base.direction, angle + np.pi)
    assert direction_error_rad(same, TRUTH) == pytest.approx(direction_error_rad(base, TRUTH), abs=1e-9)
    assert 0 <= direction_error_rad(base, TRUTH) <= np.pi / 2
    assert lateral_error_m(same, TRUTH) == pytest.approx(lateral_error_m(base, TRUTH), abs=1e-6, rel=1e-6)


def test_a_line_across_has_no_lateral_error():
    with pytest.raises(ValueError, match="right angles"):
        lateral_error_m(line([60.0, 4.0, -20.0], np.pi / 2), TRUTH)


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
    with pytest.raises(ValueError, match="has no image line"):
        normal_pixel_error(np.zeros((1, 2)), np.array([[0, 0, 1.0], [0, 0, 2.0]]), camera)
    with pytest.raises(ValueError, match=r"shape \(2, 3\), got \(3, 3\)"):
        normal_pixel_error(np.zeros((1, 2)), np.eye(3), camera)


def test_psnr_counts_the_marked_pixels_alone():
    reference = np.full((4, 6, 3), 100, np.uint8)
    image = reference.copy()
    image[:2] += 10
    image[2:] += 50
    where = np.zeros((4, 6), bool)
    where[:2] = True
    assert psnr_db(image, reference, where) == pytest.approx(20 * np.log10(255 / 10))
    with pytest.raises(ValueError, match="where must mark pixels"):
        psnr_db(image, reference, np.zeros((4, 6), bool))


def test_a_level_camera_sees_the_horizon_at_its_middle():
    camera = Camera(8, 6, 5.0, 5.0, 3.5, 2.5)
    level = below_horizon(camera, camera_mount())
    assert not level[:3].any()
    assert level[3:].all()
    banked = RigidTransform.from_rotation(attitude(np.pi, 0.0, 0.0)) * camera_mount()
    assert below_horizon(camera, banked)[:3].all()
