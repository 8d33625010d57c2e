"""What to simulate: ship, weather, flight, air, camera, depth camera, navigation unit.

None leaves a value open: preset `train` draws it widely, the other presets have the stated default. A value out of its
range is a ValueError that names the setting and the value.
"""

from dataclasses import MISSING, dataclass, field, fields
from math import inf
from typing import Any, Literal

import numpy as np

from deckline.checks import check_choice
from deckline.config import Approach
from deckline.haze import Triple

AirModel = Literal["paper", "physical"]
Tone = Literal["gamma", "srgb", "filmic"]
LEAST_SCALE_HEIGHT_M = 40.0  # no shallower bank is drawn; far above one, single precision would run out
OF_PHYSICAL = ("scale_height_m", "patchiness", "patch_m", "angstrom", "glow")  # parameters of model `physical` alone
UNLIMITED = 1e9
Preset = Literal["paper", "cvn", "axial", "small", "runway", "train", "airfield", "pad"]
DRAWN: tuple[Preset, ...] = ("airfield", "pad")  # on a plane, without OpenGL
NOT_DRAWN = (
    *("weather", "motion", "flight", "air", "lens", "exposure", "sensor", "navigation"),
    *("fov_deg", "fixed_fov", "range_m", "elevation_deg", "start_m", "end_m"),
)
Trajectory = Literal["approach", "profile", "landing", "random", "deckless"]
TimeOfDay = Literal["day", "dusk", "night"]
Sky = Literal["clear", "broken", "overcast"]
Pointing = Literal["ahead", "runway"]
FLIGHTS: tuple[Trajectory, ...] = ("approach", "profile", "landing")  # one flight; other frames are unrelated
CLEAR: tuple[float, float] = (inf, inf)
LARGEST_PX = 8192  # of a picture's sides; graphics cards' buffers end at 16384
FARTHEST_M = 10000.0  # from the ramp; the renderer's far plane lies at 20 km


def _check_limits(config: Any, **limits: tuple[float, float]) -> None:
    """Refuse fields below their lowest or above their highest values; None passes."""
    for name, (low, high) in limits.items():
        value = getattr(config, name)
        if value is not None and not low <= value <= high:
            raise ValueError(f"{name} must lie between {low:g} and {high:g}, got {value}")


def _check_choices(config: Any, **kinds: Any) -> None:
    """Refuse fields that their Literal does not name; None passes."""
    for name, kind in kinds.items():
        if getattr(config, name) is not None:
            check_choice(name, getattr(config, name), kind)


@dataclass(frozen=True)
class LensConfig:
    """The lens."""

    distortion: tuple[float, float, float, float, float] | None = None
    """k1, k2, p1, p2, k3 as OpenCV orders them; default none."""
    principal_offset_px: tuple[float, float] | None = None
    """Of the optical axis from the image's middle, right and down, px; default 0 0."""

    def __post_init__(self) -> None:
        for name, count in (("distortion", 5), ("principal_offset_px", 2)):
            values = getattr(self, name)
            if values is not None and (len(values) != count or not np.all(np.isfinite(values))):
                raise ValueError(f"{name} must be {count} finite numbers, got {values}")


@dataclass(frozen=True)
class ExposureConfig:
    """Motion blur and rain during the exposure, and drops on the lens."""

    exposure_s: float | None = None
    """Time that the shutter is open, s; 0: no motion blur; default 0."""
    shake_deg_s: float | None = None
    """1-sigma of the camera's rate about each axis during the exposure, deg/s, beside that of the flight; default 0.
    Unless it is given, the picture smears by 2 % of its width at most."""
    rain_mm_h: float | None = None
    """Rainfall, mm/h, which also adds extinction unless the visibility is infinite; default 0."""
    lens_drops: int | None = None
    """Number of drops on the lens; default 0."""

    def __post_init__(self) -> None:
        _check_limits(self, exposure_s=(0, 1), shake_deg_s=(0, 1000), rain_mm_h=(0, 500), lens_drops=(0, 1000))


