"""Projection of true lines into a frame's image, and the contrast of a line against the deck."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import map_coordinates, uniform_filter1d

from deckline.haze import CONTRAST_THRESHOLD, air_path, atmosphere_from_mapping
from deckline.types import Frame, Segment

LINE_POINTS = 257  # along a line, evenly spaced in the image
SEARCH_POINTS = 2049  # along a line, to find where it enters and leaves the image
NEAREST_M = 0.5  # depth at which a line that passes the camera is cut
SAME_RAY = 1e-3  # of normalised image coordinates; strong lenses bend far points back into the image
OFFSETS = np.linspace(-0.2, 0.2, 41)  # across a line, in parts of the way to the other one: to 5 m of 24
ALONG = 0.125  # of a line: averaged over, dashes and gaps alike
STRIPES = (0.01, 0.02, 0.04, 0.07)  # half the width of a marking
STEPS = np.arange(-0.1, 0.101, 0.02)  # where a marking that has run together may begin
FLANK = 0.05  # on both sides of a step


@dataclass(frozen=True, eq=False)
class VisibleLine:
    """The visible part of a true line."""

    points_px: NDArray[np.float64]  # (N, 2) in order along the line, N >= 2
    ranges_m: NDArray[np.float64]  # (N,) from the camera
    share: float  # of the line's length in metres

    @property
    def length_px(self) -> float:
        return float(np.linalg.norm(np.diff(self.points_px, axis=0), axis=1).sum())


def project_line(
    frame: Frame, segment: Segment, count: int = LINE_POINTS
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """A true line's pixels (N, 2), evenly spaced in the image and beyond it, and their ranges (N,) in metres.

    None for a line wholly behind the camera, and without a pose.
    """
    ends = _clip_ends(frame, segment)
    if ends is None:
        return None
    points = _sample_evenly(ends, np.linspace(0.0, 1.0, count))
    return frame.camera.project(points), np.linalg.norm(points, axis=1)


def find_visible_line(frame: Frame, segment: Segment, within_visibility: bool = True) -> VisibleLine | None:
    """The part of a true line that lies in the image and shows through the air; None where there is none.

    A point is visible where the transmission of the air, known from `Truth.conditions`, is 2 % or more; without a
    recorded air, where its range does not exceed the visibility.
    """
    ends = _clip_ends(frame, segment)
    if ends is None:
        return None
    shares = np.linspace(0.0, 1.0, SEARCH_POINTS)
    seen = np.flatnonzero(_is_visible(_sample_evenly(ends, shares), frame, within_visibility))
    if not len(seen):
        return None
    low, high = shares[max(seen[0] - 1, 0)], shares[min(seen[-1] + 1, SEARCH_POINTS - 1)]
    points = _sample_evenly(ends, np.linspace(low, high, LINE_POINTS))
    points = points[_is_visible(points, frame, within_visibility)]
    if len(points) < 2:
        return None
    length_m = np.linalg.norm(segment.p1_m - segment.p0_m)
    share = float(np.linalg.norm(points[-1] - points[0]) / length_m)
    return VisibleLine(frame.camera.project(points), np.linalg.norm(points, axis=1), share)


def _clip_ends(frame: Frame, segment: Segment) -> NDArray[np.float64] | None:
    """Both ends (2, 3) of a line in the optical frame, cut where it passes the camera; None wholly behind it."""
    pose = frame.true_world_from_camera
    if pose is None:
        return None
    ends = pose.inv().apply(np.stack([segment.p0_m, segment.p1_m]))
    depths = ends[:, 2]
    if depths.max() <= NEAREST_M:
        return None
    if depths.min() < NEAREST_M:
        along = ends[1] - ends[0]
        ends[int(depths.argmin())] = ends[0] + along * (NEAREST_M - depths[0]) / along[2]
    return ends


def _sample_evenly(ends: NDArray[np.float64], shares: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points (N, 3) at shares (N,) of a line's way through the image: even in 1/z is even there."""
    near, far = ends[0, 2], ends[1, 2]
    along = shares
    if abs(far - near) > 1e-6:
        along = (1.0 / ((1 - shares) / near + shares / far) - near) / (far - near)
    return ends[0] + along[:, None] * (ends[1] - ends[0])


