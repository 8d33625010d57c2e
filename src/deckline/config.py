"""One configuration: what is known of sensors, deck and approach, and which models run.

Each quantity exists once, here, and is passed on to fit, tracker, integrity, guidance, simulator and evaluations.
A TOML file may hold everything in a `RunConfig`; angles are degrees there, as people read them. A number out of
range raises a `ValueError` that names field and value.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from deckline.checks import check_choice, check_numbers

Grade = Literal["standard", "good", "tactical", "exact"]
Mode = Literal["auto", "fine", "coarse"]
Picture = Literal["hazy", "dehazed"]
Device = Literal["cpu", "openvino", "cuda", "tensorrt"]
Precision = Literal["f32", "bf16"]

# Deck motion of a large carrier at sea states 4, 5 and 6, amplitudes of single sines: public figures, as the simulator.
SEA_STATES = (0.0, 4.0, 5.0, 6.0)
ROLL_DEG = (0.0, 0.62, 0.98, 1.44)
PITCH_DEG = (0.0, 0.52, 0.82, 1.24)
HEAVE_M = (0.0, 0.68, 1.09, 1.63)
PITCH_ARM_M = 130.0  # from the pitch axis amidships to the visible lines: 166 m to the ramp, 96 m to the touchdown
CALM_HEAVE_M = 0.02  # 1-sigma of what still moves a deck in a calm sea, as height
CALM_SLOPE_DEG = 0.05  # and as slope
USUAL_WIDTH_M = 20.0  # of a runway whose width is not stated: between 14.7 m (Li et al. 2024) and 24 m (carriers)
WIDEST_USUAL_M = 24.0  # the same for a box that must hold it


@dataclass(frozen=True)
class Sensors:
    """1-sigma of what the aircraft and the ship measure.

    The defaults, grade `standard`, assume a small aircraft with satellite-aided inertial navigation and a calibrated
    camera. Protection levels rest on these numbers: state your own.

    Args:
        position_m: of the pose's position along each axis, m.
        position_white_m: the part of it that is new in every frame, m; the rest drifts.
        attitude_deg: of the pose's attitude about each axis, camera mounting included, degrees.
        attitude_white_deg: the part of it that is new in every frame, degrees.
        drift_s: time constant of the drift, s.
        deck_z_m: of the deck height that the ship reports, on a calm sea, m.
        focal_fraction: of the focal length, as a share.
        depth_fraction: of each depth sample, independent of its neighbours, as a share.
        depth_scale: of all depth samples together, as a share.
        delay_s: of the pose's time against the picture's, s.
        line_bias_m: constant lateral bias of a detected line, m.
    """

    position_m: float = 0.1
    position_white_m: float = 0.05
    attitude_deg: float = 0.1
    attitude_white_deg: float = 0.02
    drift_s: float = 60.0
    deck_z_m: float = 0.1
    focal_fraction: float = 0.001
    depth_fraction: float = 0.01
    depth_scale: float = 0.005
    delay_s: float = 0.02
    line_bias_m: float = 0.05

    def __post_init__(self) -> None:
        check_numbers(self, "sensors", least=0.0)
        check_numbers(self, "sensors", "drift_s", above=0.0)
        for name in ("position_m", "attitude_deg"):
            whole, white = getattr(self, name), getattr(self, name.replace("_", "_white_"))
            if white > whole:
                raise ValueError(f"sensors.{name} includes its white part of {white}, so must not be less, got {whole}")

    @property
    def attitude_rad(self) -> float:
        return float(np.deg2rad(self.attitude_deg))

    @property
    def attitude_white_rad(self) -> float:
        return float(np.deg2rad(self.attitude_white_deg))

    @property
    def position_drift_m(self) -> float:
        return float(np.sqrt(self.position_m**2 - self.position_white_m**2))

    @property
    def attitude_drift_deg(self) -> float:
        return float(np.sqrt(self.attitude_deg**2 - self.attitude_white_deg**2))

    def with_floor(self, angle_rad: float, length_m: float, share: float) -> "Sensors":
        """The same sensors, none of them better than these 1-sigmas: an estimator cannot divide by nothing."""
        floors = {"attitude": float(np.rad2deg(angle_rad)), "position": length_m, "deck": length_m}
        floors |= {"focal": share, "depth": share, "delay": length_m, "line": length_m}
        values = {name: max(value, floors.get(name.split("_")[0], 0.0)) for name, value in vars(self).items()}
        return replace(self, **values)


# Position and attitude: the total, which is that of drift and white noise, then the white noise.
GRADES: dict[Grade, Sensors] = {
    "standard": Sensors(),
    # Position aided by satellite carrier phase, a navigation-grade gyro.
    "good": Sensors(float(np.hypot(0.1, 0.02)), 0.02, float(np.hypot(0.02, 0.005)), 0.005),
    # Position aided by satellite code, a tactical-grade gyro.
    "tactical": Sensors(float(np.hypot(1.5, 0.1)), 0.1, float(np.hypot(0.1, 0.02)), 0.02),
    # All but the detector, whose `line_bias_m` stays.
    "exact": Sensors(0.0, 0.0, 0.0, 0.0, 60.0, 0.0, 0.0, 0.0, 0.0, 0.0),
}


def with_grade(sensors: Sensors, grade: Grade) -> Sensors:
    """The same with a grade's position and attitude; `exact` knows everything exactly but the lines."""
    known = GRADES[grade]
    if grade == "exact":
        return replace(known, line_bias_m=sensors.line_bias_m)
    names = ("position_m", "position_white_m", "attitude_deg", "attitude_white_deg")
    return replace(sensors, **{name: getattr(known, name) for name in names})


