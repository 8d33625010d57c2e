"""Where ship and camera are: the motion of the ship, and unrelated views around the glide path and from elsewhere.

The ship sails along its heading, and rolls, pitches and heaves; each of these is a single sine about its middle at the
waterline. A runway on land stays where it is, whatever motion is asked for.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.config import Approach
from deckline.geometry import Camera, attitude, camera_mount
from deckline_sim.config import MotionConfig, SimConfig
from deckline_sim.scene.waves import STATE_HEIGHT_M
from deckline_sim.ship.layout import Layout, world_points
from deckline_sim.ship.paint_shapes import axes

PERIODS_S = (22.0, 12.0, 18.0)  # roll, pitch, heave of a large carrier
SEA_STATES = (0, 1, 2, 3, 4, 5, 6)
AMPLITUDES = {4: (0.62, 0.52, 0.68), 5: (0.98, 0.82, 1.09), 6: (1.44, 1.24, 1.63)}  # deg, deg, m of sea states
TRAIN_STILL = 0.3  # part of the training recordings whose ship lies still
TOUCHDOWN_M = Approach.touchdown_m  # that the glide angles of random views refer to
RAMP_CLEARANCE_M = 3.05  # 10 ft, the least that an aircraft clears the ramp by
APPARENT_WIDTH = (0.012, 1.0)  # the runway's width at the ramp over the image's, for a view worth training on
TRAIN_FOV_DEG = (10.0, 90.0)
FEW, FEW_ENOUGH, ENOUGH = 0.12, 0.2, 0.65  # few views may show so little of the lines, the others no less than that
DECK_SHARE, ODD_SHARE, AWAY_SHARE = 0.06, 0.04, 0.06  # of the training views; the others lie around the glide path
ODD_RANGE_M = (150.0, 2000.0)  # from the ship's middle
CLEAR_OF_SHIP_M = 80.0  # of a view from any side to the ship's ends
DECK_HEIGHT_M = (6.0, 30.0)  # over the deck; where there is no runway, parked aircraft up to 5.6 m high may be below
SPEED_M_S = 65.0
RATES_RAD_S = np.deg2rad([4.0, 1.5, 1.5])  # 1-sigma of roll, pitch and yaw rate; our choice
ELEVATION_DEG = (2.0, 8.0)  # of the camera over its target, as on a glide path
NUDGE_DEG = (4.0, 3.0, 6.0)  # 1-sigma of roll, pitch and yaw about that direction


@dataclass(frozen=True)
class ShipMotion:
    """One ship's motion, all random choices made."""

    speed_m_s: float = 0.0
    roll_rad: float = 0.0  # amplitudes
    pitch_rad: float = 0.0
    heave_m: float = 0.0
    phases_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)  # of roll, pitch, heave at time 0
    period_factor: float = 1.0  # on `PERIODS_S`


STILL = ShipMotion()


def deck_amplitudes(sea_state: float) -> tuple[float, float, float]:
    """Amplitudes of roll, rad, pitch, rad, and heave, m.

    States below 4 are state 4's times the ratio of the significant wave heights; between two states they run straight.
    """
    calmer = [np.array(AMPLITUDES[4]) * height / STATE_HEIGHT_M[4] for height in STATE_HEIGHT_M[:4]]
    table = np.array([*calmer, *AMPLITUDES.values()])
    roll, pitch, heave = (float(np.interp(sea_state, SEA_STATES, column)) for column in table.T)
    return float(np.deg2rad(roll)), float(np.deg2rad(pitch)), heave


def draw_motion(config: MotionConfig, train: bool, rng: np.random.Generator) -> ShipMotion:
    """The motion of one recording, or of one unrelated view; `train`: as preset `train` has it."""
    drawn = 0.0 if rng.random() < TRAIN_STILL else float(rng.uniform(SEA_STATES[0], SEA_STATES[-1]))
    roll, pitch, heave = (float(angle) for angle in rng.uniform(0.0, 2 * np.pi, 3))
    state = config.sea_state if config.sea_state is not None else drawn if train else 0.0
    return ShipMotion(config.ship_speed_m_s, *deck_amplitudes(state), phases_rad=(roll, pitch, heave))


def steady_pose(layout: Layout, motion: ShipMotion, time_s: float) -> RigidTransform:
    """world_from_ship without roll, pitch and heave: what an aircraft's path is relative to."""
    travelled = RigidTransform.from_translation(time_s * steady_velocity(layout, motion))
    return travelled * layout.world_from_ship