def _is_visible(points_m: NDArray[np.float64], frame: Frame, within_visibility: bool) -> NDArray[np.bool_]:
    camera = frame.camera
    pixels = camera.project(points_m)
    inside = np.all((pixels >= 0) & (pixels <= [camera.width - 1, camera.height - 1]), axis=1)
    if camera.has_distortion and inside.any():
        straight = points_m[inside, :2] / points_m[inside, 2:]
        off = np.abs(camera.rays(pixels[inside])[:, :2] - straight).max(axis=1)
        inside[inside] = off < SAME_RAY
    return inside & (compute_transmission(points_m, frame) >= CONTRAST_THRESHOLD) if within_visibility else inside


def compute_transmission(points_m: NDArray[np.float64], frame: Frame) -> NDArray[np.float64]:
    """Share (N,) of light that the air lets through from points (N, 3), optical frame; 1 if nothing is known."""
    truth, pose = frame.truth, frame.true_world_from_camera
    ranges = np.linalg.norm(points_m, axis=1)
    if truth is None:
        return np.ones(len(ranges))
    if "air" not in truth.conditions or pose is None:
        return CONTRAST_THRESHOLD ** (ranges / (np.inf if truth.visibility_m is None else truth.visibility_m))
    air = atmosphere_from_mapping(truth.conditions["air"])
    directions = pose.rotation.apply(points_m / ranges[:, None]).astype(np.float32)
    path = air_path(ranges.astype(np.float32), directions, pose.translation, air)
    return np.asarray(np.exp(-min(air.extinction_per_m) * path), dtype=np.float64)


def _build_kernels(at: NDArray[np.float64]) -> NDArray[np.float64]:
    """(K, N) over places `at` (N,): a stripe against what is beside it, one side of a step against the other."""
    parts = []
    for half in STRIPES:
        away = np.abs(at)
        parts.append((away <= half, (away > half) & (away <= half + max(half, 0.02))))
    for step in STEPS:
        parts.append(((at > step) & (at <= step + FLANK), (at < step) & (at >= step - FLANK)))
    return np.stack([one / one.sum() - other / other.sum() for one, other in parts])


KERNELS = _build_kernels(OFFSETS)


def measure_contrast(image: NDArray, line_px: ArrayLike, other_px: ArrayLike) -> NDArray[np.float64]:
    """Contrast (N,) of a marking, grey levels: of a stripe against both sides, or between the two sides of its edge.

    The maximum over widths and places of a marking, averaged along an eighth of the line. Haze, blur and distance lower
    it. Stains and shadows count too: a bare deck in a clear view has one or two grey levels.

    Args:
        image: (H, W, 3) grey levels.
        line_px: (N, 2) points along the line, in order.
        other_px: (M, 2) points along the runway's other line: how wide it is there.
    """
    line, other = np.asarray(line_px, dtype=np.float64), np.asarray(other_px, dtype=np.float64)
    nearest = np.square(line[:, None] - other[None]).sum(axis=2).argmin(axis=1)
    across = other[nearest] - line
    u, v = np.moveaxis(line[:, None] + OFFSETS[:, None] * across[:, None], 2, 0)
    profile = [map_coordinates(image[..., k], (v, u), output=np.float64, order=1, mode="nearest") for k in range(3)]
    size = max(round(ALONG * len(line)), 1)
    smooth = uniform_filter1d(np.stack(profile), size, axis=1, mode="nearest")  # (3, N, OFFSETS)
    differences = np.sqrt(np.square(smooth @ KERNELS.T).mean(axis=0))
    return np.asarray(differences.max(axis=1))
