"""An exact runway seen by an exact camera, noise for its measurements, and configurations of a still deck."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.config import Deck, FrameNoise, Localization, Mode, RunConfig, Sensors, Tracking
from deckline.geometry import Camera, attitude, camera_mount, wrap_angle
from deckline.localize import localize
from deckline.localize.observations import Observations, observe
from deckline.localize.ransac import fit_pixel_line
from deckline.types import (
    SIDES,
    Detection,
    Diagnostics,
    Frame,
    LinePoints,
    PixelLine,
    Reason,
    RunwayEstimate,
    RunwayLine,
    Segment,
)

DECK_Z_M = 6.08
CAMERA = Camera.from_fov(1280, 720, np.deg2rad(90))
LENS = replace(CAMERA, distortion=(-0.28, 0.08, 0.001, -0.0005, -0.01))


def segment(slope: float, constant: float) -> Segment:
    """A line of the paper's Table 6, slope x + y + constant = 0, 220 m long and run towards -x."""
    ends = [[x, -constant - slope * x, DECK_Z_M] for x in (0.0, -217.0)]
    return Segment(np.array(ends[0]), np.array(ends[1]))


LEFT, RIGHT = segment(0.16300, -35.788523), segment(0.15632, -20.889669)
PARALLEL_RIGHT = segment(0.16300, -20.889669)
PARALLEL_CENTRE = Segment((LEFT.p0_m + PARALLEL_RIGHT.p0_m) / 2, (LEFT.p1_m + PARALLEL_RIGHT.p1_m) / 2)


def still_deck(mode: Mode = "auto", sensors: Sensors | None = None, **deck: float) -> RunConfig:
    """A level deck at rest. Without tracking: one frame's fit may use a width."""
    settings = Deck(**{"sea_state": 0.0, "slope_deg": 0.0, **deck})
    return RunConfig(sensors or Sensors(), settings, localization=Localization(mode), tracking=Tracking(enabled=False))


STILL = still_deck()
NOISE = STILL.noise
ANY_ANGLE, PARALLEL = {"angle_sigma_deg": 1e6}, {"angle_sigma_deg": 1e-9}


def locate(
    frame: Frame, found: Detection, config: RunConfig = STILL, rng: np.random.Generator | None = None
) -> RunwayEstimate:
    """`localize` with seed 0."""
    return localize(frame, found, config, rng or np.random.default_rng(0))


def reasons(estimate: RunwayEstimate) -> list[Reason]:
    return [diagnostic.reason for diagnostic in estimate.diagnostics]


def azimuth(line: Segment) -> float:
    along = line.p1_m - line.p0_m
    return float(np.arctan2(along[1], along[0]))


LATERAL = np.array([-np.sin(azimuth(LEFT)), np.cos(azimuth(LEFT)), 0.0])  # to the right of the lines
WIDTH_M = float((PARALLEL_RIGHT.p0_m - LEFT.p0_m) @ LATERAL)


def approach(range_m, height_m, lateral_m=3.0, roll=0.02, pitch=-0.05, yaw=0.03, camera=CAMERA, right=RIGHT) -> Frame:
    """A frame without depth, `range` before the ramp."""
    ramp = (LEFT.p0_m + right.p0_m) / 2
    heading = (azimuth(LEFT) + azimuth(right)) / 2
    along = np.array([np.cos(heading), np.sin(heading), 0.0])
    across = np.array([-along[1], along[0], 0.0])
    position = ramp - range_m * along + lateral_m * across - [0.0, 0.0, height_m]
    return Frame(
        "exact.png",
        1.5,
        np.zeros((camera.height, camera.width, 3), dtype=np.uint8),
        camera,
        camera_mount([0.4, 0.1, 0.2], Rotation.from_euler("y", -0.1)),
        world_from_body=RigidTransform.from_components(position, attitude(roll, pitch, heading + yaw)),
        deck_z_m=DECK_Z_M,
    )