@dataclass(frozen=True)
class SensorConfig:
    """Lens blur, exposure, tone curve, noise and compression of the camera."""

    exposure_ev: float | None = None
    """Exposure, stops from automatic exposure, which leaves up to a quarter of the scene's own stops; default mostly
    within 0.1."""
    white_balance: Triple | None = None
    """Gain of red, green and blue, up to 100; default within 2 %."""
    vignetting: float | None = None
    """0 none; 1 falls to 56 % in the corners; default 0."""
    blur_px: float | None = None
    """1-sigma of the lens' blur, px; default mostly 0."""
    tone: Tone | None = None
    """`gamma` (2.2), `srgb` or `filmic` (a shoulder for highlights); default `gamma`."""
    noise: float | None = None
    """1-sigma of read-out noise, 8-bit levels; default about 0.3."""
    electrons: float | None = None
    """Full well, electrons of a white pixel, for shot noise; 0: no shot noise; default above 40 000."""
    jpeg_quality: int | None = None
    """1..100; 0: no JPEG; default 0."""

    def __post_init__(self) -> None:
        _check_choices(self, tone=Tone)
        _check_limits(self, vignetting=(0, 1), blur_px=(0, 20), noise=(0, 128), electrons=(0, UNLIMITED))
        _check_limits(self, jpeg_quality=(0, 100), exposure_ev=(-10, 10))
        gains = self.white_balance
        if gains is not None and (len(gains) != 3 or not all(0 < gain <= 100 for gain in gains)):
            raise ValueError(f"white_balance must be 3 positive gains up to 100, got {gains}")


@dataclass(frozen=True)
class AirConfig:
    """The air."""

    model: AirModel | None = None
    """`paper`: I = J t + A (1 - t) on 8-bit levels with one extinction. `physical`: in linear light, before exposure;
    the other fields need it. Default `paper`."""
    scale_height_m: float | None = None
    """Height over which the extinction falls by e, m, at least 40; infinite: uniform air; default 1000."""
    patchiness: float | None = None
    """0 even air, up to 0.9: banks of haze; default 0."""
    patch_m: float | None = None
    """Wavelength of the banks, m, at least 1: shorter waves than a pixel only cost time; default 400."""
    angstrom: float | None = None
    """Exponent of the extinction's fall with wavelength: 0 grey fog, 1.3 bluish haze; default 0."""
    glow: float | None = None
    """Excess brightness of thick air towards the sun, as a share; default 1."""

    def __post_init__(self) -> None:
        _check_choices(self, model=AirModel)
        _check_limits(self, scale_height_m=(LEAST_SCALE_HEIGHT_M, np.inf), patch_m=(1, np.inf))
        _check_limits(self, patchiness=(0, 0.9), angstrom=(0, 4), glow=(0, 20))
        if self.model == "paper":
            self.refuse_physical("model is paper")

    def refuse_physical(self, why: str) -> None:
        """Refuse parameters of model `physical`; the message holds `why` the model is `paper`."""
        given = [name for name in OF_PHYSICAL if getattr(self, name) is not None]
        if given:
            raise ValueError(f"air: only model physical knows {', '.join(given)}, and {why}: set model to physical")


@dataclass(frozen=True)
class DepthConfig:
    """The depth camera. The defaults measure exactly, up to a range.

    A stereo camera with a base of 0.3 m, a focal length of 700 px and matches good to 0.1 px has
    noise_per_m 0.1 / (700 * 0.3) = 0.0005.
    """

    range_m: float = 200.0
    """Largest measured depth along the optical axis, m."""
    noise_m: float = 0.0
    """Constant part of the 1-sigma, m."""
    noise_per_m: float = 0.0
    """Quadratic part of the 1-sigma, 1/m: sigma = noise_m + noise_per_m * z^2."""
    dropout: float = 0.0
    """Share of the pixels without a measurement, at random."""
    edge_dropout: float = 0.0
    """Share of the pixels at depth edges without a measurement."""
    step_m: float = 0.0
    """Quantization of the depths, m; 0: none."""
    half_precision: bool = False
    """Round depths to 16-bit floating point numbers, as AirSim can."""

    def __post_init__(self) -> None:
        if not self.range_m > 0:
            raise ValueError(f"range_m must be positive, got {self.range_m}")
        _check_limits(self, noise_m=(0, UNLIMITED), noise_per_m=(0, UNLIMITED), step_m=(0, UNLIMITED))
        _check_limits(self, dropout=(0, 1), edge_dropout=(0, 1))


@dataclass(frozen=True)
class NavigationConfig:
    """The navigation unit. The defaults are exact.

    A good unit (satellite carrier phase aided, navigation grade): position_bias_m 0.1, position_sigma_m 0.02,
    attitude_bias_deg 0.02, attitude_sigma_deg 0.005. A tactical one (satellite code aided): 1.5, 0.1, 0.1, 0.02.
    """

    position_sigma_m: float = 0.0
    """1-sigma of white noise on each axis, m."""
    attitude_sigma_deg: float = 0.0
    """1-sigma of white noise about each body axis, degrees."""
    position_bias_m: float = 0.0
    """1-sigma of a slow drift on each axis, m."""
    attitude_bias_deg: float = 0.0
    """1-sigma of a slow drift about each body axis, degrees."""
    drift_s: float = 60.0
    """Time constant of the drift (first-order Gauss-Markov), s, at least 1: faster errors are noise."""

    def __post_init__(self) -> None:
        _check_limits(self, position_sigma_m=(0, UNLIMITED), attitude_sigma_deg=(0, UNLIMITED))
        _check_limits(self, position_bias_m=(0, UNLIMITED), attitude_bias_deg=(0, UNLIMITED), drift_s=(1, UNLIMITED))

    @property
    def exact(self) -> bool:
        return not any((self.position_sigma_m, self.attitude_sigma_deg, self.position_bias_m, self.attitude_bias_deg))


