"""What the camera path can be told: lens, exposure, sensor, air, depth camera, navigation unit.

None leaves a value open: preset `train` draws it widely, the other presets have the stated default. A value out of its
range is a ValueError that names the setting and the value.
"""

from dataclasses import dataclass, field
from typing import Any, Literal, get_args

import numpy as np

from deckline.haze import Triple

Model = Literal["paper", "physical"]
Tone = Literal["gamma", "srgb", "filmic"]
LEAST_SCALE_HEIGHT_M = 40.0  # no shallower bank is drawn; far above one, single precision would run out
OF_PHYSICAL = ("scale_height_m", "patchiness", "patch_m", "angstrom", "glow")  # what the paper's model does not know
UNLIMITED = 1e9


def check_numbers(config: Any, **limits: tuple[float, float]) -> None:
    """Check fields against their lowest and highest values; None passes.

    Raises:
        ValueError: a number outside its limits.
    """
    for name, (low, high) in limits.items():
        value = getattr(config, name)
        if value is not None and not low <= value <= high:
            raise ValueError(f"{name} must lie between {low:g} and {high:g}, got {value}")


def check_choices(config: Any, **kinds: Any) -> None:
    """Check fields against a Literal each; None passes.

    Raises:
        ValueError: a value that its Literal does not name.
    """
    for name, kind in kinds.items():
        value = getattr(config, name)
        if value is not None and value not in get_args(kind):
            raise ValueError(f"{name} must be one of {get_args(kind)}, got {value!r}")


@dataclass(frozen=True)
class LensConfig:
    """The lens."""

    # k1, k2, p1, p2, k3 as OpenCV orders them; default none
    distortion: tuple[float, float, float, float, float] | None = None
    # of the optical axis from the image's middle, right and down; default 0 0
    principal_offset_px: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        for name, count in (("distortion", 5), ("principal_offset_px", 2)):
            values = getattr(self, name)
            if values is not None and (len(values) != count or not np.all(np.isfinite(values))):
                raise ValueError(f"{name} must be {count} finite numbers, got {values}")


@dataclass(frozen=True)
class FilmConfig:
    """What happens during the exposure."""

    exposure_s: float | None = None  # how long the shutter is open; 0: no motion blur; default 0
    # 1-sigma of the camera's turning about each axis, beside its flight; seen while the shutter is open; default
    # 0. Unless it is given, the picture smears by 2 % of its width at most.
    shake_deg_s: float | None = None
    rain_mm_h: float | None = None  # rainfall, which also thickens the air unless the visibility is infinite; default 0
    lens_drops: int | None = None  # drops on the lens; default 0

    def __post_init__(self) -> None:
        check_numbers(self, exposure_s=(0, 1), shake_deg_s=(0, 1000), rain_mm_h=(0, 500), lens_drops=(0, 1000))


@dataclass(frozen=True)
class SensorConfig:
    """What the camera's picture path does."""

    # stops off automatic exposure, which keeps up to a quarter of the scene's own stops; default within 0.1
    # mostly
    exposure_ev: float | None = None
    white_balance: Triple | None = None  # gain of red, green and blue, up to 100; default within 2 %
    vignetting: float | None = None  # 0 none, 1 falls to 56 % in the corners; default 0
    blur_px: float | None = None  # 1-sigma of the lens' blur; default mostly 0
    tone: Tone | None = None  # `gamma` (2.2), `srgb` or `filmic` (a shoulder for highlights); default `gamma`
    noise: float | None = None  # 1-sigma of read-out noise, 8-bit steps; default about 0.3
    electrons: float | None = None  # that a white pixel holds, for shot noise; 0: no shot noise; default above 40 000
    jpeg_quality: int | None = None  # 1..100, 0: no JPEG; default 0

    def __post_init__(self) -> None:
        check_choices(self, tone=Tone)
        check_numbers(self, vignetting=(0, 1), blur_px=(0, 20), noise=(0, 128), electrons=(0, UNLIMITED))
        check_numbers(self, jpeg_quality=(0, 100), exposure_ev=(-10, 10))
        gains = self.white_balance
        if gains is not None and (len(gains) != 3 or not all(0 < gain <= 100 for gain in gains)):
            raise ValueError(f"white_balance must be 3 positive gains up to 100, got {gains}")


