"""Approaches without pictures: true lines, a pose with errors, and lines as a detector with pixel noise gives them.

Points are projected with the true pose and back-projected with the measured one, onto the reported deck or with a
wrong depth; a weighted straight line goes through them. Nothing of the tracker's own equations is used.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.geometry import Camera, attitude, camera_mount
from deckline.types import DepthMode, Frame, LineVisibility, PixelLine, RunwayEstimate, RunwayLine

CAMERA = Camera.from_fov(1280, 720, np.deg2rad(90))
IMAGE = np.zeros((720, 1280, 3), dtype=np.uint8)
SPEED_M_S, SLOPE = 65.0, np.tan(np.deg2rad(3.5))
TOUCHDOWN_M, LENGTH_M, POINTS = 70.0, 220.0, 20
DEPTH_REACH_M = 200.0


@dataclass(frozen=True)
class Flight:
    """One approach to a runway that lands along azimuth 0.3 rad, deck at z = -20 m. Errors are 1-sigma."""

    spacing_m: float = 15.0
    angle_rad: float = np.deg2rad(0.3)
    start_m: float = 800.0
    rate_hz: float = 10.0
    modes: str = "coarse"  # "coarse", "fine" (wherever the depth camera reaches), or "both": fine where it reaches
    sigma_px: float = 0.5
    depth_noise: float = 0.01
    attitude_rad: float = np.deg2rad(0.1)
    position_m: float = 0.1
    white: float = 1.0  # share of the pose's stated white noise
    deck_z_m: float = 0.1
    depth_scale: float = 0.005
    line_m: float = 0.05
    delay_s: float = 0.02
    shake: float = 1.0
    ship_m_s: tuple[float, float] = (0.0, 0.0)
    pitch_rad: float = 0.0  # amplitude of the deck's pitch, 166 m behind the axis, period 12 s
    heave_m: float = 0.0  # amplitude, period 18 s
    lateral_m: float = 3.0
    seed: int = 0


AZIMUTH, DECK_Z_M, RAMP = 0.3, -20.0, np.array([40.0, -30.0, -20.0])
ALONG = np.array([np.cos(AZIMUTH), np.sin(AZIMUTH), 0.0])
ACROSS = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0])


def deck_rise(flight: Flight, time_s: float, x_m: float = 0.0) -> float:
    """How far the deck, x from the ramp, is above its mean, m; pitch moves it by its arm."""
    pitch = flight.pitch_rad * np.sin(2 * np.pi * time_s / 12.0 + flight.seed)
    return float(flight.heave_m * np.sin(2 * np.pi * time_s / 18.0 + 2.0 * flight.seed) - pitch * (166.0 - x_m))


def true_lines(flight: Flight, time_s: float) -> dict[str, RunwayLine]:
    """The lines through points beside the ramp."""
    sailed = time_s * np.array([*flight.ship_m_s, 0.0]) - [0.0, 0.0, deck_rise(flight, time_s)]
    found = {}
    for side, sign in (("left", -0.5), ("right", 0.5), ("centre", 0.0)):
        point = RAMP + sailed + sign * flight.spacing_m * ACROSS
        found[side] = RunwayLine(point, AZIMUTH + sign * flight.angle_rad, np.zeros((3, 3)))
    return found


def deviations(pose: RigidTransform, line: RunwayLine) -> np.ndarray:
    """Aircraft right of the line, m; nose right of it, rad; line below the aircraft, m."""
    right = np.array([-np.sin(line.azimuth_rad), np.cos(line.azimuth_rad), 0.0])
    nose, away = pose.rotation.apply([1.0, 0.0, 0.0]), pose.translation - line.point_m
    return np.array([away @ right, np.arctan2(nose[1], nose[0]) - line.azimuth_rad, -away[2]])


def true_pose(flight: Flight, time_s: float) -> RigidTransform:
    """The aircraft on a wandering approach, with the attitude shaking."""
    phase = np.random.default_rng([flight.seed, 1]).uniform(0, 2 * np.pi, 5)
    sway = np.sin(2 * np.pi * np.array([0.06, 0.05, 0.23, 0.19, 0.31]) * time_s + phase)
    sailed = time_s * np.array([*flight.ship_m_s, 0.0])
    x = -flight.start_m + SPEED_M_S * time_s
    height = max((TOUCHDOWN_M - x) * SLOPE + 1.0 * sway[1], 3.0)
    lateral = flight.lateral_m * sway[0]
    position = RAMP + sailed + x * ALONG + lateral * ACROSS - [0.0, 0.0, height]
    roll, pitch, yaw = flight.shake * np.deg2rad([1.5, 0.5, 0.5]) * sway[2:]
    return RigidTransform.from_components(position, attitude(roll, pitch - 0.06, AZIMUTH + yaw))


@dataclass(frozen=True)
class Errors:
    """One draw of everything that stays the same during a flight."""

    turn_rad: np.ndarray
    shift_m: np.ndarray
    deck_z_m: float
    depth_scale: float
    line_m: np.ndarray
    delay_s: float


def draw_errors(flight: Flight) -> Errors:
    rng = np.random.default_rng([flight.seed, 2])
    return Errors(
        rng.normal(0, flight.attitude_rad, 3),
        rng.normal(0, flight.position_m, 3),
        rng.normal(0, flight.deck_z_m),
        rng.normal(0, flight.depth_scale),
        rng.normal(0, flight.line_m, 2),
        rng.normal(0, flight.delay_s),
    )


def approach(
    flight: Flight, end_m: float = 20.0, errors: Errors | None = None
) -> Iterator[tuple[Frame, RunwayEstimate, RigidTransform]]:
    """Frames with estimates, and the true pose of each."""
    errors = errors or draw_errors(flight)
    rng = np.random.default_rng([flight.seed, 3])
    count = int((flight.start_m - end_m) / SPEED_M_S * flight.rate_hz)
    for index in range(count):
        time_s = index / flight.rate_hz
        yield one_frame(flight, time_s, errors, rng)


def one_frame(
    flight: Flight, time_s: float, errors: Errors, rng: np.random.Generator
) -> tuple[Frame, RunwayEstimate, RigidTransform]:
    truth, late = true_pose(flight, time_s), true_pose(flight, time_s - errors.delay_s)
    turn = errors.turn_rad + rng.normal(0, flight.white * np.deg2rad(0.02), 3)
    shift = errors.shift_m + rng.normal(0, flight.white * 0.05, 3)
    measured = RigidTransform.from_components(late.translation + shift, Rotation.from_rotvec(turn) * late.rotation)
    lines = true_lines(flight, time_s)
    mount = camera_mount()
    range_m = float(-(truth.translation - lines["centre"].point_m) @ ALONG)
    fine = flight.modes == "fine" or (flight.modes == "both" and range_m < DEPTH_REACH_M - 40.0)
    frame = Frame(
        f"{time_s:.3f}.png", time_s, IMAGE, CAMERA, mount, world_from_body=measured, deck_z_m=DECK_Z_M + errors.deck_z_m
    )
    found, pixel_lines = {}, {}
    for side, beside in zip(("left", "right"), errors.line_m, strict=True):
        seen = _measure_line(lines[side], flight, time_s, truth * mount, frame, beside, fine, errors.depth_scale, rng)
        if seen is not None:
            found[side], pixel_lines[side] = seen
    if len(found) < 2:
        return frame, RunwayEstimate(LineVisibility.NONE, DepthMode.NONE, {}, {}), truth
    height = np.mean([line.height_m for line in found.values()])
    lines_found = {s: replace(line, point_m=np.array([*line.point_m[:2], height])) for s, line in found.items()}
    mode = DepthMode.FINE if fine else DepthMode.COARSE
    ramp = lines["centre"].point_m + rng.normal(0, 1.0) * ALONG
    ramp[2] = height
    estimate = RunwayEstimate(LineVisibility.BOTH, mode, pixel_lines, lines_found, ramp, 1.0)
    return frame, estimate, truth


def _measure_line(line, flight, time_s, world_from_camera, frame, beside_m, fine, scale, rng):
    """One line as measured, or None where too little of it is in the image."""
    along = np.linspace(0.0, LENGTH_M, 120)
    right = np.array([-np.sin(line.azimuth_rad), np.cos(line.azimuth_rad), 0.0])
    points = line.point_m + along[:, None] * line.direction + beside_m * right
    points[:, 2] = DECK_Z_M - np.array([deck_rise(flight, time_s, x) for x in (0.0, LENGTH_M)]) @ [
        1 - along / LENGTH_M,
        along / LENGTH_M,
    ]
    optical = world_from_camera.inv().apply(points)
    optical = optical[(optical[:, 2] > 2.0) & ((optical[:, 2] < DEPTH_REACH_M) | (not fine))]
    pixels = CAMERA.project(optical) if len(optical) else np.zeros((0, 2))
    inside = np.all((pixels > 0) & (pixels < [1279, 719]), axis=1)
    if inside.sum() < 10:
        return None
    pixels, optical = pixels[inside], optical[inside]
    rows = np.linspace(pixels[0, 1], pixels[-1, 1], POINTS)[::-1]
    inverse = np.interp(rows, pixels[::-1, 1], 1 / optical[::-1, 2])  # linear in the image, as all of a plane is
    noisy = np.column_stack([np.interp(rows, pixels[::-1, 1], pixels[::-1, 0]), rows])
    noisy[:, 0] += rng.normal(0, flight.sigma_px, POINTS)
    depth = (1 + scale) * (1 + rng.normal(0, flight.depth_noise, POINTS)) / inverse if fine else None
    ends = noisy[[-1, 0]]
    normal = np.array([ends[1, 1] - ends[0, 1], ends[0, 0] - ends[1, 0]])
    normal /= np.linalg.norm(normal)
    return _fit(frame, noisy, depth, flight), PixelLine(
        np.array([*normal, -normal @ ends[0]]), np.ones(POINTS, bool), ends, flight.sigma_px
    )


def _fit(frame: Frame, pixels, depth, flight: Flight) -> RunwayLine:
    """Weighted straight line through the back-projected points; its covariance from what moves every point."""
    camera = frame.world_from_camera
    rays = camera.rotation.apply(CAMERA.rays(pixels))
    far = (frame.deck_z_m - camera.translation[2]) / rays[:, 2] if depth is None else depth
    away = far[:, None] * rays
    points = camera.translation + away
    own = far / CAMERA.fx * flight.sigma_px
    weights = 1 / own**2
    centre = weights @ points[:, :2] / weights.sum()
    _, vectors = np.linalg.eigh(((points[:, :2] - centre) * weights[:, None]).T @ (points[:, :2] - centre))
    direction = vectors[:, 1] * np.sign(vectors[:, 1] @ ALONG[:2])
    along = (points[:, :2] - centre) @ direction
    tilt = np.hypot(flight.depth_noise * away[:, 2], flight.attitude_rad * far)
    shares = np.stack([weights / weights.sum(), weights * along / (weights @ along**2), tilt**-2 / (tilt**-2).sum()])

    turns = np.cross(np.eye(3)[:, None], away) * flight.attitude_rad
    shifts = np.eye(3)[:, None] * flight.position_m + np.zeros_like(turns)
    carried = np.concatenate([np.zeros((2, *away.shape)), turns[2:], shifts, np.zeros((1, *away.shape))])
    last = flight.depth_scale * away if depth is not None else rays / rays[:, 2:] * flight.deck_z_m
    moved = np.concatenate([turns, shifts, last[None]])
    if depth is None:
        moved[:6] -= rays * (moved[:6, :, 2:] / rays[:, 2:])
    across = np.array([-direction[1], direction[0]])

    def effect(step):  # (K, N, 3) -> (3, K): offset, azimuth, z
        return np.concatenate([shares[:2] @ (step[..., :2] @ across).T, shares[2:] @ step[..., 2].T])

    noise = np.diag([1 / weights.sum(), 1 / (weights @ along**2), 1e-8])
    if depth is not None:
        noise[2, 2] += shares[2] ** 2 @ (flight.depth_noise * away[:, 2]) ** 2
    common, relative = effect(moved), effect(moved - carried)
    z = shares[2] @ points[:, 2]
    return RunwayLine(
        np.array([*centre, z]),
        float(np.arctan2(direction[1], direction[0])),
        noise + common @ common.T,
        noise + relative @ relative.T,
    )
