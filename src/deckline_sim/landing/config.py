"""What one landing is flown in. A value out of its range is a ValueError that names the setting and the value."""

from dataclasses import dataclass, field
from operator import attrgetter
from typing import Literal

from deckline.checks import check_choice, check_numbers
from deckline.config import Models, Tracking
from deckline_sim.config import LARGEST_PX, Preset, TimeOfDay
from deckline_sim.landing.aircraft import AIRCRAFT_TYPES
from deckline_sim.ship.ship_class import SHIP_CLASSES

NavigationGrade = Literal["exact", "good", "tactical"]
GuidanceSource = Literal["both", "navigation", "picture"]
SightKind = Literal["rendered", "points", "guidance", "exact"]
LONGEST_LATENCY_S = 1.0
# Settings that sights without points or pictures do not know.
UNSEEN = ("time_of_day", "camera.fov_deg", "camera.width", "camera.height", "tracking")
MODELLED_SEA_STATE = 4.0  # roughest of the flights that modelled guidance is fitted to: scripts/fit_sights.py


@dataclass(frozen=True)
class LandingCamera:
    """The camera ahead, and how late its answers are."""

    fov_deg: float = 60.0
    """Horizontal field of view, degrees."""
    width: int = 1280
    """Of the picture, px."""
    height: int = 720
    """Of the picture, px."""
    rate_hz: float = 10.0
    """Pictures per second."""
    latency_s: float = 0.08
    """From the exposure to the guidance, s."""

    def __post_init__(self) -> None:
        check_numbers(self, "camera", "fov_deg", least=5.0, most=120.0)
        check_numbers(self, "camera", "width", "height", least=64, most=LARGEST_PX)
        check_numbers(self, "camera", "rate_hz", least=1.0, most=60.0)
        check_numbers(self, "camera", "latency_s", least=0.0, most=LONGEST_LATENCY_S)


@dataclass(frozen=True)
class LandingConfig:
    """One landing on a ship under way."""

    ship: Preset = "cvn"
    """One of the named ships."""
    aircraft: str = "A4"
    """One of JSBSim's aircraft that `deckline_sim.landing.aircraft` knows."""
    visibility_m: float = 1000.0
    """2 % contrast, m; infinite: clear air."""
    time_of_day: TimeOfDay = "day"
    """`day`, `dusk` or `night`."""
    sea_state: float = 3.0
    """0 (still deck) to 6."""
    deck_period_factor: float = 1.0
    """Factor on the periods of the ship's roll, pitch and heave, 22, 12 and 18 s."""
    ship_speed_m_s: float = 10.0
    """Along the ship's heading, m/s."""
    wind_m_s: float = 6.0
    """Over the water, 6 m above it, m/s: W20 of MIL-F-8785C."""
    wind_from_deg: float = 0.0
    """0: against the landing direction; positive: from its right, degrees."""
    turbulence: float = 1.0
    """Factor on the gusts of that wind."""
    burble: float = 1.0
    """Factor on the wake behind the ship."""
    start_m: float = 1500.0
    """Distance to the ramp at the start, m."""
    camera: LandingCamera = field(default_factory=LandingCamera)
    """What looks ahead."""
    navigation: NavigationGrade = "good"
    """Accuracy of the navigation unit."""
    guidance: GuidanceSource = "both"
    """What the aircraft follows: navigation and picture, navigation alone, or the picture without a pose."""
    sight: SightKind = "points"
    """How the picture is seen: rendered, as modelled points through deckline, as modelled guidance, or exactly."""
    models: Models = field(default_factory=Models)
    """Dehazer and detector of rendered pictures; the modelled sights are of the shipped ones."""
    tracking: Tracking = field(default_factory=Tracking)
    """The filter over frames of rendered pictures and points."""
    level_limits: bool = True
    """Whether a protection level that is too large breaks the pass off."""
    fault: str | None = None
    """A fault of the integrity campaign; None: none."""

    def __post_init__(self) -> None:
        check_choice("time_of_day", self.time_of_day, TimeOfDay)
        check_choice("navigation", self.navigation, NavigationGrade)
        check_choice("guidance", self.guidance, GuidanceSource)
        check_choice("sight", self.sight, SightKind)
        ships = tuple(name for name in SHIP_CLASSES if name != "runway")
        if self.ship not in ships:
            raise ValueError(f"ship must be one of {ships}, got {self.ship!r}")
        if self.aircraft not in AIRCRAFT_TYPES:
            raise ValueError(f"aircraft must be one of {', '.join(AIRCRAFT_TYPES)}, got {self.aircraft!r}")
        if not self.visibility_m > 0:
            raise ValueError(f"visibility_m must be positive, got {self.visibility_m}")
        if self.guidance == "picture" and self.sight == "guidance":
            raise ValueError("sight 'guidance' does not model guidance 'picture': use sight 'points' or 'rendered'")
        if self.models != Models() and self.sight != "rendered":
            raise ValueError(f"sight {self.sight!r} is of the shipped models: fly others with sight 'rendered'")
        if self.sight == "guidance":
            self._check_modelled()
        if self.sight == "exact":
            self._check_usual(*UNSEEN)
        check_numbers(self, "", "sea_state", least=0.0, most=6.0)
        check_numbers(self, "", "deck_period_factor", least=0.25, most=4.0)
        check_numbers(self, "", "ship_speed_m_s", least=0.0, most=20.0)
        check_numbers(self, "", "wind_m_s", least=0.0, most=25.0)
        check_numbers(self, "", "wind_from_deg", least=-180.0, most=180.0)
        check_numbers(self, "", "turbulence", "burble", least=0.0, most=10.0)
        check_numbers(self, "", "start_m", least=300.0, most=5000.0)

    def _check_modelled(self) -> None:
        """Refuse what modelled guidance does not know: its tables are of flights with the usual values of these."""
        self._check_usual("ship", "deck_period_factor", *UNSEEN)
        if self.sea_state > MODELLED_SEA_STATE:
            most = f"sea_state {MODELLED_SEA_STATE:g}, got {self.sea_state:g}"
            raise ValueError(f"sight 'guidance' is fitted up to {most}: fly others with sight 'points' or 'rendered'")

    def _check_usual(self, *names: str) -> None:
        """Refuse other values than the usual ones of settings that the sight does not know."""
        for name in names:
            usual, given = attrgetter(name)(USUAL), attrgetter(name)(self)
            if given != usual:
                wanted = "the usual tracking" if name == "tracking" else f"{name} {usual}, got {given}"
                raise ValueError(f"sight {self.sight!r} is of {wanted}: fly others with sight 'points' or 'rendered'")


USUAL = LandingConfig()
