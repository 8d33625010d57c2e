"""What the tracker assumes. Every number has its unit in its name."""

from dataclasses import dataclass, field, replace

import numpy as np

# Deck motion of sea states 4, 5 and 6, amplitudes of single sines: pitch, rad, heave, m; SPEC section 7.
SEA_STATES = (0.0, 4.0, 5.0, 6.0)
PITCH_RAD = np.deg2rad([0.0, 0.52, 0.82, 1.24])
HEAVE_M = (0.0, 0.68, 1.09, 1.63)
PITCH_S, HEAVE_S = 12.0, 18.0  # periods; SPEC section 7
RAMP_ARM_M = 166.0  # from the middle of the ship, about which it pitches, to the ramp: half of 332.85 m, SPEC section 7
CALM_M_S15 = 0.05  # of a deck that hardly moves


def deck_sway(sea_state: float) -> tuple[float, float, float]:
    """How the deck near the ramp moves: rms height, m; rms tilt, rad; spectral height of its acceleration, m/s^1.5.

    An acceleration of rms a that keeps its sign for about a quarter of the pitch's period T drives the rate like
    white noise of density a sqrt(T / 2).
    """
    pitch, heave = (float(np.interp(sea_state, SEA_STATES, table)) for table in (PITCH_RAD, HEAVE_M))
    ramp = pitch * RAMP_ARM_M
    height = np.hypot(ramp, heave) / np.sqrt(2)
    pitching, heaving = ramp * (2 * np.pi / PITCH_S) ** 2, heave * (2 * np.pi / HEAVE_S) ** 2
    acceleration = np.hypot(pitching, heaving) / np.sqrt(2)
    return float(height), pitch / np.sqrt(2), float(acceleration * np.sqrt(PITCH_S / 2))


@dataclass(frozen=True)
class MotionConfig:
    """How lines, deck and pose may move between frames; random walks, in units per square root of a second.

    The defaults follow a deck in sea state 5; `at_sea_state` gives others.

    Args:
        ship_velocity_m_s: of the ship in the world (north, east), where it is known.
        drift_m_s: 1-sigma of the lines' unknown sideways speed. 2 covers 25 knots along a ship whose lines are angled.
        drift_m_s15: how fast that speed changes.
        heave_m_s15: how fast the deck's vertical speed changes.
        heave_m_s: 1-sigma of the deck's vertical speed at first.
        turn_rad_s05: how fast the lines turn: the ship's yaw.
        tilt_rad: 1-sigma of the deck's slope along the lines; the deck's height is known where points were seen.
        spacing_m_s05: lets a spacing that was learned wrongly be unlearned.
    """

    ship_velocity_m_s: tuple[float, float] | None = None
    drift_m_s: float = 2.0
    drift_m_s15: float = 0.05
    heave_m_s15: float = deck_sway(5.0)[2]
    heave_m_s: float = 1.0
    turn_rad_s05: float = float(np.deg2rad(0.02))
    tilt_rad: float = float(np.deg2rad(0.05))
    spacing_m_s05: float = 0.005

    def __post_init__(self) -> None:
        numbers = [value for value in vars(self).values() if isinstance(value, float)]
        if min(numbers) < 0 or not self.heave_m_s > 0 or not self.drift_m_s > 0:
            raise ValueError(f"motion must not be negative, heave_m_s and drift_m_s must be positive, got {self}")


@dataclass(frozen=True)
class ErrorConfig:
    """1-sigma of what frames have in common; more frames do not average it. The defaults are those of localization.

    Args:
        attitude_rad: of the camera's attitude about each axis, mounting included.
        position_m: of the pose along each axis.
        attitude_white_rad, position_white_m: the part of these that is new in every frame.
        drift_s: time constant with which the rest of them changes.
        deck_z_m: of the deck height that the ship reports.
        deck_z_s: time constant with which that error changes; infinite for a deck that lies still.
        depth_scale: of all depths, as a share.
        delay_s: of the pose against the picture.
        line_m: of a line that the detector sets beside its middle, all the time.
    """

    attitude_rad: float = float(np.deg2rad(0.1))
    position_m: float = 0.1
    attitude_white_rad: float = float(np.deg2rad(0.02))
    position_white_m: float = 0.05
    drift_s: float = 60.0
    deck_z_m: float = 0.1
    deck_z_s: float = float("inf")
    depth_scale: float = 0.005
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
        depth_scale: the same of all depths.
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
        noise_correlation_s: how long a detector errs in the same way; 0: every frame errs for itself.
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
        height, tilt, push = deck_sway(sea_state)
        motion = replace(
            self.motion, heave_m_s15=max(push, CALM_M_S15), tilt_rad=float(np.hypot(self.motion.tilt_rad, tilt))
        )
        deck_s = PITCH_S / 4 if height > 0 else self.errors.deck_z_s
        errors = replace(self.errors, deck_z_m=float(np.hypot(self.errors.deck_z_m, height)), deck_z_s=deck_s)
        return replace(self, motion=motion, errors=errors)