@dataclass(frozen=True)
class Deck:
    """What is known of the deck and its lines.

    Args:
        sea_state: 0 to 6: how much the deck moves about the rest that the ship reports; 0 for a runway on land.
        slope_deg: 1-sigma of the deck's slope that one frame allows, degrees; None: by the sea state.
        width_m: between the middles of both lines at the ramp, across the centre line, m; None: it is learned.
        width_sigma_m: 1-sigma of that, m.
        angle_deg: the right line's direction minus the left line's, degrees.
        angle_sigma_deg: 1-sigma of that; painted lines are not exactly parallel (Li et al. 2024: 0.37 degrees).
        ship_velocity_m_s: north, east of the ship in the world, m/s; None: not known.
    """

    sea_state: float = 4.0  # to trust a still deck too much misleads; to trust it too little costs some precision
    slope_deg: float | None = None
    width_m: float | None = None
    width_sigma_m: float = 0.1
    angle_deg: float = 0.0
    angle_sigma_deg: float = 0.3
    ship_velocity_m_s: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        check_numbers(self, "deck")
        check_numbers(self, "deck", "sea_state", least=0.0, most=SEA_STATES[-1])
        check_numbers(self, "deck", "slope_deg", least=0.0)
        check_numbers(self, "deck", "width_m", "width_sigma_m", "angle_sigma_deg", above=0.0)

    @cached_property
    def motion(self) -> "DeckMotion":
        """How the deck moves about its rest."""
        amplitudes = (np.deg2rad(ROLL_DEG), np.deg2rad(PITCH_DEG), HEAVE_M)
        roll, pitch, heave = (float(np.interp(self.sea_state, SEA_STATES, a) / np.sqrt(2)) for a in amplitudes)
        calm = float(np.deg2rad(CALM_SLOPE_DEG))
        rise = np.hypot(CALM_HEAVE_M, np.hypot(pitch * PITCH_ARM_M, heave))
        return DeckMotion(float(rise), float(np.hypot(calm, pitch)), float(np.hypot(calm, roll)))

    @property
    def expected_width_m(self) -> float:
        """The width as stated, else the usual one."""
        return self.width_m or USUAL_WIDTH_M

    @property
    def slope_rad(self) -> float:
        """1-sigma of the slope that one frame allows."""
        return self.motion.pitch_rad if self.slope_deg is None else float(np.deg2rad(self.slope_deg))

    @property
    def angle_rad(self) -> float:
        return float(np.deg2rad(self.angle_deg))

    @property
    def angle_sigma_rad(self) -> float:
        return float(np.deg2rad(self.angle_sigma_deg))


@dataclass(frozen=True)
class DeckMotion:
    """1-sigma of a deck's motion about its rest, at the touchdown point."""

    heave_m: float  # of its height
    pitch_rad: float  # of its slope along the lines
    roll_rad: float  # of its slope across them


