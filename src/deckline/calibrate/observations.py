"""What an approach shows: poses over time, the edge lines of each frame as two points a line, and the horizon."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import RigidTransform, Rotation, RotationSpline

from deckline.dehaze.horizon import Horizon, find_horizon
from deckline.dehaze.sea_view import EARTH_RADIUS_M
from deckline.flight import Flight
from deckline.geometry import Camera, distort, undistort
from deckline.localize.ransac import fit_pixel_line
from deckline.localize.solver import CORRELATION, CORRELATION_SIGMA, noise_inflation
from deckline.recording import Recording
from deckline.recording.scene_file import get_heights
from deckline.types import SIDES, Detection, Frame, LinePoints

Array = NDArray[np.float64]
Index = NDArray[np.int64]
MIN_STEP_S = 0.1  # between frames that are searched: those closer together err alike
MOST_FRAMES = 150  # that are searched; the noise's covariance is dense
HORIZON_STEP_S = 0.5  # between searches of the horizon, each of 0.1 s
MIN_POSE_STEP_S = 0.02  # between poses of a track; faster motion than 25 Hz moves no aircraft
MIN_POSES = 4  # of a cubic spline
POSE_MARGIN_S = 0.6  # of the track's poses before the first and after the last frame
MIN_SIGMA_PX = 0.1  # of a point of a fitted line


@dataclass(frozen=True, eq=False)
class PoseSpline:
    """world_from_body over time: cubic splines of position and attitude."""

    times_s: Array
    """(P,) ascending."""
    positions: CubicSpline
    """Position (3,) in the world, m."""
    rotations: RotationSpline
    """Attitude."""

    def at(self, times_s: Array) -> tuple[Array, Rotation]:
        """Positions (T, 3) and attitudes (T)."""
        return self.positions(times_s), self.rotations(times_s)


@dataclass(frozen=True, eq=False)
class ApproachView:
    """One approach, measured with the stated camera; N frames, M points of lines, H horizons."""

    camera: Camera
    """As stated."""
    body_from_camera: RigidTransform
    """As stated."""
    poses: PoseSpline
    """As recorded."""
    times_s: Array
    """(N,) of the frames, on the poses' clock as stated."""
    deck_z_m: Array
    """(N,) world z of the deck as reported; NaN where unknown."""
    dip_rad: Array
    """(N,) of the sea's horizon below the horizontal; NaN where the water's height is unknown."""
    frame: Index
    """(M,) the frame of a point."""
    side: Index
    """(M,) its line: 0 left, 1 right."""
    end: Index
    """(M,) 0 the far, 1 the near point of its line."""
    points_px: Array
    """(M, 2) u, v on the line."""
    sigma_px: Array
    """(M,) 1-sigma normal to the line, px; the two points of a line err independently."""
    heights: dict[str, float]
    """World z of deck and sea, m, those that are the same in all frames."""
    horizon_frame: Index
    """(H,) the frame of a horizon."""
    horizons: Array
    """(H, 4) row in the image's middle, its 1-sigma, px; slope, its 1-sigma, rows a column."""


def observe_approach(source: Recording, flight: Flight) -> ApproachView:
    """Detect the lines in frames of a recording.

    Args:
        source: one approach with poses.
        flight: finds the lines, as in a run.

    Raises:
        ValueError: no poses, no camera, or cameras that differ between frames.
    """
    frames: list[Frame] = []
    lines: list[tuple[int, int, Array, Array]] = []
    horizons: list[tuple[int, Horizon]] = []
    step_s = max(MIN_STEP_S, float(np.ptp(source.times())) / MOST_FRAMES) if len(source) else MIN_STEP_S
    next_s = next_horizon_s = -np.inf
    poses: list[tuple[float, RigidTransform]] = []
    for frame in source:
        if frame.world_from_body is None:
            continue
        if not poses or frame.time_s > poses[-1][0]:
            poses.append((frame.time_s, frame.world_from_body))
        if frame.time_s < next_s:
            continue
        next_s = frame.time_s + step_s
        for side, end_points, sigmas in line_ends(flight(frame).detection, frame):
            lines.append((len(frames), side, end_points, sigmas))
        if frame.time_s >= next_horizon_s and frame.sea_z_m is not None and not frame.camera.has_distortion:
            next_horizon_s = frame.time_s + HORIZON_STEP_S
            if isinstance(found := find_horizon(frame.image_rgb, rough=True), Horizon):
                horizons.append((len(frames), found))
        frames.append(_without_picture(frame))
    if not frames:
        raise ValueError(f"{source.name}: no frame has a camera and a pose; calibrate needs poses of one approach")
    return make_view(frames, _spline_of(source, poses, frames), lines, horizons)


