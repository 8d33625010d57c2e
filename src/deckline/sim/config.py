"""What to simulate. A value out of its range is a ValueError that names the setting and the value."""

from dataclasses import dataclass, field
from math import inf
from typing import Literal

from deckline.sim.camera.config import (
    AirConfig,
    DepthConfig,
    FilmConfig,
    ImagingConfig,
    LensConfig,
    NavigationConfig,
    SensorConfig,
    check_choices,
    check_numbers,
)

Preset = Literal["paper", "cvn", "axial", "small", "runway", "train"]
Trajectory = Literal["approach", "profile", "random", "deckless"]
TimeOfDay = Literal["day", "dusk", "night"]
Sky = Literal["clear", "broken", "overcast"]
Pointing = Literal["ahead", "runway"]
FLIGHTS: tuple[Trajectory, ...] = ("approach", "profile")  # whose frames are one flight; the others' are unrelated
CLEAR: tuple[float, float] = (inf, inf)
LARGEST_PX = 8192  # of a picture's sides; graphics cards' buffers end at 16384
FARTHEST_M = 10000.0  # from the ramp; the renderer's far plane lies at 20 km


@dataclass(frozen=True)
class WeatherConfig:
    """The weather; None: drawn widely for preset `train`, fair for the other presets."""

    # `day`, `dusk` or `night`; None: mostly day in training, always day in the named presets
    time_of_day: TimeOfDay | None = None
    sky: Sky | None = None  # `clear`, `broken` or `overcast`; None: any in training, not overcast in the named presets
    # 0 (glassy) to 6 (waves of 5 m); None: 0 to 6 in training, 1 to 4 in the named presets
    sea_state: int | None = None
    wind_m_s: float | None = None  # at 10 m above the water; None: about what raises the sea
    # what the preset leaves open is drawn from this number, the same for every frame and recording that has it;
    # None: from the recording's own seed
    seed: int | None = None

    def __post_init__(self) -> None:
        check_choices(self, time_of_day=TimeOfDay, sky=Sky)
        check_numbers(self, sea_state=(0, 6), wind_m_s=(0, 40), seed=(0, inf))


@dataclass(frozen=True)
class MotionConfig:
    """The ship's motion."""

    # 0 to 6, also between: roll, pitch and heave of the deck. Below 4 they shrink with the significant wave
    # height. None: a random state for preset `train`, 0 (still) for the others.
    sea_state: float | None = None
    ship_speed_m_s: float = 0.0  # along the ship's heading, up to 30; 12.9 is 25 knots

    def __post_init__(self) -> None:
        check_numbers(self, sea_state=(0, 6), ship_speed_m_s=(0, 30))


@dataclass(frozen=True)
class FlightConfig:
    """How an approach or the profile is flown; unrelated views know nothing of it.

    Winds blow over the water; the ship's own speed comes on top. None: still air and no offset for the named presets,
    drawn widely for preset `train`.
    """

    glideslope_deg: float = 3.5  # of trajectory `approach`; the profile's heights are the paper's
    speed_m_s: float = 65.0  # horizontal speed through the air
    headwind_m_s: float | None = None  # against the landing direction
    crosswind_m_s: float | None = None  # from the right; the nose turns into it
    # to the right of the centre line at the start; the pilot closes it on the way
    lateral_offset_m: float | None = None
    vertical_offset_m: float | None = None  # above the path at the start
    turbulence_m_s: float | None = None  # 1-sigma of the gusts to the side and upwards; 1 is light, 3 severe
    # where the camera looks. `ahead`: along the aircraft's axis; `runway`: turned to the touchdown point with a
    # level horizon. None: `runway` for trajectory `profile`, `ahead` for the others.
    pointing: Pointing | None = None

    def __post_init__(self) -> None:
        check_choices(self, pointing=Pointing)
        check_numbers(self, glideslope_deg=(1, 15), speed_m_s=(10, 150), turbulence_m_s=(0, 10))
        check_numbers(self, headwind_m_s=(-40, 40), crosswind_m_s=(-40, 40))
        check_numbers(self, lateral_offset_m=(-1000, 1000), vertical_offset_m=(-200, 200))


