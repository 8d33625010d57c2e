"""How accurate navigation, calibration and depth are, and how poses are placed on pictures."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from deckline.checks import check_numbers

Grade = Literal["standard", "good", "tactical", "exact"]


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
