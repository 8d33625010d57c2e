"""What the tracker assumes. Every number has its unit in its name."""

from dataclasses import dataclass, field, replace

import numpy as np

# Deck motion of sea states 4, 5 and 6, amplitudes of single sines: roll, pitch, rad, heave, m; SPEC section 7.
SEA_STATES = (0.0, 4.0, 5.0, 6.0)
ROLL_RAD = np.deg2rad([0.0, 0.62, 0.98, 1.44])
PITCH_RAD = np.deg2rad([0.0, 0.52, 0.82, 1.24])
HEAVE_M = (0.0, 0.68, 1.09, 1.63)
ARM_M = 130.0  # from the middle of the ship, about which it pitches, to what is seen of its lines: 166 m to the ramp of
# 332.85 m of ship, 96 m to where aircraft touch down; SPEC section 7


@dataclass(frozen=True)
class Sway:
    """1-sigma of a deck's motion about its rest, where aircraft touch down."""

    rise_m: float
    tilt_rad: float  # along the lines
    bank_rad: float


def deck_sway(sea_state: float) -> Sway:
    """How the deck of a large carrier moves."""
    tables = (ROLL_RAD, PITCH_RAD, HEAVE_M)
    roll, pitch, heave = (float(np.interp(sea_state, SEA_STATES, table) / np.sqrt(2)) for table in tables)
    return Sway(float(np.hypot(pitch * ARM_M, heave)), pitch, roll)


@dataclass(frozen=True)
class MotionConfig:
    """How lines, deck and pose may move between frames.

    The defaults are for a deck that hardly moves; `TrackConfig.at_sea_state` gives others.

    Args:
        ship_velocity_m_s: of the ship in the world (north, east), where it is known.
        drift_m_s: 1-sigma of the lines' unknown sideways speed. 2 covers 25 knots along a ship whose lines are angled.
        drift_m_s15: how fast that speed changes.
        rise_m: 1-sigma of the deck's height about its height at rest.
        tilt_rad, bank_rad: 1-sigma of the deck's slope along the lines and across.
        turn_rad_s05: how fast the lines turn, as a random walk: the ship's yaw.
        spacing_m_s05: lets a spacing that was learned wrongly be unlearned.
    """

    ship_velocity_m_s: tuple[float, float] | None = None
    drift_m_s: float = 2.0
    drift_m_s15: float = 0.05
    rise_m: float = 0.02
    tilt_rad: float = float(np.deg2rad(0.05))
    bank_rad: float = float(np.deg2rad(0.05))
    turn_rad_s05: float = float(np.deg2rad(0.02))
    spacing_m_s05: float = 0.005

    def __post_init__(self) -> None:
        numbers = [value for value in vars(self).values() if isinstance(value, float)]
        if min(numbers) < 0 or not self.drift_m_s > 0:
            raise ValueError(f"motion must not be negative and drift_m_s must be positive, got {self}")


@dataclass(frozen=True)
class ErrorConfig:
    """1-sigma of what frames have in common; more frames do not average it. The defaults are those of localization.

    Args:
        attitude_rad: of the camera's attitude about each axis, mounting included.
        position_m: of the pose along each axis.
        attitude_white_rad, position_white_m: the part of these that is new in every frame.
        drift_s: time constant with which the rest of them changes.
        deck_z_m: of the deck height that the ship reports, with what `MotionConfig.rise_m` says of the deck's motion.
        depth_scale, focal_fraction: of all depths and of the focal length, as a share.
        delay_s: of the pose against the picture.
        line_m: of a line that the detector sets beside its middle, all the time.
    """

    attitude_rad: float = float(np.deg2rad(0.1))
    position_m: float = 0.1
    attitude_white_rad: float = float(np.deg2rad(0.02))
    position_white_m: float = 0.05
    drift_s: float = 60.0
    deck_z_m: float = 0.1
    depth_scale: float = 0.005
    focal_fraction: float = 0.001
    delay_s: float = 0.02
    line_m: float = 0.05

    def __post_init__(self) -> None:
        if min(vars(self).values()) <= 0:
            raise ValueError(f"errors and time constants must be positive, got {self}")