@dataclass(frozen=True)
class SimConfig:
    """One simulated recording."""

    # which ship. `paper`: the published edge lines; `cvn`: a large carrier of public dimensions; `axial`: a ship
    # with a ski jump and an unangled deck; `small`: a short deck; `runway`: on land; `train`: another random ship
    # every `frames_per_ship` frames, some without a runway, in any light, weather and camera.
    preset: Preset = "paper"
    # `approach`: one final approach; `profile`: the paper's flight from 5 km; `random`: unrelated views around
    # the glide path; `deckless`: views without a runway (preset `train`): in turn open sea or land, other ships,
    # a coast, past a ship, a bare deck
    trajectory: Trajectory = "approach"
    frames: int = 100  # how many
    # lowest and highest visibility (2 % contrast), drawn uniformly for every random view and once for a flight;
    # both infinite: clear air
    visibility_m: tuple[float, float] = CLEAR
    seed: int = 0  # everything random follows from it and from the frame's index
    width: int = 1280  # of the image, px; up to 8192
    height: int = 720  # likewise
    fov_deg: float = 90.0  # horizontal field of view; random views of preset `train` draw their own unless `fixed_fov`
    # also give a view without its haze, rain and motion blur (Frame.truth.clear_rgb); none is given where the
    # visibility is infinite
    keep_clear: bool = True
    # nearest and farthest distance to the ramp of a random view, up to 10 km; None: 60 to 800 m, and 30 to 1500 m
    # for preset `train`
    range_m: tuple[float, float] | None = None
    # least and greatest glide angle to the touchdown point of a random view before the ramp, degrees; None: 2 to
    # 8, and at times 1.5 to 12 for preset `train`
    elevation_deg: tuple[float, float] | None = None
    fixed_fov: bool = False  # keep `fov_deg` for the random views of preset `train`
    start_m: float = 800.0  # distance to the ramp where an approach begins, up to 10 km; the profile begins at 5 km
    end_m: float = 12.0  # and where both end
    frames_per_ship: int = 4  # random views that share a ship, its paint and the sun's direction
    # A sea state given to one of weather and motion counts for both.
    weather: WeatherConfig = field(default_factory=WeatherConfig)
    motion: MotionConfig = field(default_factory=MotionConfig)
    flight: FlightConfig = field(default_factory=FlightConfig)
    air: AirConfig = field(default_factory=AirConfig)
    lens: LensConfig = field(default_factory=LensConfig)
    film: FilmConfig = field(default_factory=FilmConfig)
    sensor: SensorConfig = field(default_factory=SensorConfig)
    depth: DepthConfig = field(default_factory=DepthConfig)
    navigation: NavigationConfig = field(default_factory=NavigationConfig)

    def __post_init__(self) -> None:
        check_choices(self, preset=Preset, trajectory=Trajectory)
        if self.trajectory == "deckless" and self.preset != "train":
            raise ValueError(f"trajectory deckless shows ships of preset train, got preset {self.preset!r}")
        check_numbers(self, frames=(1, inf), frames_per_ship=(1, inf), seed=(0, inf), fov_deg=(1, 150))
        check_numbers(self, width=(1, LARGEST_PX), height=(1, LARGEST_PX), start_m=(0, FARTHEST_M))
        for name, highest in (("visibility_m", inf), ("range_m", FARTHEST_M), ("elevation_deg", 45.0)):
            limits = getattr(self, name)
            if limits is not None and not 0 < limits[0] <= limits[1] <= highest:
                raise ValueError(f"{name} must be (low, high) with 0 < low <= high <= {highest:g}, got {limits}")
        if self.visibility_m[0] < self.visibility_m[1] == inf:
            raise ValueError(f"visibility_m must be finite on both sides or on none, got {self.visibility_m}")
        if not 0 < self.end_m < self.start_m:
            raise ValueError(f"start_m must exceed end_m > 0, got {self.start_m} and {self.end_m}")
        if self.preset != "train" and self.air.model is None:
            self.air.refuse_physical(f"preset {self.preset} uses model paper")

    @property
    def imaging(self) -> ImagingConfig:
        """Everything between the scene's light and the recorded picture."""
        return ImagingConfig(self.lens, self.film, self.sensor, self.air, self.depth)

    @property
    def ranges_m(self) -> tuple[float, float]:
        """Nearest and farthest distance to the ramp of a random view."""
        if self.range_m is not None:
            return self.range_m
        return (30.0, 1500.0) if self.preset == "train" else (60.0, 800.0)
