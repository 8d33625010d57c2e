"""What localization assumes. Every number has its unit in its name."""

from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np

from deckline.localize.spread import MAX_CORRELATION

Mode = Literal["auto", "fine", "coarse"]
Method = Literal["joint", "paper"]


@dataclass(frozen=True)
class RansacConfig:
    """RANSAC of one line in the image.

    Args:
        sample_size: points drawn for one hypothesis.
        draws: hypotheses per round; rounds go on until one brings no lower error.
        max_rounds: rounds at most.
        threshold_px: a point this close to a line belongs to it; points that are themselves unsure by more than a
            third of it are given three times their 1-sigma, at most four times the threshold.
        min_inliers: fewer points make no line.
        min_inlier_share: nor does a smaller share of the detected points.
        min_length_px: nor do inliers on a shorter stretch.

    Raises:
        ValueError: a number that leaves nothing to draw or to keep.
    """

    sample_size: int = 2
    draws: int = 60
    max_rounds: int = 8
    threshold_px: float = 4.0
    min_inliers: int = 6
    min_inlier_share: float = 0.5
    min_length_px: float = 4.0

    def __post_init__(self) -> None:
        if self.sample_size < 2 or self.min_inliers < 3 or self.draws < 1 or self.max_rounds < 1:
            raise ValueError(
                "expected sample_size >= 2, min_inliers >= 3, draws >= 1 and max_rounds >= 1, got "
                f"{self.sample_size}, {self.min_inliers}, {self.draws} and {self.max_rounds}"
            )
        if not self.threshold_px > 0 or not 0 <= self.min_inlier_share <= 1 or self.min_length_px < 0:
            raise ValueError(
                "expected threshold_px > 0, min_inlier_share in 0..1 and min_length_px >= 0, got "
                f"{self.threshold_px}, {self.min_inlier_share} and {self.min_length_px}"
            )


@dataclass(frozen=True)
class NoiseConfig:
    """1-sigma of what is measured. Pose, deck and calibration errors are common to all points: more points do not
    average them.

    The defaults are assumptions for a small aircraft with satellite-aided inertial navigation and a calibrated camera;
    state your own.
    """

    depth_fraction: float = 0.01  # of a depth sample, independent from point to point
    attitude_rad: float = float(np.deg2rad(0.1))  # about each axis, camera mounting included
    position_m: float = 0.1  # along each axis
    deck_z_m: float = 0.1  # of the deck height that the ship reports; not used in fine mode
    focal_fraction: float = 0.001  # of the focal length
    depth_scale: float = 0.005  # of all depth samples together
    min_pixel: float = 0.1  # px, floor of a detected point's 1-sigma
    # Of neighbouring points' errors, before a frame shows its own, and how sure that is. The shipped detector's
    # residuals on rendered frames have 0.2 nearer than 100 m, -0.5 from 100 to 200 m, 0.4 to 0.7 beyond.
    point_correlation: float = 0.2
    point_correlation_sigma: float = 0.3

    def __post_init__(self) -> None:
        lengths = (self.position_m, self.deck_z_m)
        values = (self.depth_fraction, self.attitude_rad, *lengths, self.focal_fraction, self.depth_scale)
        if min(values) < 0 or not self.min_pixel > 0:
            raise ValueError(f"noise must not be negative and min_pixel must be positive, got {self}")
        if not abs(self.point_correlation) <= MAX_CORRELATION or not self.point_correlation_sigma >= 0:
            raise ValueError(
                f"expected point_correlation in -{MAX_CORRELATION}..{MAX_CORRELATION} and its 1-sigma >= 0, got "
                f"{self.point_correlation} and {self.point_correlation_sigma}"
            )


@dataclass(frozen=True)
class AgreementConfig:
    """What two lines must satisfy to be one runway."""

    min_spacing_m: float = 5.0
    max_spacing_m: float = 60.0
    max_angle_rad: float = float(np.deg2rad(4.0))  # between the lines, beside twice its own 1-sigma
    max_azimuth_sigma_rad: float = float(np.deg2rad(2.0))  # a line that is less sure of its direction is not a line
    clearly_better: float = 3.0  # of two contradicting lines, one is kept when its azimuth is this much surer
    # 1-sigma of the true angle between the lines: painted lines are not exactly parallel (the paper's: 0.37 degrees).
    parallel_rad: float = float(np.deg2rad(0.6))
    max_step_m: float = 10.0  # between the near ends of the lines along the runway, beside three times its 1-sigma
    max_centre_share: float = 0.15  # of the spacing, that a centre line may lie off the middle of two lines of a runway


@dataclass(frozen=True)
class DeckConfig:
    """What the joint method knows of the deck beforehand, beside `AgreementConfig.parallel_rad` and the width."""

    angle_rad: float = 0.0  # azimuth of the right line less that of the left; its 1-sigma is parallel_rad
    width_sigma_m: float = 0.3  # of runway_width_m
    tilt_rad: float = 0.0  # 1-sigma of the deck's slope along and across the runway; 0: known to be level
    centre_sigma_m: float = 0.1  # of a painted centre line's place midway between the edge lines
    centre_sigma_rad: float = float(np.deg2rad(0.05))  # and of its direction

    def __post_init__(self) -> None:
        sigmas = (self.width_sigma_m, self.tilt_rad, self.centre_sigma_m, self.centre_sigma_rad)
        if not np.isfinite(self.angle_rad) or not min(sigmas) >= 0:
            raise ValueError(f"deck knowledge needs a finite angle and 1-sigmas that are not negative, got {self}")


@dataclass(frozen=True)
class LocalizeConfig:
    """Localization of the runway lines.

    Args:
        method: `joint` fits all lines together in the image, by every measurement's noise; `paper` fits each line alone
            in the world by stochastic gradient descent.
        mode: `fine` wants the depth camera, `coarse` the deck plane. `auto`: the paper's method chooses one per frame,
            the joint one uses both, and names the frame fine when most points have a depth.
        min_points: points that a line needs a distance for.
        min_depth_share: `auto` prefers coarse when fewer of a line's inliers than this have a depth.
        runway_width_m: spacing of the lines where it is known: then one line is enough for a centre line, and two
            lines are held to it.

    Raises:
        ValueError: an unknown method or mode, or a number out of range.
    """

    method: Method = "joint"
    mode: Mode = "auto"
    min_points: int = 6
    min_depth_share: float = 0.5
    runway_width_m: float | None = None
    ransac: RansacConfig = field(default_factory=RansacConfig)
    noise: NoiseConfig = field(default_factory=NoiseConfig)
    agreement: AgreementConfig = field(default_factory=AgreementConfig)
    deck: DeckConfig = field(default_factory=DeckConfig)

    def __post_init__(self) -> None:
        if self.method not in get_args(Method):
            raise ValueError(f"method must be one of {', '.join(get_args(Method))}, got {self.method!r}")
        if self.mode not in get_args(Mode):
            raise ValueError(f"mode must be one of {', '.join(get_args(Mode))}, got {self.mode!r}")
        if self.min_points < 3 or not 0 <= self.min_depth_share <= 1:
            raise ValueError(
                f"expected min_points >= 3 and min_depth_share in 0..1, got {self.min_points}, {self.min_depth_share}"
            )
        if self.runway_width_m is not None and not self.runway_width_m > 0:
            raise ValueError(f"runway_width_m must be positive, got {self.runway_width_m}")
