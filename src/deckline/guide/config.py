"""Where the aircraft shall touch down, and how it shall come there."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class GuideConfig:
    """The wanted approach.

    Args:
        glideslope_deg: above the deck. 3.5 is usual, 3.75 to 4 in strong wind; SPEC section 7.
        touchdown_m: aim point beyond the ramp, along the centre line; 230 ft, SPEC section 7.
        point_m: the point of the aircraft that all deviations are of - its hook, its wheels, the pilot's eye -
            forward, right, down of the body origin.

    Raises:
        ValueError: a number out of range.
    """

    glideslope_deg: float = 3.5
    touchdown_m: float = 70.0
    point_m: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if not 0 < self.glideslope_deg < 45:
            raise ValueError(f"glideslope_deg must lie between 0 and 45, got {self.glideslope_deg}")
        if not 0 <= self.touchdown_m < np.inf:
            raise ValueError(f"touchdown_m must not be negative, got {self.touchdown_m}")
        if len(self.point_m) != 3 or not np.all(np.isfinite(self.point_m)):
            raise ValueError(f"point_m must be three finite numbers, forward, right, down, got {self.point_m}")

    @property
    def slope(self) -> float:
        """Height per distance of the glideslope."""
        return float(np.tan(np.deg2rad(self.glideslope_deg)))
