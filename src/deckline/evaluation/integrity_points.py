"""The noise of a detector that looks at no picture: points of true lines, and depth about them, from a stated model."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.spatial.transform import RigidTransform

from deckline.evaluation.localization_flights import DEPTH_RANGE_M
from deckline.geometry import Camera
from deckline.types import LinePoints, Segment

PATCH_PX = 2  # depth is filled in so far around every point; localization looks 1 px around it
SAMPLES = 2000  # along a line, to find what of it is in the image
BORDER_PX = 1.0


@dataclass(frozen=True)
class PointNoise:
    """The detector: what it finds of a line in view, and how wrong it is.

    sigma_px is about what `deckline eval chain` prints for the shipped one near the paper's deck; the shares are our
    choice.

    Args:
        seen_share: how far lines are seen, of the visibility at 2 % contrast.
        rows: points on a line, evenly spaced in the image's rows; never closer than a tenth of a pixel.
        sigma_px: 1-sigma of u, and what the detector says of itself.
        correlation: of the errors of neighbouring points.
        outlier_share: of the points, anywhere within outlier_px of the line.
        outlier_px: see there.
        missed_share: of the lines in a frame, not seen at all.
    """

    seen_share: float = 0.7
    rows: int = 40
    sigma_px: float = 0.3
    correlation: float = 0.5
    outlier_share: float = 0.02
    outlier_px: float = 20.0
    missed_share: float = 0.01


def seen_points(
    segment: Segment,
    world_from_camera: RigidTransform,
    camera: Camera,
    far_m: float,
    noise: PointNoise,
    rng: np.random.Generator,
) -> LinePoints:
    """Noisy points of a true line, as far as it is in the image and nearer than `far`.

    None where it is missed or shorter than 2 px.
    """
    along = segment.p0_m + np.linspace(0.0, 1.0, SAMPLES)[:, None] * (segment.p1_m - segment.p0_m)
    pixels = camera.project(world_from_camera.inv().apply(along))
    with np.errstate(invalid="ignore"):
        inside = np.all((pixels >= BORDER_PX) & (pixels <= [camera.width - 2, camera.height - 2]), axis=1)
    inside &= np.linalg.norm(along - world_from_camera.translation, axis=1) < far_m
    missed = rng.random() < noise.missed_share
    if missed or inside.sum() < 2 or np.ptp(pixels[inside, 1]) < 2.0:
        return LinePoints.empty()
    v = pixels[inside, 1]
    rows = np.linspace(v.min(), v.max(), min(noise.rows, int(10 * np.ptp(v))))
    order = np.argsort(v)
    u = np.interp(rows, v[order], pixels[inside, 0][order])
    u += noise.sigma_px * correlated(len(rows), noise.correlation, rng)
    stray = rng.random(len(rows)) < noise.outlier_share
    u[stray] += rng.uniform(-noise.outlier_px, noise.outlier_px, int(stray.sum()))
    keep = (u >= 0) & (u <= camera.width - 1)
    points = np.column_stack([u, rows])[keep]
    return LinePoints(points, np.full(len(points), 0.9), np.full(len(points), noise.sigma_px))


def correlated(count: int, correlation: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Unit-variance noise (N,) whose neighbours have a correlation: a first-order autoregression."""
    white = rng.standard_normal(count)
    white[1:] *= np.sqrt(1.0 - correlation**2)
    return np.asarray(lfilter([1.0], [1.0, -correlation], white))


def sparse_depth(
    camera: Camera,
    pose: RigidTransform,
    segments: tuple[Segment, Segment],
    seen: list[LinePoints],
    sigma: float,
    rng: np.random.Generator,
) -> NDArray[np.float32]:
    """Depth (H, W) of the deck around the points, the rest NaN, as is what lies beyond the depth camera's reach.

    Args:
        pose: world_from_camera.
        segments: both true lines, which span the deck's plane.
        seen: the points of each line.
        sigma: of a depth, as a part of it; one draw for each point, as a matching window has.
    """
    depth = np.full((camera.height, camera.width), np.nan, dtype=np.float32)
    window = np.array([(du, dv) for dv in range(-PATCH_PX, PATCH_PX + 1) for du in range(-PATCH_PX, PATCH_PX + 1)])
    normal = np.cross(segments[0].p1_m - segments[0].p0_m, segments[1].p0_m - segments[0].p0_m)
    for points in seen:
        if not len(points):
            continue
        pixels = np.rint(points.points_px).astype(int)[:, None] + window
        rays = pose.rotation.apply(camera.rays(pixels.reshape(-1, 2)))  # of length 1 along the optical axis
        true = ((segments[0].p0_m - pose.translation) @ normal) / (rays @ normal)
        true = np.where((true > 0) & (true <= DEPTH_RANGE_M), true, np.nan).reshape(pixels.shape[:2])
        true *= 1.0 + sigma * rng.standard_normal(len(points))[:, None]
        inside = np.all((pixels >= 0) & (pixels < [camera.width, camera.height]), axis=2)
        depth[pixels[inside][:, 1], pixels[inside][:, 0]] = true[inside]
    return depth
