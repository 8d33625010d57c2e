"""What one landing is flown in. A value out of its range is a ValueError that names it."""

from dataclasses import dataclass, field
from typing import Literal

from deckline.checks import check_choice, check_numbers
from deckline_sim.config import Preset, TimeOfDay

NavigationGrade = Literal["exact", "good", "tactical"]
GuidanceBy = Literal["both", "navigation", "picture"]
SightKind = Literal["rendered", "points", "guidance"]


@dataclass(frozen=True)
class LandingCamera:
    """The camera that looks ahead."""

    fov_deg: float = 60.0
    """Horizontal field of view, degrees."""
    width: int = 1280
    """Of the image, px."""
    height: int = 720
    """Of the image, px."""
    rate_hz: float = 10.0
    """Pictures a second."""
    latency_s: float = 0.08
    """From the exposure to its guidance, s."""

    def __post_init__(self) -> None:
        check_numbers(self, "camera", "fov_deg", least=1.0, most=150.0)
        check_numbers(self, "camera", "width", "height", least=16)
        check_numbers(self, "camera", "rate_hz", above=0.0)
        check_numbers(self, "camera", "latency_s", least=0.0)


@dataclass(frozen=True)
class LandingConfig:
    """What one landing is flown in."""

    ship: Preset = "cvn"
    aircraft: str = "A4"
    visibility_m: float = 1000.0
    """At 2 % contrast, m."""
    time_of_day: TimeOfDay = "day"
    sea_state: float = 3.0
    """0 to 6."""
    ship_speed_m_s: float = 10.0
    """Along the ship's heading, m/s."""
    wind_m_s: float = 6.0
    """Natural wind over the water at 6 m height, m/s."""
    wind_from_deg: float = 0.0
    """Where the wind comes from, from ahead of the landing direction to its right, degrees."""
    turbulence: float = 1.0
    """Factor on the intensity of Dryden's turbulence."""
    burble: float = 1.0
    """Factor on the wake behind the ship."""
    start_m: float = 1500.0
    """Distance to the ramp where the landing begins, m."""
    camera: LandingCamera = field(default_factory=LandingCamera)
    navigation: NavigationGrade = "good"
    guidance: GuidanceBy = "both"
    sight: SightKind = "points"
    detector: str = "hybrid"
    fault: str | None = None

    def __post_init__(self) -> None:
        for name, kinds in (("navigation", NavigationGrade), ("guidance", GuidanceBy), ("sight", SightKind)):
            check_choice(name, getattr(self, name), kinds)
        check_numbers(self, "", "visibility_m", "start_m", above=0.0)
        check_numbers(self, "", "sea_state", least=0.0, most=6.0)
        check_numbers(self, "", "ship_speed_m_s", "wind_m_s", "turbulence", "burble", least=0.0)
