"""What to simulate."""

from dataclasses import dataclass, field
from math import isinf
from typing import Literal, get_args

from deckline.sim.camera.atmosphere import AirConfig
from deckline.sim.camera.depth_camera import DepthConfig
from deckline.sim.camera.exposure import FilmConfig
from deckline.sim.camera.imaging import ImagingConfig
from deckline.sim.camera.lens import LensConfig
from deckline.sim.camera.navigation import NavigationConfig
from deckline.sim.camera.sensor import SensorConfig
from deckline.sim.flight.flight import FlightConfig
from deckline.sim.flight.motion import MotionConfig
from deckline.sim.scene.weather import WeatherConfig

Preset = Literal["paper", "cvn", "axial", "small", "runway", "train"]
Trajectory = Literal["approach", "profile", "random", "deckless"]
FLIGHTS: tuple[Trajectory, ...] = ("approach", "profile")  # whose frames are one flight; the others' are unrelated
CLEAR: tuple[float, float] = (float("inf"), float("inf"))
LARGEST_PX = 8192  # of a picture's sides; graphics cards' buffers end at 16384
FARTHEST_M = 10000.0  # from the ramp; the renderer's far plane lies at 20 km


@dataclass(frozen=True)
class SimConfig:
    """One simulated recording.

    Args:
        preset: which ship. `paper`: the published edge lines; `cvn`: a large carrier of public dimensions; `axial`: a
            ship with a ski jump and an unangled deck; `small`: a short deck; `runway`: on land; `train`: another
            random ship every `frames_per_ship` frames, some without a runway, in any light, weather and camera.
        trajectory: `approach`: one final approach; `profile`: the paper's flight from 5 km; `random`: unrelated views
            around the glide path; `deckless`: views without a runway (preset `train`): in turn open sea or land, other
            ships, a coast, past a ship, a bare deck.
        frames: how many.
        visibility_m: lowest and highest visibility (2 % contrast), drawn uniformly for every random view and
            once for a flight; both infinite: clear air.
        seed: everything random follows from it and from the frame's index.
        width, height: image size, px; up to 8192.
        fov_deg: horizontal field of view; random views of preset `train` draw their own unless `fixed_fov`.
        keep_clear: also give a view without its haze, rain and motion blur (Frame.truth.clear_rgb); none is given where
            the visibility is infinite.
        range_m: nearest and farthest distance to the ramp of a random view, up to 10 km; None: 60 to 800 m, and 30 to
            1500 m for preset `train`.
        elevation_deg: least and greatest glide angle to the touchdown point of a random view before the ramp, degrees;
            None: 2 to 8, and at times 1.5 to 12 for preset `train`.
        fixed_fov: keep `fov_deg` for the random views of preset `train`.
        start_m, end_m: distance to the ramp where an approach begins, up to 10 km, and ends; the profile begins
            at 5 km.
        frames_per_ship: random views that share a ship, its paint and the sun's direction.
        weather, motion, flight, air, lens, film, sensor, depth, navigation: light, sea and sky; the ship's motion; how
            the approach is flown; haze; optics; exposure and rain; the picture; the depth camera; the pose's errors. A
            sea state given to one of weather and motion counts for both.

    Raises:
        ValueError: an unknown preset or trajectory, or a number out of its range.
    """

    preset: Preset = "paper"
    trajectory: Trajectory = "approach"
    frames: int = 100
    visibility_m: tuple[float, float] = CLEAR
    seed: int = 0
    width: int = 1280
    height: int = 720
    fov_deg: float = 90.0
    keep_clear: bool = True
    range_m: tuple[float, float] | None = None
    elevation_deg: tuple[float, float] | None = None
    fixed_fov: bool = False
    start_m: float = 800.0
    end_m: float = 12.0
    frames_per_ship: int = 4
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
        for name, kinds in (("preset", Preset), ("trajectory", Trajectory)):
            if getattr(self, name) not in get_args(kinds):
                raise ValueError(f"{name} must be one of {get_args(kinds)}, got {getattr(self, name)!r}")
        if self.trajectory == "deckless" and self.preset != "train":
            raise ValueError(f"trajectory deckless shows ships of preset train, got preset {self.preset!r}")
        for name in ("frames", "width", "height", "frames_per_ship"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(self, name)}")
        if max(self.width, self.height) > LARGEST_PX:
            raise ValueError(f"width and height must be at most {LARGEST_PX} px, got {self.width}x{self.height}")
        if self.seed < 0:
            raise ValueError(f"seed must not be negative, got {self.seed}")
        if not 1.0 <= self.fov_deg <= 150.0:
            raise ValueError(f"fov_deg must lie between 1 and 150, got {self.fov_deg}")
        for name in ("visibility_m", "range_m"):
            limits = getattr(self, name)
            if limits is not None and not 0 < limits[0] <= limits[1]:
                raise ValueError(f"{name} must be (low, high) with 0 < low <= high, got {limits}")
        if self.elevation_deg is not None and not 0 < self.elevation_deg[0] <= self.elevation_deg[1] <= 45:
            raise ValueError(f"elevation_deg must be (low, high) with 0 < low <= high <= 45, got {self.elevation_deg}")
        if isinf(self.visibility_m[1]) and not isinf(self.visibility_m[0]):
            raise ValueError(f"visibility_m must be finite on both sides or on none, got {self.visibility_m}")
        if not 0 < self.end_m < self.start_m:
            raise ValueError(f"start_m must exceed end_m > 0, got {self.start_m} and {self.end_m}")
        farthest = max(self.start_m, 0.0 if self.range_m is None else self.range_m[1])
        if farthest > FARTHEST_M:
            raise ValueError(f"ships are drawn up to {FARTHEST_M:g} m away, got a distance of {farthest:g} m")
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
