"""Approaches without pictures: points of both edge lines as a camera sees them that is not as it is stated."""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.calibrate.observations import ApproachView, line_ends, make_view, spline_poses
from deckline.config import Deck, RunConfig, Sensors
from deckline.dehaze.horizon import Horizon
from deckline.geometry import Camera, attitude, camera_mount
from deckline.types import Detection, Frame, LinePoints
from runway_scene import horizon_line, off_camera, spaced_pixels

STATED = Camera.from_fov(960, 540, np.deg2rad(80))
MOUNT = camera_mount([1.0, 0.2, 0.3], attitude(0.0, -0.05, 0.0))
BLANK = np.broadcast_to(np.zeros(3, np.uint8), (540, 960, 3))
AZIMUTH, RAMP, WIDTH_M, LENGTH_M = 0.3, np.array([40.0, -30.0, -20.0]), 16.0, 220.0
ALONG, RIGHT = np.array([np.cos(AZIMUTH), np.sin(AZIMUTH), 0.0]), np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0])
POINTS, SIGMA_PX = 30, 0.5
SENSORS = Sensors(position_m=0.1, position_white_m=0.05, attitude_deg=0.05, attitude_white_deg=0.01, deck_z_m=0.1)
CONFIG = RunConfig(SENSORS, Deck(sea_state=2.0, width_m=WIDTH_M, ship_velocity_m_s=(0.0, 0.0)))


@dataclass(frozen=True)
class Off:
    """How the true camera differs from the stated one."""

    mount_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)  # roll, pitch, yaw
    focal: float = 0.0  # share
    cx_px: float = 0.0
    cy_px: float = 0.0
    delay_s: float = 0.0  # of the pose behind the picture

    def camera(self, distortion: tuple[float, ...]) -> Camera:
        return off_camera(replace(STATED, distortion=distortion), self.focal, self.cx_px, self.cy_px)

    def mount(self) -> RigidTransform:
        turned = attitude(*np.deg2rad(self.mount_deg)) * MOUNT.rotation
        return RigidTransform.from_components(MOUNT.translation, turned)


@dataclass(frozen=True)
class Drawn:
    """An approach. The seed draws everything random; `errors` scales all that sensors and deck of CONFIG state."""

    off: Off = field(default_factory=Off)
    seed: int = 0
    errors: float = 1.0
    speed_m_s: float = 40.0
    start_m: float = 500.0
    end_m: float = 20.0
    frames: int = 45
    sides: tuple[str, ...] = ("left", "right")
    drift_m_s: float = 0.0
    shake_deg: tuple[float, float, float] = (2.0, 0.7, 0.7)  # amplitude of roll, pitch and yaw
    distortion: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0)


def true_pose(drawn: Drawn, time_s: float) -> RigidTransform:
    """A wandering approach whose attitude shakes."""
    phase = np.random.default_rng([drawn.seed, 1]).uniform(0, 2 * np.pi, 5)
    sway = np.sin(2 * np.pi * np.array([0.06, 0.05, 0.23, 0.19, 0.31]) * time_s + phase)
    ahead = -drawn.start_m + drawn.speed_m_s * time_s
    height = max((70.0 - ahead) * np.tan(np.deg2rad(3.5)) + sway[1], 3.0)
    position = RAMP + ahead * ALONG + 3.0 * sway[0] * RIGHT - [0.0, 0.0, height]
    roll, pitch, yaw = np.deg2rad(drawn.shake_deg) * sway[2:]
    return RigidTransform.from_components(position, attitude(roll, pitch - 0.04, AZIMUTH + yaw))


def draw_approach(drawn: Drawn, config: RunConfig = CONFIG) -> ApproachView:
    """The approach as `observe_approach` would return it."""
    rng, size = np.random.default_rng([drawn.seed, 2]), drawn.errors
    sensors, motion = config.sensors, config.deck.motion
    turn = size * rng.normal(0, np.deg2rad(sensors.attitude_drift_deg), 3)
    shift = size * rng.normal(0, sensors.position_drift_m, 3)
    deck_z = RAMP[2] + size * rng.normal(0, max(config.deck_rest_sigma_m, 1e-9))
    drift = drawn.drift_m_s + size * rng.normal(0, 0.3)
    swing = size * np.sqrt(2) * np.array([motion.heave_m, motion.pitch_rad, motion.roll_rad])
    phase = rng.uniform(0, 2 * np.pi, 3)
    duration_s = max((drawn.start_m - drawn.end_m) / max(drawn.speed_m_s, 1.0), 2.0)
    times = np.linspace(0.0, duration_s, drawn.frames)

    def measured(time_s: float) -> RigidTransform:
        true = true_pose(drawn, time_s - drawn.off.delay_s)
        wrong = Rotation.from_rotvec(turn + size * rng.normal(0, sensors.attitude_white_rad, 3))
        moved = true.translation + shift + size * rng.normal(0, sensors.position_white_m, 3)
        return RigidTransform.from_components(moved, wrong * true.rotation)

    camera = replace(STATED, distortion=drawn.distortion)
    frames, lines, horizons = [], [], []
    for time_s in times:
        frame = Frame("", time_s, BLANK, camera, MOUNT, world_from_body=measured(time_s), deck_z_m=deck_z, sea_z_m=0.0)
        heave, pitch, roll = swing * np.sin(2 * np.pi * time_s / np.array([12.0, 12.0, 22.0]) + phase)
        optical = true_pose(drawn, time_s) * drawn.off.mount()
        found = {}
        for side, sign in (("left", -0.5), ("right", 0.5)):
            along = np.geomspace(5.0, LENGTH_M, 400)[:, None]
            points = RAMP + along * ALONG + (sign * WIDTH_M + drift * (time_s - duration_s)) * RIGHT
            points[:, 2] += heave + pitch * along[:, 0] + roll * sign * WIDTH_M
            found[side] = _see(points, optical, drawn, rng) if side in drawn.sides else LinePoints.empty()
        lines += [(len(frames), *line) for line in line_ends(Detection(**found), frame)]
        if not camera.has_distortion and len(frames) % 5 == 0:
            horizons.append((len(frames), _horizon(optical, drawn, rng)))
        frames.append(frame)
    track = np.arange(-1.0, duration_s + 1.0, 0.05)
    poses = [measured(time_s) for time_s in track]
    rotations = Rotation.concatenate([pose.rotation for pose in poses])
    spline = spline_poses(track, np.array([pose.translation for pose in poses]), rotations)
    return make_view(frames, spline, lines, horizons)


def _see(points: np.ndarray, optical: RigidTransform, drawn: Drawn, rng: np.random.Generator) -> LinePoints:
    seen = spaced_pixels(drawn.off.camera(drawn.distortion), optical.inv().apply(points), POINTS)
    if len(np.unique(seen, axis=0)) < 10:
        return LinePoints.empty()
    seen[:, 0] += rng.normal(0, SIGMA_PX, POINTS)
    return LinePoints(seen, np.ones(POINTS), np.full(POINTS, SIGMA_PX))


def _horizon(optical: RigidTransform, drawn: Drawn, rng: np.random.Generator) -> Horizon:
    """The sea's horizon within a noise of 3 px."""
    dip_rad = np.sqrt(2 * -optical.translation[2] / 6.371e6)
    middle, slope = horizon_line(drawn.off.camera(drawn.distortion), optical.rotation, dip_rad)
    return Horizon(960, middle + rng.normal(0, 3.0), 3.0, slope + rng.normal(0, 0.01), 0.01)
