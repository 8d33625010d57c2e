"""What all ways to see share: the ship and its motion, the camera's mount, what the aircraft knows, sensor errors."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.config import GRADES, Approach, Integrity, RunConfig
from deckline.config import Deck as KnownDeck
from deckline.flight import Flight
from deckline.geometry import Camera, camera_mount
from deckline.types import Frame, RunwayPrior, Truth
from deckline_sim.camera.measure import measure_pose, miscalibrate, navigation_unit
from deckline_sim.config import MotionConfig, NavigationConfig
from deckline_sim.flight.viewpoints import ShipMotion, draw_motion, steady_pose, steady_velocity
from deckline_sim.landing.air import steady_wind
from deckline_sim.landing.aircraft import AIRCRAFT_TYPES
from deckline_sim.landing.config import LandingConfig
from deckline_sim.landing.deck import Deck
from deckline_sim.landing.sight import Moment
from deckline_sim.ship.layout import Layout, class_layout, truth_segments
from deckline_sim.ship.ship_class import load_class

MOUNT_DOWN_DEG = 7.5  # of the camera's axis below the body's: incidence of 4 degrees and a path of 3.5; our choice
DATALINK_SIGMA_M = 5.0  # 1-sigma of the ship's place as its datalink reports it, deck motion included; our choice
MAX_WIDTH_FRACTION = 0.25  # by which the width of the ship's datalink can be wrong: another ship's; our choice
DATALINK_HEADING_SIGMA_DEG = 1.0  # the same of its heading
# How far the wake carries hooks beyond the glideslope's end, m per m/s of wind over the deck: of 1,020 landings.
CARRIED_S = 0.28
# Wires of a ship that has none in its class, beyond the beginning of the lines, m; 12.4 m apart as on a large carrier.
WIRES_M = (52.0, 64.4, 76.8)
MOTION, DATALINK = 61, 66  # random streams


@dataclass(frozen=True, eq=False)
class Surroundings:
    """One landing's ship, camera and knowledge, all random choices made."""

    config: LandingConfig
    seed: int
    """Of the landing."""
    deck: Deck
    """The ship under way."""
    wind_m_s: NDArray[np.float64]
    """(3,) over the water, world, m/s."""
    run: RunConfig
    """What the aircraft knows of its sensors, the deck and the approach."""
    navigation: NavigationConfig
    """The errors of the navigation unit."""
    camera: Camera
    """True intrinsics."""
    body_from_camera: RigidTransform
    """The camera's mount."""


def surroundings(config: LandingConfig, seed: int) -> Surroundings:
    """The surroundings of the landing of a seed."""
    ship = load_class(config.ship)
    layout, motion = class_layout(ship), ship_motion(config, seed)
    wires = ship.plan.wires_m or WIRES_M
    run = run_config(config, layout, motion, aim_m(wires, over_deck_m_s(config)))
    deck = Deck(layout, motion, run.approach.touchdown_m, wires)
    sensors = GRADES[config.navigation]
    camera = Camera.from_fov(config.camera.width, config.camera.height, np.deg2rad(config.camera.fov_deg))
    mount = camera_mount(mount=Rotation.from_euler("y", -MOUNT_DOWN_DEG, degrees=True))
    wind = steady_wind(deck.landing_direction, config.wind_m_s, config.wind_from_deg)
    return Surroundings(config, seed, deck, wind, run, navigation_unit(sensors), camera, mount)


def ship_motion(config: LandingConfig, seed: int) -> ShipMotion:
    """How the ship of a landing moves; its phases follow from the seed."""
    rng = np.random.default_rng([seed, MOTION])
    motion = draw_motion(MotionConfig(config.sea_state, config.ship_speed_m_s), False, rng)
    return replace(motion, period_factor=config.deck_period_factor)


def over_deck_m_s(config: LandingConfig) -> float:
    """Wind over the deck along the landing area, m/s; its angle to the ship, some degrees, changes that by 1 %."""
    return config.ship_speed_m_s + config.wind_m_s * float(np.cos(np.deg2rad(config.wind_from_deg)))


def aim_m(wires_m: tuple[float, ...], over_deck_m_s: float) -> float:
    """Where the glideslope meets the deck, m beyond the ramp.

    Hooks then come down before the last wire but one, in the middle to the next: the wake's upwash carries them on.

    Args:
        wires_m: beyond the ramp.
        over_deck_m_s: wind over the deck.
    """
    return float(np.mean(wires_m[-3:-1])) - CARRIED_S * over_deck_m_s