@dataclass(frozen=True)
class Approach:
    """The wanted approach.

    Args:
        glideslope_deg: above the deck; 3.5 is usual, 3.75 to 4 in strong wind.
        touchdown_m: aim point beyond the ramp, along the centre line, m; 230 ft.
        point_m: the point of the aircraft that all deviations are of (its hook, its wheels, the pilot's eye), forward,
            right, down of the body origin, m.
    """

    glideslope_deg: float = 3.5
    touchdown_m: float = 70.0
    point_m: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        check_numbers(self, "approach")
        check_numbers(self, "approach", "glideslope_deg", above=0.0, most=45.0)
        check_numbers(self, "approach", "touchdown_m", least=0.0)

    @property
    def slope(self) -> float:
        """Height per distance of the glideslope."""
        return float(np.tan(np.deg2rad(self.glideslope_deg)))


@dataclass(frozen=True)
class RunwaySurvey:
    """A runway whose place in the world is known beforehand: the prior of the search. Without a ramp there is none.

    The place is fixed: of a ship under way it is soon wrong, and the search finds nothing there.

    Args:
        ramp_m: (3,) world, middle between both lines' near ends, m.
        heading_deg: direction of landing, from world x (north) towards world y (east), degrees.
        width_m: of the part that is searched, m; None: `Deck.width_m`, 24 where that is not stated. Nothing is measured
            by it.
        length_m: of the lines, m.
        sigma_m: 1-sigma of the runway's place as the aircraft sees it, its own position error included, m.
        heading_sigma_deg: 1-sigma of its direction as the aircraft sees it, its own heading error included, degrees.
    """

    ramp_m: tuple[float, float, float] | None = None
    heading_deg: float = 0.0
    width_m: float | None = None
    length_m: float = 240.0
    sigma_m: float = 20.0
    heading_sigma_deg: float = 2.0

    def __post_init__(self) -> None:
        check_numbers(self, "survey")
        check_numbers(self, "survey", "width_m", "length_m", above=0.0)
        check_numbers(self, "survey", "sigma_m", "heading_sigma_deg", least=0.0)


@dataclass(frozen=True)
class Models:
    """Which dehazer and detector run; a name of the shipped ones or the path of an ONNX file.

    Args:
        dehazer: of the pictures for people.
        strength: of the dehazing, 0 (the picture as it is) to 1.
        detector: of the lines.
        detect_in: the picture that the detector sees. `dehazed` is the published chain; the shipped detector was
            trained on haze and finds more in the hazy picture.
        join_frames: pictures of a flight averaged for a second view where one alone is not sure; 1: no such view.
        camera_height_m: above the water, of pictures without a pose or a height; with it their visibility is in metres.
        visibility: measure the visibility of every frame for its record; the chain then dehazes each frame, at 640 px.
    """

    dehazer: str = "coarse-t"
    detector: str = "hybrid"
    detect_in: Picture = "hazy"
    join_frames: int = 8
    strength: float = 1.0
    camera_height_m: float | None = None
    visibility: bool = False

    def __post_init__(self) -> None:
        check_choice("models.detect_in", self.detect_in, Picture)
        check_numbers(self, "models", "camera_height_m", above=0.0)
        check_numbers(self, "models", "strength", least=0.0, most=1.0)
        check_numbers(self, "models", "join_frames", least=1)


@dataclass(frozen=True)
class Engine:
    """What computes the networks. Nothing here is chosen by the machine, so that answers do not depend on it silently.

    Args:
        device: `cpu`: ONNX Runtime; `openvino`: OpenVINO on the processor; `cuda`, `tensorrt`: ONNX Runtime on a GPU.
        threads: of the processor; None: one for every core that this process may use.
        precision: of the arithmetic. `bf16` needs OpenVINO and a processor that has it; it is refused on another.
    """

    device: Device = "cpu"
    threads: int | None = None
    precision: Precision = "f32"

    def __post_init__(self) -> None:
        check_choice("engine.device", self.device, Device)
        check_choice("engine.precision", self.precision, Precision)
        check_numbers(self, "engine", "threads", least=1)
        if self.precision == "bf16" and self.device != "openvino":
            raise ValueError(f"engine.precision bf16 needs device openvino, got {self.device}")


CPU = Engine()