@dataclass(frozen=True)
class ImagingConfig:
    """The camera, the air before it and its depth camera."""

    lens: LensConfig = field(default_factory=LensConfig)
    exposure: ExposureConfig = field(default_factory=ExposureConfig)
    sensor: SensorConfig = field(default_factory=SensorConfig)
    air: AirConfig = field(default_factory=AirConfig)
    depth: DepthConfig = field(default_factory=DepthConfig)


@dataclass(frozen=True)
class WeatherConfig:
    """The weather; None: drawn widely for preset `train`, fair for the other presets."""

    time_of_day: TimeOfDay | None = None
    """`day`, `dusk` or `night`; None: mostly day in training, always day in the named presets."""
    sky: Sky | None = None
    """`clear`, `broken` or `overcast`; None: any in training, not overcast in the named presets."""
    sea_state: int | None = None
    """0 (calm) to 6 (waves of 5 m); None: 0 to 6 in training, 1 to 4 in the named presets."""
    wind_m_s: float | None = None
    """At 10 m above the water, m/s; None: about what raises the sea."""
    seed: int | None = None
    """Seed of all that the preset leaves open, the same in every frame and recording with this seed; None: from the
    recording's own seed."""

    def __post_init__(self) -> None:
        _check_choices(self, time_of_day=TimeOfDay, sky=Sky)
        _check_limits(self, sea_state=(0, 6), wind_m_s=(0, 40), seed=(0, inf))


@dataclass(frozen=True)
class MotionConfig:
    """The ship's motion."""

    sea_state: float | None = None
    """0 to 6, also between: roll, pitch and heave of the deck. Below 4 they shrink with the significant wave height.
    None: random for preset `train`, 0 (still) for the others."""
    ship_speed_m_s: float = 0.0
    """Along the ship's heading, m/s, up to 30; 12.9 is 25 knots."""

    def __post_init__(self) -> None:
        _check_limits(self, sea_state=(0, 6), ship_speed_m_s=(0, 30))


@dataclass(frozen=True)
class FlightConfig:
    """How an approach or the profile is flown; random views ignore it.

    Winds blow over the water; the ship's own speed comes on top. None: still air and no offset for the named presets,
    drawn widely for preset `train`.
    """

    glideslope_deg: float = Approach.glideslope_deg
    """Of trajectory `approach`, degrees; the profile's heights are the paper's."""
    touchdown_m: float = Approach.touchdown_m
    """Where the path ends, m beyond the ramp."""
    speed_m_s: float = 65.0
    """Horizontal speed through the air, m/s."""
    headwind_m_s: float | None = None
    """Against the landing direction, m/s."""
    crosswind_m_s: float | None = None
    """From the right, m/s; the nose turns into it."""
    lateral_offset_m: float | None = None
    """To the right of the centre line at the start, m; the pilot closes it on the way."""
    vertical_offset_m: float | None = None
    """Above the path at the start, m."""
    turbulence_m_s: float | None = None
    """1-sigma of the gusts to the side and upwards, m/s; 1 is light, 3 severe."""
    pointing: Pointing | None = None
    """Viewing direction. `ahead`: along the aircraft's axis; `runway`: at the touchdown point with a level horizon.
    None: `runway` for trajectories `profile` and `landing`, `ahead` for the others."""

    def __post_init__(self) -> None:
        _check_choices(self, pointing=Pointing)
        _check_limits(self, glideslope_deg=(1, 15), speed_m_s=(10, 150), turbulence_m_s=(0, 10))
        _check_limits(self, touchdown_m=(0, 300))
        _check_limits(self, headwind_m_s=(-40, 40), crosswind_m_s=(-40, 40))
        _check_limits(self, lateral_offset_m=(-1000, 1000), vertical_offset_m=(-200, 200))