def ship_pose(layout: Layout, motion: ShipMotion, time_s: float) -> RigidTransform:
    """world_from_ship with everything: speed, roll and pitch about the middle at the waterline, heave."""
    (roll, pitch, heave), _ = swing(layout, motion, time_s)
    turn, middle = attitude(roll, pitch, 0.0), middle_m(layout)
    swung = RigidTransform.from_components(middle - turn.apply(middle), turn)
    return RigidTransform.from_translation([0.0, 0.0, -heave]) * steady_pose(layout, motion, time_s) * swung


def ship_velocity(
    layout: Layout, motion: ShipMotion, time_s: float, point_m: ArrayLike = (0.0, 0.0, 0.0)
) -> NDArray[np.float64]:
    """Velocity (3,) in the world, m/s, of a point (3,) of the ship frame."""
    (roll, pitch, _), (roll_rate, pitch_rate, heave_rate) = swing(layout, motion, time_s)
    turn = attitude(roll, pitch, 0.0)
    rate = Rotation.from_euler("y", pitch).apply(np.array([roll_rate, pitch_rate, 0.0]))
    arm = turn.apply(np.asarray(point_m, dtype=np.float64) - middle_m(layout))
    swinging = layout.world_from_ship.rotation.apply(np.cross(rate, arm))
    return steady_velocity(layout, motion) + swinging - [0.0, 0.0, heave_rate]


def deck_rise(layout: Layout, motion: ShipMotion, time_s: float, point_m: ArrayLike) -> float:
    """Height, m, of a deck point (2,) of the ship frame above its place on the steady ship."""
    (roll, pitch, heave), _ = swing(layout, motion, time_s)
    arm = np.array([*np.asarray(point_m, dtype=np.float64), 0.0]) - middle_m(layout)
    return float(heave - (attitude(roll, pitch, 0.0).apply(arm)[2] - arm[2]))


def steady_velocity(layout: Layout, motion: ShipMotion) -> NDArray[np.float64]:
    """Velocity (3,) in the world, m/s, with which the ship sails along its heading."""
    speed = 0.0 if layout.on_land else motion.speed_m_s
    return speed * layout.world_from_ship.rotation.apply([1.0, 0.0, 0.0])


def middle_m(layout: Layout) -> NDArray[np.float64]:
    """The point (3,) of the ship frame about which the ship rolls and pitches."""
    return np.array([layout.length_m / 2, 0.0, layout.deck_height_m])