@dataclass(frozen=True)
class Localization:
    """How one frame's points become lines in the world.

    Args:
        mode: `fine` demands the depth camera, `coarse` the deck plane. `auto` uses both and calls the frame fine when
            most points have a depth.
    """

    mode: Mode = "auto"

    def __post_init__(self) -> None:
        check_choice("localization.mode", self.mode, Mode)


@dataclass(frozen=True)
class Tracking:
    """The filter over frames.

    Args:
        enabled: frames are one flight in their order; else every frame is for itself.
        coast_s: time without a line that the track survives, s.
        reacquire_s: time of contradicting lines after which the track begins again, s.
        gate_sigma: standard deviations beyond which a measurement is left out.
        search_s: while the track is sure, its place is viewed, and so often a whole picture is searched beside it,
            over the frames, s; 0: every picture is searched whole at once.
        first_at_once: the first picture, and one after a gap longer than `search_s`, is searched whole at once. In live
            flight it is not: its answer would be late.
        horizon_s: so often the horizon in the picture is compared with the attitude, s; 0: never.
        paint_s: so often the picture is searched for paint under the lines and for a centre line, s; 0: never.
    """

    enabled: bool = True
    coast_s: float = 2.0
    reacquire_s: float = 1.0
    gate_sigma: float = 5.0
    search_s: float = 1.0
    first_at_once: bool = True
    horizon_s: float = 1.0
    paint_s: float = 0.5

    def __post_init__(self) -> None:
        check_numbers(self, "tracking", "search_s", "horizon_s", "paint_s", least=0.0)
        check_numbers(self, "tracking", "coast_s", "reacquire_s", "gate_sigma", above=0.0)


@dataclass(frozen=True)
class PicturePose:
    """What is known of an aircraft whose pose the picture alone gives.

    Args:
        roll_sigma_deg: 1-sigma of its roll about level flight, where no horizon shows it, degrees.
    """

    roll_sigma_deg: float = 5.0

    def __post_init__(self) -> None:
        check_numbers(self, "picture", above=0.0, most=45.0)

    @property
    def roll_sigma_rad(self) -> float:
        return float(np.deg2rad(self.roll_sigma_deg))


@dataclass(frozen=True)
class Navigation:
    """How poses of a clock and a rate of their own are placed on pictures.

    Args:
        max_gap_s: between two poses, beyond which pictures in between have no pose, s.
        origin: latitude, longitude, degrees, and altitude, m, of the world's origin (North-East-Down), for poses that
            have these; None: their first position.
        offset_s: the poses' clock minus the pictures' clock, s; None: 0, or by the frame numbers of poses.csv.
    """

    max_gap_s: float = 0.5
    offset_s: float | None = None
    origin: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        check_numbers(self, "navigation")
        check_numbers(self, "navigation", "max_gap_s", above=0.0)
        if self.origin is not None and (abs(self.origin[0]) > 90.0 or abs(self.origin[1]) > 180.0):
            raise ValueError(f"navigation.origin is latitude, longitude, degrees, altitude, m; got {self.origin}")