def depth_of_plane(frame: Frame, point_m: np.ndarray, gradient: np.ndarray, range_m: float = 400.0) -> np.ndarray:
    """Exact depth (H, W) of a plane through a point, whose z grows by `gradient` (3,), NaN farther than `range_m`."""
    v, u = np.mgrid[0 : frame.camera.height, 0 : frame.camera.width]
    pose = frame.world_from_camera
    rays = pose.rotation.apply(frame.camera.rays(np.column_stack([u.ravel(), v.ravel()]).astype(float)))
    normal = np.array([0.0, 0.0, 1.0]) - gradient
    with np.errstate(divide="ignore"):
        depth = ((point_m - pose.translation) @ normal / (rays @ normal)).reshape(v.shape)
    return np.where((depth > 0) & (depth < range_m), depth, np.nan).astype(np.float32)


def with_depth(frame: Frame, range_m: float = 400.0) -> Frame:
    """The frame with the exact depth of the level deck."""
    return replace(frame, depth_m=depth_of_plane(frame, np.array([0.0, 0.0, DECK_Z_M]), np.zeros(3), range_m))


def off_camera(camera: Camera, focal: float = 0.0, cx_px: float = 0.0, cy_px: float = 0.0) -> Camera:
    """A camera that differs from a stated one by a share of the focal length and in its principal point."""
    zoom = 1.0 + focal
    return replace(camera, fx=zoom * camera.fx, fy=zoom * camera.fy, cx=camera.cx + cx_px, cy=camera.cy + cy_px)


def spaced_pixels(camera: Camera, optical_m: np.ndarray, count: int) -> np.ndarray:
    """Pixels (count, 2) of a line's points (N, 3) from its near end on, about evenly spaced in rows; (0, 2): none."""
    pixels = camera.project(optical_m)
    pixels = pixels[np.all((pixels >= 1) & (pixels <= [camera.width - 2, camera.height - 2]), axis=1)]
    if not len(pixels):
        return pixels
    rows = np.linspace(pixels[0, 1], pixels[-1, 1], count)
    return pixels[np.searchsorted(-pixels[:, 1], -rows).clip(0, len(pixels) - 1)]


def horizon_line(camera: Camera, optical: Rotation, dip_rad: float = 0.0) -> tuple[float, float]:
    """Row in the middle column, and slope, of the line so far below level, as a camera with this attitude sees it."""
    view = optical.apply([0.0, 0.0, 1.0])
    azimuths = np.arctan2(view[1], view[0]) + np.deg2rad([-0.5, 0.5])
    far = np.column_stack([np.cos(azimuths), np.sin(azimuths), np.full(2, np.tan(dip_rad))])
    (u0, v0), (u1, v1) = camera.project(optical.inv().apply(far))
    slope = (v1 - v0) / (u1 - u0)
    return float(v0 + slope * ((camera.width - 1) / 2 - u0)), float(slope)


def line_points(frame: Frame, line: Segment, count: int = 40, sigma_px: float = 0.5) -> LinePoints:
    """Exact points of a line inside the image."""
    along = line.p0_m + np.linspace(0, 1, 4000)[:, None] * (line.p1_m - line.p0_m)
    pixels = spaced_pixels(frame.camera, frame.world_from_camera.inv().apply(along), count)
    return LinePoints(pixels, np.full(count, 0.9), np.full(count, sigma_px))


def detection(frame: Frame, right: Segment = RIGHT, count: int = 40, sigma_px: float = 0.5) -> Detection:
    return Detection(line_points(frame, LEFT, count, sigma_px), line_points(frame, right, count, sigma_px))


def keep(points: LinePoints, mask: np.ndarray, sigma_px: float | None = None) -> LinePoints:
    sigma = points.sigma_px[mask] if sigma_px is None else np.full(np.count_nonzero(mask), sigma_px)
    return LinePoints(points.points_px[mask], points.confidence[mask], sigma)


def nearest(points: LinePoints, count: int, sigma_px: float) -> LinePoints:
    rows = points.points_px[:, 1]
    return keep(points, rows >= np.sort(rows)[-count], sigma_px)