def line_ends(detection: Detection, frame: Frame) -> Iterator[tuple[int, Array, Array]]:
    """Number of each line that is seen, two points (2, 2) on it, px, far and near, and their 1-sigma (2,), px.

    The points lie one root mean square distance from the weighted middle of the line's inliers: there the errors of a
    straight line's fit are independent.
    """
    for number, side in enumerate(SIDES):
        points: LinePoints = getattr(detection, side)
        line = fit_pixel_line(points, frame.camera, np.random.default_rng(0))
        if line is None:
            continue
        ideal = undistort(points.points_px, frame.camera)[line.inliers]
        sigma = np.maximum(points.sigma_px[line.inliers], MIN_SIGMA_PX)
        normal, along = line.coefficients[:2], np.array([-line.coefficients[1], line.coefficients[0]])
        along = along if along[1] >= 0 else -along
        weights, place = sigma**-2, ideal @ along
        middle = weights @ place / weights.sum()
        reach = float(np.sqrt(weights @ (place - middle) ** 2 / weights.sum()))
        order = np.argsort(place)
        residuals = ((ideal @ normal + line.coefficients[2]) / sigma)[order]
        inflation = float(noise_inflation([residuals], CORRELATION, CORRELATION_SIGMA)[0])
        ends = (middle + reach * np.array([[-1.0], [1.0]])) * along - line.coefficients[2] * normal
        pixels = distort(ends, frame.camera)
        if np.isfinite(pixels).all():
            yield number, pixels, np.full(2, max(inflation * np.sqrt(2 / weights.sum()), MIN_SIGMA_PX))


def make_view(
    frames: list[Frame],
    poses: PoseSpline,
    lines: list[tuple[int, int, Array, Array]],
    horizons: list[tuple[int, Horizon]],
) -> ApproachView:
    """The view of an approach from what its frames show.

    Args:
        frames: (N) with their poses.
        lines: number of the frame, and what `line_ends` yields for it.
        horizons: number of the frame, and its horizon.

    Raises:
        ValueError: cameras that differ between frames.
    """
    camera, mount = frames[0].camera, frames[0].body_from_camera
    for frame in frames:
        same = np.allclose(frame.body_from_camera.as_matrix(), mount.as_matrix())
        if frame.camera != camera or not same:
            raise ValueError(f"{frame.file}: another camera or mounting than in {frames[0].file}; calibrate needs one")
    index = np.array([line[:2] for line in lines], np.int64).reshape(-1, 2)
    dip = np.full(len(frames), np.nan)
    deck = np.array([np.nan if frame.deck_z_m is None else frame.deck_z_m for frame in frames])
    for number, frame in enumerate(frames):
        if frame.sea_z_m is not None and frame.world_from_camera is not None:
            height_m = max(frame.sea_z_m - float(frame.world_from_camera.translation[2]), 0.0)
            dip[number] = np.sqrt(2 * height_m / EARTH_RADIUS_M)
    return ApproachView(
        camera,
        mount,
        poses,
        np.array([frame.time_s for frame in frames]),
        deck,
        dip,
        np.repeat(index[:, 0], 2),
        np.repeat(index[:, 1], 2),
        np.tile(np.arange(2), len(lines)),
        np.concatenate([np.zeros((0, 2)), *(line[2] for line in lines)]),
        np.concatenate([np.zeros(0), *(line[3] for line in lines)]),
        {
            name: value
            for name, value in get_heights(frames[0]).items()
            if all(getattr(f, name) == value for f in frames)
        },
        np.array([number for number, _ in horizons], np.int64),
        np.array([(h.middle_px, h.middle_sigma_px, h.slope, h.slope_sigma) for _, h in horizons]).reshape(-1, 4),
    )


def spline_poses(times_s: Array, positions_m: Array, rotations: Rotation) -> PoseSpline:
    """Cubic splines through poses.

    Raises:
        ValueError: fewer poses than a cubic spline needs.
    """
    if len(times_s) < MIN_POSES:
        raise ValueError(f"calibrate needs poses at {MIN_POSES} times or more, got {len(times_s)}")
    return PoseSpline(times_s, CubicSpline(times_s, positions_m, bc_type="natural"), RotationSpline(times_s, rotations))


def _spline_of(source: Recording, poses: list[tuple[float, RigidTransform]], frames: list[Frame]) -> PoseSpline:
    """The track's poses around the frames; without a track those of the pictures."""
    if (track := source.pose_track) is None:
        times = np.array([time_s for time_s, _ in poses])
        positions = np.array([placed.translation for _, placed in poses])
        return spline_poses(times, positions, Rotation.concatenate([placed.rotation for _, placed in poses]))
    first, last = frames[0].time_s - POSE_MARGIN_S, frames[-1].time_s + POSE_MARGIN_S
    inside = np.flatnonzero((track.times_s >= first) & (track.times_s <= last))
    slots = np.floor((track.times_s[inside] - first) / MIN_POSE_STEP_S)
    chosen = inside[np.concatenate([[True], np.diff(slots) > 0])]
    return spline_poses(track.times_s[chosen], track.positions_m[chosen], track.rotations[chosen])


def _without_picture(frame: Frame) -> Frame:
    """The frame without its pixels, so that an approach fits into memory."""
    blank = np.broadcast_to(np.zeros(3, np.uint8), frame.image_rgb.shape)
    return replace(frame, image_rgb=blank, depth_m=None, truth=None)
