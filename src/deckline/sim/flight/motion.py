"""How the ship moves: under way along its heading, and rolling, pitching and heaving in the sea.

Each deck motion is a single sine about the ship's middle at the waterline. A runway on land stays where it is, whatever
motion is asked for. Everywhere here, `layout` is the ship as it lies at time 0.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.geometry import attitude
from deckline.sim.config import MotionConfig
from deckline.sim.scene.waves import STATE_HEIGHT_M
from deckline.sim.ship.layout import Layout

PERIODS_S = (22.0, 12.0, 18.0)  # roll, pitch, heave of a large carrier
SEA_STATES = (0, 1, 2, 3, 4, 5, 6)
AMPLITUDES = {4: (0.62, 0.52, 0.68), 5: (0.98, 0.82, 1.09), 6: (1.44, 1.24, 1.63)}  # deg, deg, m of sea states
TRAIN_STILL = 0.3  # part of the training recordings whose ship lies still


@dataclass(frozen=True)
class Motion:
    """One ship's motion, all random choices made."""

    speed_m_s: float = 0.0
    roll_rad: float = 0.0  # amplitudes
    pitch_rad: float = 0.0
    heave_m: float = 0.0
    phases_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)  # of roll, pitch, heave at time 0


STILL = Motion()


def deck_amplitudes(sea_state: float) -> tuple[float, float, float]:
    """Amplitudes of roll, rad, pitch, rad, and heave, m.

    States below 4 are state 4's times the ratio of the significant wave heights; between two states they run straight.
    """
    calmer = [np.array(AMPLITUDES[4]) * height / STATE_HEIGHT_M[4] for height in STATE_HEIGHT_M[:4]]
    table = np.array([*calmer, *AMPLITUDES.values()])
    roll, pitch, heave = (float(np.interp(sea_state, SEA_STATES, column)) for column in table.T)
    return float(np.deg2rad(roll)), float(np.deg2rad(pitch)), heave


def draw_motion(config: MotionConfig, train: bool, rng: np.random.Generator) -> Motion:
    """The motion of one recording, or of one unrelated view; `train`: as preset `train` has it."""
    drawn = 0.0 if rng.random() < TRAIN_STILL else float(rng.uniform(SEA_STATES[0], SEA_STATES[-1]))
    roll, pitch, heave = (float(angle) for angle in rng.uniform(0.0, 2 * np.pi, 3))
    state = config.sea_state if config.sea_state is not None else drawn if train else 0.0
    return Motion(config.ship_speed_m_s, *deck_amplitudes(state), phases_rad=(roll, pitch, heave))


def steady_pose(layout: Layout, motion: Motion, time_s: float) -> RigidTransform:
    """world_from_ship without roll, pitch and heave: what an aircraft's path is relative to."""
    travelled = RigidTransform.from_translation(time_s * steady_velocity(layout, motion))
    return travelled * layout.world_from_ship


def ship_pose(layout: Layout, motion: Motion, time_s: float) -> RigidTransform:
    """world_from_ship with everything: speed, roll and pitch about the middle at the waterline, heave."""
    (roll, pitch, heave), _ = _swing(layout, motion, time_s)
    turn, middle = attitude(roll, pitch, 0.0), middle_m(layout)
    swung = RigidTransform.from_components(middle - turn.apply(middle), turn)
    return RigidTransform.from_translation([0.0, 0.0, -heave]) * steady_pose(layout, motion, time_s) * swung


def ship_velocity(
    layout: Layout, motion: Motion, time_s: float, point_m: ArrayLike = (0.0, 0.0, 0.0)
) -> NDArray[np.float64]:
    """Velocity (3,) in the world, m/s, of a point (3,) of the ship frame."""
    (roll, pitch, _), (roll_rate, pitch_rate, heave_rate) = _swing(layout, motion, time_s)
    turn = attitude(roll, pitch, 0.0)
    rate = Rotation.from_euler("y", pitch).apply(np.array([roll_rate, pitch_rate, 0.0]))
    arm = turn.apply(np.asarray(point_m, dtype=np.float64) - middle_m(layout))
    swinging = layout.world_from_ship.rotation.apply(np.cross(rate, arm))
    return steady_velocity(layout, motion) + swinging - [0.0, 0.0, heave_rate]


def deck_rise(layout: Layout, motion: Motion, time_s: float, point_m: ArrayLike) -> float:
    """How far, m, a deck point (2,) of the ship frame stands above where the steady ship has it."""
    (roll, pitch, heave), _ = _swing(layout, motion, time_s)
    arm = np.array([*np.asarray(point_m, dtype=np.float64), 0.0]) - middle_m(layout)
    return float(heave - (attitude(roll, pitch, 0.0).apply(arm)[2] - arm[2]))


def steady_velocity(layout: Layout, motion: Motion) -> NDArray[np.float64]:
    """Velocity (3,) in the world, m/s, with which the ship sails along its heading."""
    speed = 0.0 if layout.on_land else motion.speed_m_s
    return speed * layout.world_from_ship.rotation.apply([1.0, 0.0, 0.0])


def middle_m(layout: Layout) -> NDArray[np.float64]:
    """The point (3,) of the ship frame about which the ship rolls and pitches."""
    return np.array([layout.length_m / 2, 0.0, layout.deck_height_m])


def _swing(layout: Layout, motion: Motion, time_s: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Roll, pitch and heave (up), and their rates."""
    size = (0.0 if layout.on_land else 1.0) * np.array([motion.roll_rad, motion.pitch_rad, motion.heave_m])
    rate = 2 * np.pi / np.array(PERIODS_S)
    angle = rate * time_s + np.array(motion.phases_rad)
    return size * np.sin(angle), size * rate * np.cos(angle)
