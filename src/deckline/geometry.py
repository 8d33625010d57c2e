"""Cameras, rigid transforms and planes.

Frames: world is North-East-Down (or any right-handed forward-right-down frame), body is Forward-Right-Down,
the camera's optical frame is x right, y down, z forward. A transform `a_from_b` maps coordinates in b to
coordinates in a. Pixels: u to the right, v down, the *centre* of the top-left pixel is (0, 0).
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.checks import check_numbers

FARTHEST_M = 1e8  # of a position from the world's origin
UNDISTORT_STEPS = 60  # fixed-point steps; 1e-9 px for lenses up to 30 % distortion at the corner
UNDISTORT_MIN_STEP = 1e-12  # of normalised image coordinates; smaller steps change nothing
TINY = 1e-12  # of normalised image coordinates: the fisheye's axis itself
UNDISTORT_TOLERANCE = 1e-6  # of normalised image coordinates; a larger residual does not converge
GRID_POINTS = 9  # along each edge of a rectangle that goes through a lens
UNKNOWN_FOV_DEG = 65.0  # horizontal, of an assumed camera: 24-28 mm equivalent, as most phones and action cameras have
UNKNOWN_FOCAL_SIGMA = 0.35  # share of its focal length: 1-sigma 89 to 51 degrees (18 to 38 mm), 2-sigma to 48 mm
QUATERNION_TOLERANCE = 0.01  # of its length; rounding to two decimals changes it by at most as much
NEXT, LAST = np.array([1, 2, 0]), np.array([2, 0, 1])  # cyclic axes of a cross product
# Axes of the optical frame (right, down, forward) written in a forward-right-down frame.
BODY_FROM_OPTICAL = Rotation.from_matrix([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


@dataclass(frozen=True)
class Camera:
    """Pinhole intrinsics with optional distortion: Brown-Conrady, or equidistant for a fisheye.

    Args:
        width, height: image size, px.
        fx, fy: focal lengths, px.
        cx, cy: principal point, px; (0, 0) is the centre of the top-left pixel.
        distortion: (k1, k2, p1, p2, k3) or (k1, k2, p1, p2, k3, k4, k5, k6) as OpenCV orders them; all zero is a
            pinhole. Of a fisheye (k1, k2, k3, k4): theta (1 + k1 theta^2 + k2 theta^4 + ...) is the distance from the
            principal point in focal lengths, theta the angle off the optical axis, rad.
        known: False where only the image size holds: lines in pixels need no more, metres do.
        fisheye: `distortion` is the equidistant model's. Rays 90 degrees off the axis and more do not exist here.
        focal_sigma: 1-sigma of the focal length as a share; None: as stated for the sensors (a calibrated camera).

    Raises:
        ValueError: a size or focal length that is not positive and finite, or a wrong number of coefficients.

    Source: OpenCV, modules calib3d and fisheye; Kannala and Brandt, PAMI 28(8), 2006.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0)
    known: bool = True
    fisheye: bool = False
    focal_sigma: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "distortion", tuple(self.distortion))  # hashable, whatever it was given as
        check_numbers(self, "camera", "width", "height", least=1)
        check_numbers(self, "camera", "fx", "fy", above=0)
        check_numbers(self, "camera", "cx", "cy", "distortion")
        check_numbers(self, "camera", "focal_sigma", least=0, below=1)
        if len(self.distortion) not in ((4,) if self.fisheye else (5, 8)):
            wanted = "k1, k2, k3, k4 of a fisheye" if self.fisheye else "k1, k2, p1, p2, k3, or these and k4, k5, k6"
            raise ValueError(f"distortion must be {wanted}; got {len(self.distortion)} numbers")

    @classmethod
    def from_fov(cls, width: int, height: int, fov_rad: float) -> "Camera":
        """AirSim's pinhole: fx = fy = width / (2 tan(fov / 2)), optical axis through the image's middle.

        AirSim writes the middle as cx = width / 2 because it counts from the outer corner of the first pixel;
        counted from that pixel's centre, as everywhere here, the same ray is at (width - 1) / 2.
        Source: AirSim's projection matrix, for a horizontal field of view.
        """
        if not 0.0 < fov_rad < np.pi:
            raise ValueError(f"field of view must lie between 0 and pi rad, got {fov_rad}")
        focal_px = width / (2.0 * np.tan(fov_rad / 2.0))
        return cls(width, height, focal_px, focal_px, (width - 1) / 2.0, (height - 1) / 2.0)

    @classmethod
    def unknown(cls, width: int, height: int) -> "Camera":
        """A camera of which only the image size, px, is known; its focal length has no meaning."""
        return replace(cls.from_fov(width, height, np.pi / 2), known=False)

    @classmethod
    def assumed(cls, width: int, height: int) -> "Camera":
        """A pinhole of `UNKNOWN_FOV_DEG` for pictures, px, of whose camera nothing is stated, with its wide 1-sigma."""
        pinhole = cls.from_fov(width, height, math.radians(UNKNOWN_FOV_DEG))
        return replace(pinhole, focal_sigma=UNKNOWN_FOCAL_SIGMA)

    @property
    def fov_deg(self) -> float:
        """Horizontal field of view between the outer edges of the middle row, degrees; NaN where these have no rays."""
        middle = (self.height - 1) / 2.0
        left, right = self.rays([[-0.5, middle], [self.width - 0.5, middle]])
        return math.degrees(math.atan2(right[0], right[2]) - math.atan2(left[0], left[2]))

    @property
    def matrix(self) -> NDArray[np.float64]:
        """K, shape (3, 3)."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def has_distortion(self) -> bool:
        return self.fisheye or any(self.distortion)

    def project(self, points_optical_m: ArrayLike) -> NDArray[np.float64]:
        """Points (N, 3) in the optical frame, metres -> pixels (N, 2). Points with z <= 0 become NaN."""
        points = _points(points_optical_m, 3)
        z = np.where(points[:, 2] > 0, points[:, 2], np.nan)
        return self._distort(points[:, :2] / z[:, None]) * [self.fx, self.fy] + [self.cx, self.cy]

    def _distort(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Normalised image coordinates (N, 2) through the lens."""
        x, y = xy[:, 0], xy[:, 1]
        r2 = x * x + y * y
        if self.fisheye:
            radius = np.maximum(np.sqrt(r2), TINY)
            return xy * (_bend(np.arctan(radius), self.distortion)[0] / radius)[:, None]
        k1, k2, p1, p2, k3, k4, k5, k6 = (*self.distortion, 0.0, 0.0, 0.0)[:8]
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        radial = radial / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
        xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        return np.stack([xd, yd], axis=1)

    def rays(self, points_px: ArrayLike) -> NDArray[np.float64]:
        """Pixels (N, 2) -> rays (N, 3) in the optical frame with z = 1, lens distortion removed.

        A pixel that no ray reaches, as strong distortion coefficients have in the image's corners, becomes NaN.
        """
        points = _points(points_px, 2)
        xy = distorted = (points - np.array([self.cx, self.cy])) / np.array([self.fx, self.fy])
        if self.fisheye:
            radius = np.maximum(np.linalg.norm(distorted, axis=1), TINY)
            xy = distorted * (np.tan(_unbend(radius, self.distortion)) / radius)[:, None]
        elif self.has_distortion:
            with np.errstate(over="ignore", invalid="ignore"):  # steps run away where there is no ray
                for _ in range(UNDISTORT_STEPS):
                    step = distorted - self._distort(xy)
                    xy = xy + step
                    if np.abs(step).max(initial=0.0) < UNDISTORT_MIN_STEP:
                        break
                reached = np.abs(self._distort(xy) - distorted).max(axis=1, keepdims=True) < UNDISTORT_TOLERANCE
            xy = np.where(reached, xy, np.nan)
        rays = np.ones((len(xy), 3))
        rays[:, :2] = xy
        return rays

    @cached_property
    def reach(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Least and most (2,) x / z and y / z of the rays that pixels of the image have."""
        rays = self.rays(grid_points(self.width - 1, self.height - 1))[:, :2]
        return np.nanmin(rays, axis=0), np.nanmax(rays, axis=0)

    def resized(self, width: int, height: int) -> "Camera":
        """The same lens seen through an image of another size (with consistent pixel centres)."""
        sx, sy = width / self.width, height / self.height
        return replace(
            self,
            width=width,
            height=height,
            fx=self.fx * sx,
            fy=self.fy * sy,
            cx=(self.cx + 0.5) * sx - 0.5,
            cy=(self.cy + 0.5) * sy - 0.5,
        )

    def ray_lengths(self) -> NDArray[np.float32]:
        """Length of the z = 1 ray of every pixel, (height, width): range_m = depth_m * ray_lengths()."""
        v, u = np.mgrid[0 : self.height, 0 : self.width]
        rays = self.rays(np.stack([u.ravel(), v.ravel()], axis=1).astype(np.float64))
        return np.linalg.norm(rays, axis=1).reshape(self.height, self.width).astype(np.float32)


def grid_points(width: float, height: float) -> NDArray[np.float64]:
    """Points (N, 2) spread evenly over a rectangle from (0, 0) to (width, height), its edges included."""
    share = np.linspace(0.0, 1.0, GRID_POINTS)
    return np.stack(np.meshgrid(share * width, share * height), axis=-1).reshape(-1, 2)


def _bend(theta: NDArray[np.float64], k: tuple[float, ...]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Distance from the principal point, in focal lengths, of angles (N,) off the axis, rad, and its derivative."""
    powers = np.array([1.0, *k]) * theta[:, None] ** [1, 3, 5, 7, 9]
    slopes = np.array([1.0, *k]) * [1, 3, 5, 7, 9] * theta[:, None] ** [0, 2, 4, 6, 8]
    return powers.sum(axis=1), slopes.sum(axis=1)


def _unbend(radius: NDArray[np.float64], k: tuple[float, ...]) -> NDArray[np.float64]:
    """Angles (N,) below 90 degrees whose `_bend` is `radius` (N,), by Newton's method; NaN where there is none."""
    theta = np.minimum(radius, np.pi / 2)
    for _ in range(UNDISTORT_STEPS):
        bent, slope = _bend(theta, k)
        theta = np.clip(theta - (bent - radius) / np.where(slope > 0, slope, 1.0), 0.0, np.pi / 2)
    bent, slope = _bend(theta, k)
    reached = (np.abs(bent - radius) < UNDISTORT_TOLERANCE) & (slope > 0) & (theta < np.pi / 2)
    return np.where(reached, theta, np.nan)


def pose(translation_m: ArrayLike, quaternion_wxyz: ArrayLike) -> RigidTransform:
    """Rigid transform a_from_b from b's origin in a (3,), metres, and a scalar-first quaternion (4,).

    Raises:
        ValueError: NaN, infinite or far numbers, or a quaternion whose length is not near 1.
    """
    translation = np.asarray(translation_m, dtype=np.float64)
    quaternion = np.asarray(quaternion_wxyz, dtype=np.float64)
    if translation.shape != (3,) or quaternion.shape != (4,):
        raise ValueError(
            f"pose needs 3 metres and 4 quaternion numbers, got shapes {translation.shape} and {quaternion.shape}"
        )
    for name, numbers in (("position", translation), ("quaternion", quaternion)):
        if not np.all(np.isfinite(numbers)):
            raise ValueError(f"{name} is not finite: {numbers.tolist()}")
    if np.abs(translation).max() > FARTHEST_M:
        raise ValueError(f"a position beyond {FARTHEST_M:g} m: {translation.tolist()}")
    length = math.hypot(*quaternion)
    if abs(length - 1) > QUATERNION_TOLERANCE:
        raise ValueError(f"quaternion has length {length:.3g}, expected 1: {quaternion.tolist()}")
    return RigidTransform.from_components(translation, Rotation.from_quat(quaternion, scalar_first=True))


def attitude(roll_rad: ArrayLike, pitch_rad: ArrayLike, yaw_rad: ArrayLike) -> Rotation:
    """world_from_body of aerospace Euler angles (each () or (N,)): yaw about down, then pitch up, then roll right."""
    return Rotation.from_euler("ZYX", np.transpose([yaw_rad, pitch_rad, roll_rad]))


def rotation_matrix(pose: RigidTransform) -> NDArray[np.float64]:
    """The rotation (3, 3) of a pose; `pose.rotation.as_matrix()` makes and normalises a quaternion first."""
    return np.asarray(pose.as_matrix()[:3, :3])


def camera_mount(translation_m: ArrayLike = (0.0, 0.0, 0.0), mount: Rotation | None = None) -> RigidTransform:
    """body_from_camera (optical) of a camera at a body position whose viewing axis is turned by `mount`.

    `mount` is a body_from_mount rotation (identity: the camera points along the body's forward axis).
    """
    rotation = BODY_FROM_OPTICAL if mount is None else mount * BODY_FROM_OPTICAL
    return RigidTransform.from_components(np.asarray(translation_m, dtype=np.float64), rotation)


def undistort(points_px: NDArray[np.float64], camera: Camera) -> NDArray[np.float64]:
    """Pixels (N, 2) as the same camera without lens distortion would see them, (N, 2)."""
    if not camera.has_distortion:
        return points_px
    return (camera.rays(points_px) @ camera.matrix.T)[:, :2]


def distort(xy: NDArray[np.float64], camera: Camera) -> NDArray[np.float64]:
    """Pixels (N, 2) of the same camera without lens distortion as the real one sees them, (N, 2)."""
    if not camera.has_distortion:
        return xy
    rays = np.column_stack([xy, np.ones(len(xy))]) @ np.linalg.inv(camera.matrix).T
    return camera.project(rays)


def rectify(image_rgb: NDArray[np.uint8], camera: Camera) -> NDArray[np.uint8]:
    """The camera's picture (H, W, 3) as it is without lens distortion; beyond its border the border repeats."""
    import cv2

    if not camera.has_distortion:
        return image_rgb
    columns, rows = _undistortion_maps(camera)
    return np.asarray(cv2.remap(image_rgb, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))


@lru_cache(maxsize=1)  # a flight has one camera, and maps for 4K take 66 MB
def _undistortion_maps(camera: Camera) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Column and row (H, W) of the picture for each pixel of the picture without lens distortion."""
    import cv2

    make_maps = cv2.fisheye.initUndistortRectifyMap if camera.fisheye else cv2.initUndistortRectifyMap
    size, coefficients = (camera.width, camera.height), np.array(camera.distortion)
    columns, rows = make_maps(camera.matrix, coefficients, np.eye(3), camera.matrix, size, cv2.CV_32FC1)
    return np.asarray(columns), np.asarray(rows)


def intersect_plane(origin_m: ArrayLike, directions: ArrayLike, plane_z_m: ArrayLike) -> NDArray[np.float64]:
    """Where rays from one origin (3,) along directions (N, 3) meet the horizontal plane z = plane_z_m, one or (N,).

    Returns (N, 3); NaN for a ray that is parallel to the plane or meets it behind its origin.
    """
    origin = np.asarray(origin_m, dtype=np.float64)
    rays = _points(directions, 3)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        steps = (np.asarray(plane_z_m) - origin[2]) / rays[:, 2]
    steps = np.where(np.isfinite(steps) & (steps > 0), steps, np.nan)
    return origin + steps[:, None] * rays


def cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Cross products (..., 3); numpy's own takes ten times as long for a few vectors."""
    return a[..., NEXT] * b[..., LAST] - a[..., LAST] * b[..., NEXT]


def wrap_angle(angle_rad: ArrayLike) -> NDArray[np.float64]:
    """Angles brought to [-pi, pi)."""
    return (np.asarray(angle_rad, dtype=np.float64) + np.pi) % (2 * np.pi) - np.pi


def _points(values: ArrayLike, dimension: int) -> NDArray[np.float64]:
    points = np.asarray(values, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != dimension:
        raise ValueError(f"expected points of shape (N, {dimension}), got {points.shape}")
    return points