@dataclass(frozen=True)
class IntegrityConfig:
    """When something is called wrong, and what a protection level covers.

    Args:
        risk: that an error without a flag is beyond its protection level, per frame and direction.
        alarm: standard deviations of a test from which there is a flag.
        missed: standard deviations more that a fault needs to be noticed for sure; 3.3: 1 in 2000 is missed.
        lasting_s: a measurement that was left out for so long is a flag.
        window_s: over which residuals are judged.
        excess: mean squared residual, of the expected one, from which there is a flag.
        boresight_rad: the largest error of the camera's mounting that is thought possible, about each axis.
        deck_z_m: the same of the reported deck height.
        depth_scale, focal_fraction: the same of all depths and of the focal length.
        delay_s: the same of a pose behind its picture.
        line_m: the same of a line: another marking beside it. The simulator's foul lines lie up to 6 m outside.
    """

    risk: float = 1e-7
    alarm: float = 5.0
    missed: float = 3.3
    lasting_s: float = 0.4
    window_s: float = 1.5
    excess: float = 4.0
    boresight_rad: float = float(np.deg2rad(1.0))
    deck_z_m: float = 3.0
    depth_scale: float = 0.03
    focal_fraction: float = 0.005
    delay_s: float = 0.2
    line_m: float = 6.0

    def __post_init__(self) -> None:
        if min(vars(self).values()) <= 0 or self.risk >= 1:
            raise ValueError(f"risk must lie between 0 and 1 and the others must be positive, got {self}")


@dataclass(frozen=True)
class TrackConfig:
    """The tracker.

    Args:
        runway_width_m: spacing of the lines' middles at the ramp where it is known; else it is learned.
        runway_width_sigma_m: 1-sigma of that.
        angle_rad: the right line's direction minus the left line's where it is known.
        angle_sigma_rad: 1-sigma of that; painted lines are not exactly parallel (the paper's: 0.37 degrees).
        coast_s: so long without a line the track lives on.
        reacquire_s: when what is seen contradicts the track for so long, the track begins anew.
        noise_correlation_s: how long a detector errs in the same way; 0: every frame errs for itself. The shipped
            detector's errors last for 0.1 to 0.4 s, but it states more of them than there are: its innovations are
            0.16 of what is expected on a rendered approach (paper, 900 m, seed 8001), so that more would be too much.
        gate: standard deviations beyond which a measurement is left out.
        touchdown_m: where the height has to be right, beyond the ramp; 230 ft, SPEC section 7.

    Raises:
        ValueError: a number out of range.
    """

    runway_width_m: float | None = None
    runway_width_sigma_m: float = 0.1
    angle_rad: float = 0.0
    angle_sigma_rad: float = float(np.deg2rad(0.3))
    coast_s: float = 2.0
    reacquire_s: float = 1.0
    noise_correlation_s: float = 0.0
    gate: float = 5.0
    touchdown_m: float = 70.0
    motion: MotionConfig = field(default_factory=MotionConfig)
    errors: ErrorConfig = field(default_factory=ErrorConfig)
    integrity: IntegrityConfig = field(default_factory=IntegrityConfig)

    def __post_init__(self) -> None:
        positive = (self.runway_width_sigma_m, self.angle_sigma_rad, self.coast_s, self.reacquire_s, self.gate)
        if min(positive) <= 0 or self.noise_correlation_s < 0:
            raise ValueError(f"sigmas, times and the gate must be positive, got {self}")
        if self.runway_width_m is not None and not self.runway_width_m > 0:
            raise ValueError(f"runway_width_m must be positive, got {self.runway_width_m}")

    def at_sea_state(self, sea_state: float) -> "TrackConfig":
        """The same tracker on a deck that moves as in this sea state, 0 to 6, of which the ship reports only the mean.

        Raises:
            ValueError: a sea state out of range.
        """
        if not 0 <= sea_state <= SEA_STATES[-1]:
            raise ValueError(f"sea_state must lie between 0 and {SEA_STATES[-1]:g}, got {sea_state}")
        sway, still = deck_sway(sea_state), MotionConfig()
        motion = replace(
            self.motion,
            rise_m=float(np.hypot(still.rise_m, sway.rise_m)),
            tilt_rad=float(np.hypot(still.tilt_rad, sway.tilt_rad)),
            bank_rad=float(np.hypot(still.bank_rad, sway.bank_rad)),
        )
        reported = float(np.hypot(self.rest_z_m, motion.rise_m))
        return replace(self, motion=motion, errors=replace(self.errors, deck_z_m=reported))

    @property
    def rest_z_m(self) -> float:
        """1-sigma of the reported deck height against the deck at rest."""
        total, rise = self.errors.deck_z_m, self.motion.rise_m
        return float(np.sqrt(total**2 - rise**2)) if total > rise else total