@dataclass(frozen=True)
class AirConfig:
    """The air."""

    # `paper`: I = J t + A (1 - t) on 8-bit levels with one extinction; `physical`: in linear light, before
    # exposure, with what follows, all of which needs it; default `paper`
    model: Model | None = None
    # the extinction falls by e with each of these heights, at least 40; infinite: uniform air; default 1000
    scale_height_m: float | None = None
    patchiness: float | None = None  # 0 even, up to 0.9: banks of haze; default 0
    patch_m: float | None = None  # their wavelength, at least 1: shorter waves than a pixel only cost time; default 400
    # exponent of the extinction's fall with wavelength: 0 grey fog, 1.3 bluish haze; default 0
    angstrom: float | None = None
    glow: float | None = None  # how much brighter thick air is at the sun, as a share; default 1

    def __post_init__(self) -> None:
        check_choices(self, model=Model)
        check_numbers(self, scale_height_m=(LEAST_SCALE_HEIGHT_M, np.inf), patch_m=(1, np.inf))
        check_numbers(self, patchiness=(0, 0.9), angstrom=(0, 4), glow=(0, 20))
        if self.model == "paper":
            self.refuse_physical("model is paper")

    def refuse_physical(self, why: str) -> None:
        """Refuse what the paper's model does not know.

        Args:
            why: what makes it the paper's model, for the message.

        Raises:
            ValueError: something of the physical model is given.
        """
        given = [name for name in OF_PHYSICAL if getattr(self, name) is not None]
        if given:
            raise ValueError(f"air: only model physical knows {', '.join(given)}, and {why}: set model to physical")


@dataclass(frozen=True)
class DepthConfig:
    """The depth camera. The defaults measure exactly, up to a range.

    A stereo camera with a base of 0.3 m, a focal length of 700 px and matches good to 0.1 px has
    noise_per_m 0.1 / (700 * 0.3) = 0.0005.
    """

    range_m: float = 200.0  # nothing is seen farther away than this, along the optical axis
    noise_m: float = 0.0  # 1-sigma that does not depend on depth
    noise_per_m: float = 0.0  # 1-sigma that grows with the depth's square: sigma = noise_m + noise_per_m * z^2
    dropout: float = 0.0  # share of the pixels that see nothing, at random
    edge_dropout: float = 0.0  # share of the pixels at the edges of things that see nothing
    step_m: float = 0.0  # depths come in multiples of this; 0: they do not
    half_precision: bool = False  # depths pass through 16-bit floating point numbers, as AirSim's can

    def __post_init__(self) -> None:
        if not self.range_m > 0:
            raise ValueError(f"range_m must be positive, got {self.range_m}")
        check_numbers(self, noise_m=(0, UNLIMITED), noise_per_m=(0, UNLIMITED), step_m=(0, UNLIMITED))
        check_numbers(self, dropout=(0, 1), edge_dropout=(0, 1))


@dataclass(frozen=True)
class NavigationConfig:
    """The navigation unit. The defaults are exact.

    A good unit (satellite carrier phase aided, navigation grade): position_bias_m 0.1, position_sigma_m 0.02,
    attitude_bias_deg 0.02, attitude_sigma_deg 0.005. A tactical one (satellite code aided): 1.5, 0.1, 0.1, 0.02.
    """

    position_sigma_m: float = 0.0  # 1-sigma of white noise on each axis
    attitude_sigma_deg: float = 0.0  # 1-sigma of white noise about each body axis
    position_bias_m: float = 0.0  # 1-sigma of a slowly drifting error on each axis
    attitude_bias_deg: float = 0.0  # the same about each body axis
    drift_s: float = 60.0  # time constant of the drift (first-order Gauss-Markov), at least 1: faster errors are noise

    def __post_init__(self) -> None:
        check_numbers(self, position_sigma_m=(0, UNLIMITED), attitude_sigma_deg=(0, UNLIMITED))
        check_numbers(self, position_bias_m=(0, UNLIMITED), attitude_bias_deg=(0, UNLIMITED), drift_s=(1, UNLIMITED))

    @property
    def exact(self) -> bool:
        return not any((self.position_sigma_m, self.attitude_sigma_deg, self.position_bias_m, self.attitude_bias_deg))


@dataclass(frozen=True)
class ImagingConfig:
    """The camera, the air before it and its depth camera."""

    lens: LensConfig = field(default_factory=LensConfig)
    film: FilmConfig = field(default_factory=FilmConfig)
    sensor: SensorConfig = field(default_factory=SensorConfig)
    air: AirConfig = field(default_factory=AirConfig)
    depth: DepthConfig = field(default_factory=DepthConfig)
