"""What is known of the deck and of its place, and the wanted approach."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from deckline.checks import check_numbers

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