def run_config(config: LandingConfig, layout: Layout, motion: ShipMotion, touchdown_m: float) -> RunConfig:
    """What the aircraft knows: its sensors' accuracy, the sea state, the runway's width and the ship's velocity."""
    along, left, right = (line[1] - line[0] for line in (layout.centre_m, layout.left_m, layout.right_m))
    across = layout.right_m[0] - layout.left_m[0]
    width_m = float(across @ [-along[1], along[0]] / np.hypot(*along))
    angle = np.arctan2(right[1], right[0]) - np.arctan2(left[1], left[0])
    north, east, _ = steady_velocity(layout, motion)
    has_datalink = config.guidance != "picture"
    deck = KnownDeck(
        config.sea_state,
        width_m=width_m,
        angle_deg=float(np.rad2deg(angle)),
        ship_velocity_m_s=(float(north), float(east)) if has_datalink else None,
    )
    approach = Approach(touchdown_m=touchdown_m, point_m=AIRCRAFT_TYPES[config.aircraft].hook_m)
    return RunConfig(
        GRADES[config.navigation],
        deck,
        approach=approach,
        models=config.models,
        tracking=config.tracking,
        integrity=Integrity(max_width_fraction=MAX_WIDTH_FRACTION),
    )


def datalink_prior(scene: Surroundings, flight: Flight, frame: Frame) -> RunwayPrior | None:
    """Where the ship's datalink has the runway at a frame's time; None with a track, or without a pose.

    It errs by what it states, in place and in heading about the ramp: one draw a landing.
    """
    if frame.world_from_body is None or flight.forecast() is not None:
        return None
    layout = scene.deck.layout
    layout = layout.at_pose(steady_pose(layout, scene.deck.motion, frame.time_s))
    lines = np.array([[line.p0_m, line.p1_m] for line in truth_segments(layout)])
    shift_m, turn = datalink_error(scene.seed)
    ramp = lines[:, 0].mean(axis=0)
    left, right = ramp + shift_m + np.array([turn.apply(line) for line in lines - ramp])
    return RunwayPrior(left, right, DATALINK_SIGMA_M, float(np.deg2rad(DATALINK_HEADING_SIGMA_DEG)))


def datalink_error(seed: int) -> tuple[NDArray[np.float64], Rotation]:
    """Errors of place (3,), m, and heading of the ship's datalink in the landing of a seed."""
    *place, heading = np.random.default_rng([seed, DATALINK]).standard_normal(4)
    return DATALINK_SIGMA_M * np.array(place), Rotation.from_euler("z", DATALINK_HEADING_SIGMA_DEG * heading, True)


def without_position(frame: Frame) -> Frame:
    """The frame of an aircraft that measures its roll and pitch alone: no position, no deck height, no datalink."""
    if frame.world_from_body is None:
        return frame
    return replace(
        frame, world_from_body=None, deck_z_m=None, sea_z_m=None, level_from_body=frame.world_from_body.rotation
    )


def measured_frame(scene: Surroundings, moment: Moment, image_rgb: NDArray[np.uint8]) -> Frame:
    """The frame of a moment whose picture nobody looks at, with the sensors' errors and the truth.

    Args:
        image_rgb: (H, W, 3) of the camera's size.
    """
    layout = scene.deck.moved_layout(moment.time_s)
    truth = Truth(
        *truth_segments(layout), visibility_m=scene.config.visibility_m, world_from_body=moment.world_from_body
    )
    frame = Frame(
        frame_name(scene.seed, moment.time_s),
        moment.time_s,
        image_rgb,
        scene.camera,
        scene.body_from_camera,
        world_from_body=measure_pose(moment.world_from_body, moment.time_s, scene.navigation, scene.seed),
        deck_z_m=float(scene.deck.layout.world_from_ship.translation[2]),
        sea_z_m=float(scene.deck.layout.sea_z_m),
        truth=truth,
    )
    frame = miscalibrate(frame, scene.run.sensors, scene.seed)
    return without_position(frame) if scene.config.guidance == "picture" else frame


def frame_name(seed: int, time_s: float) -> str:
    """Name of the picture that a landing takes at a time."""
    return f"landing_{seed}_{round(time_s * 1e6):09d}.png"


def empty_picture(camera: Camera) -> NDArray[np.uint8]:
    """A black picture (H, W, 3) of the camera's size that takes three bytes of memory."""
    return np.broadcast_to(np.zeros(3, np.uint8), (camera.height, camera.width, 3))
