"""Measures of a picture and of detected points against the truth."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform

from deckline.geometry import Camera

PEAK = 255.0  # of 8-bit images
SSIM_WINDOW_PX = 11  # this and the next three: Wang et al. 2004
SSIM_SIGMA_PX = 1.5
SSIM_K1 = 0.01
SSIM_K2 = 0.03


def psnr_db(
    image_rgb: NDArray[np.uint8], reference_rgb: NDArray[np.uint8], where: NDArray[np.bool_] | None = None
) -> float:
    """Peak signal-to-noise ratio, dB, of two 8-bit images (H, W, C): 10 log10(255^2 / MSE). Equal images give infinity.

    Args:
        where: (H, W), the pixels that count; None counts all.

    Raises:
        ValueError: images that are not uint8 or differ in shape, or no pixel that counts.
    """
    _check_pair(image_rgb, reference_rgb)
    squared = (image_rgb.astype(np.float64) - reference_rgb.astype(np.float64)) ** 2
    if where is not None:
        if where.shape != image_rgb.shape[:2] or not where.any():
            raise ValueError(f"where must mark pixels of an image {image_rgb.shape[:2]}, got {where.shape} with none")
        squared = squared[where]
    error = float(np.mean(squared))
    return float("inf") if error == 0 else float(10 * np.log10(PEAK**2 / error))


def ssim(image_rgb: NDArray[np.uint8], reference_rgb: NDArray[np.uint8]) -> float:
    """Mean structural similarity of two 8-bit RGB images (H, W, 3) at full size, averaged over the channels.

    Gaussian window 11x11, sigma 1.5, K1 0.01, K2 0.03; the mean leaves out the 5 px border that the window overhangs.

    Raises:
        ValueError: images that are not uint8, differ in shape, or are smaller than the window.
    Source: Wang et al., "Image quality assessment", 2004, equations 13 to 16.
    """
    _check_pair(image_rgb, reference_rgb)
    if min(image_rgb.shape[:2]) < SSIM_WINDOW_PX:
        raise ValueError(f"SSIM needs at least {SSIM_WINDOW_PX} px on each side, got {image_rgb.shape[:2]}")
    x, y = image_rgb.astype(np.float64), reference_rgb.astype(np.float64)
    mean_x, mean_y = _window_mean(x), _window_mean(y)
    var_x = _window_mean(x * x) - mean_x**2
    var_y = _window_mean(y * y) - mean_y**2
    covariance = _window_mean(x * y) - mean_x * mean_y
    c1, c2 = (SSIM_K1 * PEAK) ** 2, (SSIM_K2 * PEAK) ** 2
    luminance = (2 * mean_x * mean_y + c1) / (mean_x**2 + mean_y**2 + c1)
    structure = (2 * covariance + c2) / (var_x + var_y + c2)
    border = SSIM_WINDOW_PX // 2
    return float(np.mean((luminance * structure)[border:-border, border:-border]))


def below_horizon(camera: Camera, world_from_camera: RigidTransform) -> NDArray[np.bool_]:
    """Mask (H, W) of the pixels whose rays point below the horizon: sea and ship, not sky."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    rays = camera.rays(np.stack([u.ravel(), v.ravel()], axis=1))
    down = rays @ world_from_camera.rotation.as_matrix()[2]
    return (down > 0).reshape(camera.height, camera.width)


def normal_pixel_error(points_px: ArrayLike, ends_optical_m: ArrayLike, camera: Camera) -> NDArray[np.float64]:
    """Distance (N,), px, of detected points (N, 2) to the image of a true line.

    The line is unbounded ahead of the camera, so an error along it does not count. Both are compared with the lens
    distortion removed.

    Args:
        points_px: (N, 2) detected pixels.
        ends_optical_m: (2, 3) two points of the true line in the camera's optical frame, metres.
        camera: the camera that both belong to.

    Raises:
        ValueError: a true line through the camera's centre, whose image is a point.
    """
    ends = np.asarray(ends_optical_m, dtype=np.float64)
    if ends.shape != (2, 3):
        raise ValueError(f"expected the two ends of a line, shape (2, 3), got {ends.shape}")
    normal = np.linalg.inv(camera.matrix).T @ np.cross(ends[0], ends[1])
    scale = float(np.hypot(normal[0], normal[1]))
    if scale == 0:
        raise ValueError(f"the line through {ends.tolist()} has no image line in this camera")
    return np.abs(camera.rays(points_px) @ camera.matrix.T @ normal) / scale


def distance_px(points_px: ArrayLike, line_px: NDArray[np.float64], camera: Camera) -> NDArray[np.float64]:
    """Distance (N,), px, of points (N, 2) to the unbounded straight line that fits labelled points (M, 2) best.

    Both are compared with the lens distortion removed.
    """
    points, line = (camera.rays(pixels)[:, :2] * [camera.fx, camera.fy] for pixels in (points_px, line_px))
    middle = line.mean(axis=0)
    normal = np.linalg.svd(line - middle)[2][1]
    return np.abs((points - middle) @ normal)


def _window_mean(image: NDArray[np.float64]) -> NDArray[np.float64]:
    import cv2  # here: training measures itself on machines without OpenCV

    size = (SSIM_WINDOW_PX, SSIM_WINDOW_PX)
    return np.asarray(cv2.GaussianBlur(image, size, SSIM_SIGMA_PX, borderType=cv2.BORDER_REFLECT), dtype=np.float64)


def _check_pair(image: NDArray[np.uint8], reference: NDArray[np.uint8]) -> None:
    if image.dtype != np.uint8 or reference.dtype != np.uint8:
        raise ValueError(f"expected two uint8 images, got {image.dtype} and {reference.dtype}")
    if image.shape != reference.shape:
        raise ValueError(f"expected two images of one shape, got {image.shape} and {reference.shape}")