@dataclass(frozen=True)
class Integrity:
    """When something is flagged, and what a protection level covers.

    Args:
        risk: that an error without a flag exceeds its protection level, per frame and direction.
        alarm_sigma: standard deviations of a test statistic from which there is a flag.
        missed_sigma: standard deviations more that a fault needs to be noticed for sure; 3.3: 1 in 2000 is missed.
        doubt_risk: significance of the global test of all estimated sensor errors, below which guidance is not `ok`.
        persist_s: a measurement that is left out for so long is a flag, s.
        window_s: over which residuals are judged, s.
        excess: mean squared normalised residual from which there is a flag.
        max_boresight_deg: the largest mounting error of the camera that is thought possible, about each axis, degrees.
        max_deck_z_m: the same of the reported deck height, m. 20: a carrier's deck that was stated as the sea's.
        max_depth_scale: the same of all depths, as a share.
        max_focal_fraction: the same of the focal length, as a share.
        max_delay_s: the same of a pose behind its picture, s.
        max_drift_m_s: the largest sideways speed of the lines that a ship is thought to have, m/s; 3.5: 30 knots along
            a ship whose lines are turned by 13 degrees.
        max_ship_m_s: the largest speed of a ship whose velocity is not stated, m/s; 15.4: 30 knots.
        max_yaw_deg: the largest yaw of a turned camera that a heading's protection level may cover, degrees. Where a
            larger one would not show, the heading has no level.
        mount_yaw_deg: the largest yaw that the mounting can have, as its builder states; None: the drift of the lines
            alone bounds it, and a hovering aircraft shows none.
        max_width_fraction: the largest possible error of the stated width, as a share of it; 4: a fifth is stated.
        max_line_m: the same of a line: another marking beside it, m. Foul lines lie up to 6 m outside the edge lines.
    """

    risk: float = 1e-7
    alarm_sigma: float = 5.0
    missed_sigma: float = 3.3
    doubt_risk: float = 1e-3
    persist_s: float = 0.4
    window_s: float = 1.5
    excess: float = 4.0
    max_boresight_deg: float = 1.0
    max_deck_z_m: float = 20.0
    max_depth_scale: float = 0.03
    max_focal_fraction: float = 0.005
    max_delay_s: float = 0.2
    max_drift_m_s: float = 3.5
    max_ship_m_s: float = 15.4
    max_yaw_deg: float = 10.0
    mount_yaw_deg: float | None = None
    max_width_fraction: float = 4.0
    max_line_m: float = 6.0

    def __post_init__(self) -> None:
        check_numbers(self, "integrity", above=0.0)
        check_numbers(self, "integrity", "risk", "doubt_risk", below=1.0)


@dataclass(frozen=True)
class RunConfig:
    """Everything that decides what a flight answers.

    Args:
        sensors: how good navigation, calibration and depth are.
        deck: what is known of deck and lines.
        approach: the wanted approach.
        survey: where the runway is, if that is known.
        models: dehazer and detector.
        engine: what computes their networks.
        localization: its depth mode.
        tracking: the filter over frames.
        integrity: flags and protection levels.
        navigation: how poses are placed on pictures.
        picture: of an aircraft without a pose.
        seed: of RANSAC's draws; every frame has its own generator.
    """

    sensors: Sensors = field(default_factory=Sensors)
    deck: Deck = field(default_factory=Deck)
    approach: Approach = field(default_factory=Approach)
    survey: RunwaySurvey = field(default_factory=RunwaySurvey)
    models: Models = field(default_factory=Models)
    engine: Engine = CPU
    localization: Localization = field(default_factory=Localization)
    tracking: Tracking = field(default_factory=Tracking)
    integrity: Integrity = field(default_factory=Integrity)
    navigation: Navigation = field(default_factory=Navigation)
    picture: PicturePose = field(default_factory=PicturePose)
    seed: int = 0

    @cached_property
    def noise(self) -> "FrameNoise":
        """What one frame's measurements err by."""
        sensors = self.sensors
        return FrameNoise(
            attitude_rad=sensors.attitude_rad,
            position_m=sensors.position_m,
            deck_z_m=self.deck_height_sigma_m,
            slope_rad=self.deck.slope_rad,
            focal_fraction=sensors.focal_fraction,
            depth_fraction=sensors.depth_fraction,
            depth_scale=sensors.depth_scale,
        )

    @cached_property
    def frame_deck(self) -> Deck:
        """The deck as one frame's fit knows it: a tracker tests a stated width against the lines, fitted without it."""
        return replace(self.deck, width_m=None) if self.tracking.enabled else self.deck

    @cached_property
    def deck_rest_sigma_m(self) -> float:
        """1-sigma of the reported deck height against the deck at rest."""
        reported = self.sensors.deck_z_m
        return float(np.sqrt(reported**2 - CALM_HEAVE_M**2)) if reported > CALM_HEAVE_M else reported

    @cached_property
    def deck_height_sigma_m(self) -> float:
        """1-sigma of the reported deck height against the deck as one frame sees it, its motion included."""
        return float(np.hypot(self.deck_rest_sigma_m, self.deck.motion.heave_m))


@dataclass(frozen=True)
class FrameNoise:
    """1-sigma of one frame's measurements. All but `depth_fraction` is common to all of its points."""

    attitude_rad: float  # about each axis
    position_m: float  # along each axis
    deck_z_m: float  # of the reported deck height, the deck's motion included
    slope_rad: float  # of the deck, along and across the runway
    focal_fraction: float  # share
    depth_fraction: float  # of each depth sample alone, share
    depth_scale: float  # of all depth samples together, share
