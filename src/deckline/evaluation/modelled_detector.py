"""Flights without pictures: the simulator's path, ship and navigation, and a modelled detector.

True lines are projected, and points and depth drawn about them from a stated model: thousands of frames a minute, so
that rare things can be counted. What a picture would show of its own, such as glare or clutter, is not in them.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.spatial.transform import RigidTransform

from deckline.config import Sensors
from deckline.evaluation.approaches import DEPTH_RANGE_M, miscalibrate
from deckline.extras import needs_extra
from deckline.geometry import Camera
from deckline.types import Detection, Frame, LinePoints, Segment, Truth

if TYPE_CHECKING:
    from deckline.sim import SimConfig

PATCH_PX = 2  # depth is filled in so far around every point; localization looks 1 px around it
SAMPLES = 2000  # along a line, to find what of it is in the image
BORDER_PX = 1.0
POINTS, MOTION, AIR = 31, 32, 33  # random streams


class Sighting(NamedTuple):
    """One frame of a flight and what the detector finds in it."""

    frame: Frame
    detection: Detection


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


def fly_points(config: "SimConfig", sensors: Sensors, noise: PointNoise) -> Iterator[Sighting]:
    """Every frame of an approach of a named preset, with the detector's points.

    The pose is the navigation unit's; calibration, deck height and depths err as in rendered flights. The picture is
    grain, another in every frame, as a camera's is.

    Raises:
        ImportError: the sim extra is not installed.
    """
    with needs_extra("sim"):
        from deckline.sim.camera.measure import measure_pose
        from deckline.sim.flight.approach import approach_view
        from deckline.sim.flight.views import draw_motion, ship_pose
        from deckline.sim.ship.layout import class_layout
        from deckline.sim.ship.ship_class import load_class
        from deckline.sim.simulate import draw_visibility, truth_segments
    layout = class_layout(load_class(config.preset))
    motion = draw_motion(config.motion, False, np.random.default_rng([config.seed, MOTION]))
    visibility_m = draw_visibility(config.visibility_m, np.random.default_rng([config.seed, AIR]))
    size = (config.height + config.frames, config.width, 3)
    grain = np.random.default_rng([config.seed, POINTS]).integers(0, 256, size, np.uint8)
    far_m, depth_sigma = noise.seen_share * visibility_m, sensors.depth_fraction
    for index in range(config.frames):
        view = approach_view(config, layout, index, motion)
        segments = truth_segments(layout.at_pose(ship_pose(layout, motion, view.time_s)))
        rng = np.random.default_rng([config.seed, POINTS, index])
        camera, pose = view.camera, view.world_from_camera
        left, right = (draw_points(segment, pose, camera, far_m, noise, rng) for segment in segments)
        depth = sparse_depth(camera, pose, segments, [left, right], depth_sigma, rng)
        truth = Truth(*segments, visibility_m=visibility_m, world_from_body=view.world_from_body)
        frame = Frame(
            f"point_{config.seed}_{index}",
            view.time_s,
            grain[index : index + config.height],
            camera,
            view.body_from_camera,
            depth_m=depth,
            world_from_body=measure_pose(view.world_from_body, view.time_s, config.navigation, config.seed),
            deck_z_m=float(layout.world_from_ship.translation[2]),
            truth=truth,
        )
        yield Sighting(miscalibrate(frame, sensors, config.seed), Detection(left, right))


def draw_points(
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
    u += noise.sigma_px * correlated_noise(len(rows), noise.correlation, rng)
    stray = rng.random(len(rows)) < noise.outlier_share
    u[stray] += rng.uniform(-noise.outlier_px, noise.outlier_px, int(stray.sum()))
    keep = (u >= 0) & (u <= camera.width - 1)
    points = np.column_stack([u, rows])[keep]
    return LinePoints(points, np.full(len(points), 0.9), np.full(len(points), noise.sigma_px))


def correlated_noise(count: int, correlation: float, rng: np.random.Generator) -> NDArray[np.float64]:
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