@dataclass(frozen=True)
class SimConfig:
    """One simulated recording."""

    preset: Preset = "paper"
    """`paper`: the published edge lines; `cvn`: a large carrier of public dimensions; `axial`: a ship with a ski jump
    and an unangled deck; `small`: a short deck; `runway`: on land; `train`: another random ship every `frames_per_ship`
    frames, some without a runway, in any light, weather and camera; `airfield`: another land runway, ground, light and
    camera every frame, drawn on a plane; `pad`: a small ship's landing pad, likewise. These two have trajectory
    `random` alone."""
    trajectory: Trajectory = "approach"
    """`approach`: one final approach; `profile`: the paper's flight from 5 km; `landing`: the same from the holding
    track at 10 km, frames evenly spaced in the logarithm of the distance; `random`: unrelated views around the glide
    path; `deckless` (preset `train`): views without a runway, in turn open sea or land, other ships, a coast, past a
    ship, a bare deck."""
    frames: int = 100
    """Number of frames."""
    visibility_m: tuple[float, float] = CLEAR
    """Lowest and highest visibility (2 % contrast), m, drawn uniformly for every random view and once for a flight;
    both infinite: clear air."""
    seed: int = 0
    """Everything random follows from it and from the frame's index."""
    width: int = 1280
    """Of the image, px, up to 8192."""
    height: int = 720
    """Of the image, px, up to 8192."""
    fov_deg: float = 90.0
    """Horizontal field of view, degrees; random views of preset `train` draw their own unless `fixed_fov`."""
    keep_clear: bool = True
    """Also render the view without haze, rain and motion blur (`Frame.truth.clear_rgb`), unless the visibility is
    infinite and no foreground hides the view."""
    range_m: tuple[float, float] | None = None
    """Nearest and farthest distance to the ramp of a random view, m, up to 10 km; None: 60 to 800 m, and 30 to 1500 m
    for preset `train`."""
    elevation_deg: tuple[float, float] | None = None
    """Least and greatest glide angle to the touchdown point of a random view before the ramp, degrees; None: 2 to 8,
    and at times 1.5 to 12 for preset `train`."""
    foreground_share: float = 0.0
    """Share of the pictures behind a foreground (cockpit, a drone's legs, captions) and processed as phones do."""
    photographs: str = ""
    """Folder of pictures whose pieces are textures of presets `airfield` and `pad`."""
    fixed_fov: bool = False
    """`fov_deg` also for the random views of preset `train`."""
    start_m: float = 800.0
    """Distance to the ramp where an approach begins, m, up to 10 km; `profile` and `landing` begin at their own."""
    end_m: float = 12.0
    """Distance to the ramp where a flight ends, m."""
    frames_per_ship: int = 4
    """Random views that share a ship, its paint and the sun's direction."""
    weather: WeatherConfig = field(default_factory=WeatherConfig)
    """A sea state given to one of `weather` and `motion` counts for both."""
    motion: MotionConfig = field(default_factory=MotionConfig)
    flight: FlightConfig = field(default_factory=FlightConfig)
    air: AirConfig = field(default_factory=AirConfig)
    lens: LensConfig = field(default_factory=LensConfig)
    exposure: ExposureConfig = field(default_factory=ExposureConfig)
    sensor: SensorConfig = field(default_factory=SensorConfig)
    depth: DepthConfig = field(default_factory=DepthConfig)
    navigation: NavigationConfig = field(default_factory=NavigationConfig)

    def __post_init__(self) -> None:
        _check_choices(self, preset=Preset, trajectory=Trajectory)
        if self.preset in DRAWN:
            self._refuse_rendering()
        elif self.photographs:
            raise ValueError(f"photographs are textures of presets {' and '.join(DRAWN)}, got preset {self.preset!r}")
        if self.trajectory == "deckless" and self.preset != "train":
            raise ValueError(f"trajectory deckless shows ships of preset train, got preset {self.preset!r}")
        _check_limits(self, foreground_share=(0, 1))
        _check_limits(self, frames=(1, inf), frames_per_ship=(1, inf), seed=(0, inf), fov_deg=(1, 150))
        _check_limits(self, width=(1, LARGEST_PX), height=(1, LARGEST_PX), start_m=(0, FARTHEST_M))
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

    def _refuse_rendering(self) -> None:
        """Refuse settings that presets drawn on a plane do not have."""
        if self.trajectory != "random":
            raise ValueError(f"preset {self.preset} has no trajectory {self.trajectory!r}; give --trajectory random")
        for item in fields(self):
            default = item.default if item.default_factory is MISSING else item.default_factory()
            if item.name in NOT_DRAWN and getattr(self, item.name) != default:
                raise ValueError(f"preset {self.preset} draws its own {item.name}; leave {item.name} out")

    @property
    def imaging(self) -> ImagingConfig:
        """Everything between the scene's light and the recorded picture."""
        return ImagingConfig(self.lens, self.exposure, self.sensor, self.air, self.depth)

    @property
    def ranges_m(self) -> tuple[float, float]:
        """Nearest and farthest distance to the ramp of a random view."""
        if self.range_m is not None:
            return self.range_m
        return (30.0, 1500.0) if self.preset == "train" else (60.0, 800.0)