def swing(layout: Layout, motion: ShipMotion, time_s: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Roll, pitch and heave (up) (3,) of the ship at a time, rad and m, and their rates (3,)."""
    size = (0.0 if layout.on_land else 1.0) * np.array([motion.roll_rad, motion.pitch_rad, motion.heave_m])
    rate = swing_rates(motion)
    angle = rate * time_s + np.array(motion.phases_rad)
    return size * np.sin(angle), size * rate * np.cos(angle)


def swing_rates(motion: ShipMotion) -> NDArray[np.float64]:
    """Angular frequencies (3,) of roll, pitch and heave, rad/s."""
    return np.asarray(2 * np.pi / (motion.period_factor * np.array(PERIODS_S)))


@dataclass(frozen=True, eq=False)
class Viewpoint:
    """Pose, camera, time and motion of one frame."""

    world_from_body: RigidTransform
    camera: Camera
    time_s: float
    body_from_camera: RigidTransform = field(default_factory=camera_mount)
    velocity_m_s: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))  # (3,) over the water, world
    # (3,) of the camera against the world, about the body's axes
    angular_rate_rad_s: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))

    @property
    def world_from_camera(self) -> RigidTransform:
        return self.world_from_body * self.body_from_camera


def random_view(
    config: SimConfig, layout: Layout, index: int, rng: np.random.Generator, motion: ShipMotion = STILL
) -> Viewpoint:
    """An unrelated view at time `index` seconds.

    For the named presets, and mostly for `train`: from somewhere around the glide path, showing enough of the runway.
    Preset `train` also has views over the deck, of the ship from any side, and past it.

    Args:
        layout: the ship as it lies at time 0.
    """
    rise = deck_rise(layout, motion, float(index), layout.centre_m[0])
    layout = layout.at_pose(steady_pose(layout, motion, float(index)))
    kind = rng.random() if config.preset == "train" else 1.0
    if kind < DECK_SHARE:
        view = deck_view(config, layout, rng)
    elif kind < DECK_SHARE + ODD_SHARE:
        view = from_any_side(config, layout, rng, aim_deg=0.0)
    elif kind < DECK_SHARE + ODD_SHARE + AWAY_SHARE:
        view = away_view(config, layout, rng)
    else:
        view = glide_view(config, layout, rng)
    lifted = RigidTransform.from_translation([0.0, 0.0, -max(rise, 0.0)])  # a view stays clear of a ramp that rises
    ahead = view.world_from_body.rotation.apply([1.0, 0.0, 0.0])
    return replace(
        view,
        world_from_body=lifted * view.world_from_body,
        time_s=float(index),
        velocity_m_s=SPEED_M_S * ahead + steady_velocity(layout, motion),
        angular_rate_rad_s=RATES_RAD_S * rng.normal(0.0, 1.0, 3),
    )


def glide_view(config: SimConfig, layout: Layout, rng: np.random.Generator) -> Viewpoint:
    """Before the ramp, around the glide path, showing enough of the runway."""
    enough = FEW_ENOUGH if rng.random() < FEW else ENOUGH
    for _ in range(40):
        view = draw_view(config, layout, rng)
        if runway_in_view(view, layout) >= enough:
            break
    return view


def draw_view(config: SimConfig, layout: Layout, rng: np.random.Generator) -> Viewpoint:
    """Range, elevation, lateral offset, roll and where in the image the runway shall be."""
    wide = config.preset == "train"
    range_m, fov_rad = draw_range(config, layout, rng)
    length = axes(*layout.centre_m)[2]
    usual = (1.5, 12.0) if wide and rng.random() < 0.3 else ELEVATION_DEG
    low, high = config.elevation_deg or usual
    height = max((range_m + TOUCHDOWN_M) * np.tan(np.deg2rad(rng.uniform(low, high))), RAMP_CLEARANCE_M)
    reach = 0.25 if wide else 0.2
    position = runway_point(layout, -range_m, range_m * rng.uniform(-reach, reach), height)
    target = runway_point(layout, rng.uniform(0.0, 0.5) * length)
    camera = Camera.from_fov(config.width, config.height, fov_rad)
    du, dv = np.clip(rng.normal(0.0, 0.22, 2), -0.45, 0.45) * [camera.width, camera.height]
    sigma, most = (5.0, 12.0) if wide else (4.0, 8.0)
    roll = np.deg2rad(np.clip(rng.normal(0.0, sigma), -most, most))
    nudge = np.array([roll, np.arctan(dv / camera.fy), -np.arctan(du / camera.fx)])
    return Viewpoint(pose_towards(position, target, nudge), camera, 0.0)


def draw_range(config: SimConfig, layout: Layout, rng: np.random.Generator) -> tuple[float, float]:
    """Distance to the ramp, m, and horizontal field of view, rad."""
    low, high = np.log(config.ranges_m)
    width = float(np.hypot(*(layout.right_m[0] - layout.left_m[0])))
    fixed = config.preset != "train" or config.fixed_fov
    for _ in range(100):
        range_m = float(np.exp(rng.uniform(low, high)))
        fov_rad = draw_fov(config, rng)
        apparent = width / (2 * range_m * np.tan(fov_rad / 2))
        if fixed or APPARENT_WIDTH[0] <= apparent <= APPARENT_WIDTH[1]:
            break
    return range_m, fov_rad


def draw_fov(config: SimConfig, rng: np.random.Generator, narrowest_deg: float = TRAIN_FOV_DEG[0]) -> float:
    """Horizontal field of view, rad."""
    if config.preset != "train" or config.fixed_fov:
        return float(np.deg2rad(config.fov_deg))
    return float(np.deg2rad(np.exp(rng.uniform(np.log(narrowest_deg), np.log(TRAIN_FOV_DEG[1])))))


def deck_view(config: SimConfig, layout: Layout, rng: np.random.Generator) -> Viewpoint:
    """Past the ramp, low over the landing area, looking ahead."""
    width = float(np.hypot(*(layout.right_m[0] - layout.left_m[0])))
    height = float(np.exp(rng.uniform(*np.log(DECK_HEIGHT_M))))
    along = rng.uniform(0.0, min(60.0, 0.3 * axes(*layout.centre_m)[2]))
    right = rng.uniform(-0.35, 0.35) * width
    target = runway_point(layout, along + 100.0, right)
    nudge = np.deg2rad(np.clip(rng.normal(0.0, 1.0, 3), -2.4, 2.4) * [5.0, 5.0, 5.0])
    camera = Camera.from_fov(config.width, config.height, draw_fov(config, rng, 35.0))
    return Viewpoint(pose_towards(runway_point(layout, along, right, height), target, nudge), camera, 0.0)


def away_view(config: SimConfig, layout: Layout, rng: np.random.Generator) -> Viewpoint:
    """From any side, looking past the ship: the sea, perhaps a part of the ship, none of the runway."""
    for _ in range(40):
        aim = rng.uniform(10.0, 60.0) if rng.random() < 0.6 else rng.uniform(60.0, 180.0)
        view = from_any_side(config, layout, rng, float(rng.choice([-1.0, 1.0]) * aim))
        if runway_in_view(view, layout) == 0.0:
            break
    return view


def from_any_side(config: SimConfig, layout: Layout, rng: np.random.Generator, aim_deg: float) -> Viewpoint:
    """Any azimuth about the ship's middle, abeam and ahead too, looking `aim_deg` clockwise of the runway."""
    range_m = float(np.exp(rng.uniform(*np.log(ODD_RANGE_M))))
    range_m = max(range_m, layout.length_m / 2 + CLEAR_OF_SHIP_M)
    azimuth = rng.uniform(0.0, 2 * np.pi)
    height = range_m * np.tan(np.deg2rad(rng.uniform(2.0, 20.0)))
    spot = [layout.length_m / 2 + range_m * np.cos(azimuth), range_m * np.sin(azimuth), -height]
    target = runway_point(layout, rng.uniform(0.0, 0.8) * axes(*layout.centre_m)[2])
    nudge = np.deg2rad(rng.normal([0.0, 0.0, aim_deg], 4.0))
    camera = Camera.from_fov(config.width, config.height, draw_fov(config, rng, 20.0))
    return Viewpoint(pose_towards(layout.world_from_ship.apply(spot), target, nudge), camera, 0.0)


def view_towards(
    config: SimConfig, target_m: NDArray[np.float64], range_m: float, rng: np.random.Generator
) -> Viewpoint:
    """From any azimuth about a point (3,) of the world, as far above it as on a glide path."""
    azimuth = rng.uniform(0.0, 2 * np.pi)
    height_m = range_m * np.tan(np.deg2rad(rng.uniform(*ELEVATION_DEG)))
    away = np.array([range_m * np.cos(azimuth), range_m * np.sin(azimuth), -height_m])
    nudge = np.deg2rad(np.clip(rng.normal(0.0, 1.0, 3), -2.4, 2.4) * NUDGE_DEG)
    camera = Camera.from_fov(config.width, config.height, draw_fov(config, rng))
    return Viewpoint(pose_towards(target_m + away, target_m, nudge), camera, 0.0)


def pose_towards(
    position_m: NDArray[np.float64], target_m: NDArray[np.float64], nudge_rad: NDArray[np.float64]
) -> RigidTransform:
    """world_from_body at a position whose nose points at a target, then turned by (roll, pitch, yaw)."""
    delta = target_m - position_m
    yaw, pitch = np.arctan2(delta[1], delta[0]), np.arctan2(-delta[2], np.hypot(delta[0], delta[1]))
    return RigidTransform.from_components(position_m, attitude(nudge_rad[0], pitch + nudge_rad[1], yaw + nudge_rad[2]))


def runway_in_view(view: Viewpoint, layout: Layout) -> float:
    """Part of the two edge lines, measured along the deck, that lies inside the image, 0..1."""
    steps = np.linspace(0.0, 1.0, 12)[:, None]
    points = np.concatenate([line[0] + steps * (line[1] - line[0]) for line in (layout.left_m, layout.right_m)])
    pixels = view.camera.project(view.world_from_camera.inv().apply(world_points(layout, points)))
    with np.errstate(invalid="ignore"):
        inside = np.all((pixels >= 0) & (pixels <= [view.camera.width - 1, view.camera.height - 1]), axis=1)
    return float(inside.mean())


def runway_point(layout: Layout, along_m: float, right_m: float = 0.0, up_m: float = 0.0) -> NDArray[np.float64]:
    """A point (3,) in the world: so far past the ramp along the centre line, to its right, above the deck."""
    along, right, _ = axes(*layout.centre_m)
    return world_points(layout, (layout.centre_m[0] + along_m * along + right_m * right)[None], up_m)[0]