def slope_deck(frame: Frame, origin_m: np.ndarray, gradient: np.ndarray) -> tuple[Frame, Detection]:
    """Exact depth and points of the parallel lines when the deck's z grows by `gradient` (3,) from `origin_m`."""

    def rise(point: np.ndarray) -> np.ndarray:
        return point + np.array([0.0, 0.0, (point - origin_m) @ gradient])

    lines = [line_points(frame, Segment(rise(line.p0_m), rise(line.p1_m))) for line in (LEFT, PARALLEL_RIGHT)]
    return replace(frame, depth_m=depth_of_plane(frame, origin_m, gradient)), Detection(*lines)


def shift_points(points: LinePoints, rng: np.random.Generator) -> LinePoints:
    """Points whose u errs by their sigma."""
    shift = np.column_stack([rng.normal(0, points.sigma_px), np.zeros(len(points))])
    return replace(points, points_px=points.points_px + shift)


def add_noise(frame: Frame, exact: Detection, noise: FrameNoise, rng: np.random.Generator) -> tuple[Frame, Detection]:
    """The same scene as an imperfect aircraft measures it: every error of `noise`, and the detector's in u."""
    pose = frame.world_from_body
    turn = Rotation.from_rotvec(rng.normal(0, noise.attitude_rad, 3))
    measured_pose = RigidTransform.from_components(
        pose.translation + rng.normal(0, noise.position_m, 3), turn * pose.rotation
    )
    scale = np.float32(1 + rng.normal(0, noise.depth_scale))
    lines, depth = [], None if frame.depth_m is None else frame.depth_m * scale
    for points in (exact.left, exact.right):
        lines.append(shift_points(points, rng))
        if depth is not None:
            for u, v in np.rint(lines[-1].points_px).astype(int):
                depth[v - 1 : v + 2, u - 1 : u + 2] *= 1 + rng.normal(0, noise.depth_fraction)
    deck = DECK_Z_M + rng.normal(0, noise.deck_z_m)
    camera = off_camera(frame.camera, rng.normal(0, noise.focal_fraction))
    measured = replace(frame, world_from_body=measured_pose, depth_m=depth, deck_z_m=deck, camera=camera)
    return measured, Detection(*lines)


def remove_own_errors(line: RunwayLine, measured: Frame, true: Frame) -> tuple[np.ndarray, float]:
    """Point (3,) and azimuth of a line less the errors of the aircraft's own position and heading."""
    turn = (measured.world_from_body.rotation * true.world_from_body.rotation.inv()).as_rotvec()[2]
    way = line.point_m - measured.world_from_body.translation
    back = Rotation.from_euler("z", -turn).apply(way)
    return true.world_from_body.translation + back, line.azimuth_rad - turn


def error_at(
    point_m: np.ndarray, azimuth_rad: float, covariance: np.ndarray, truth: Segment, at_m: np.ndarray
) -> tuple:
    """Error (3,) of offset, azimuth and z of a line where it passes beside a point, and its covariance there."""
    angle = azimuth(truth)
    along, right = np.array([np.cos(angle), np.sin(angle), 0.0]), np.array([-np.sin(angle), np.cos(angle), 0.0])
    turn = float(wrap_angle(azimuth_rad - angle))
    lever = float((at_m - point_m) @ along)
    off = float((point_m - truth.p0_m) @ right) + lever * np.tan(turn)
    moved = np.array([[1.0, lever, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    return np.array([off, turn, point_m[2] - truth.p0_m[2]]), moved @ covariance @ moved.T


def observe_lines(
    frame: Frame, found: Detection, mode: Mode = "auto", sides: tuple[str, ...] = SIDES
) -> tuple[Observations, Diagnostics, dict[str, PixelLine]]:
    """Observations of the lines, diagnostics, and the lines in the image."""
    points = {side: getattr(found, side) for side in sides}
    lines = {side: fit_pixel_line(points[side], frame.camera, np.random.default_rng(0)) for side in sides}
    return *observe(frame, points, lines, mode), lines
