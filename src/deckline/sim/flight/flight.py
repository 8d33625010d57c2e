"""How the aircraft flies an approach: wind, gusts, the deviations its pilot closes, and where its camera points."""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

Pointing = Literal["ahead", "runway"]
CLOSED = 0.7  # part of an approach after which the pilot has closed the first offsets; our choice
GUST_SCALE_M = 200.0  # Dryden length at 50 m height (202 m): MIL-F-8785C, low-altitude model
GUST_HZ = (0.02, 0.6)  # slower gusts are wind, faster ones an aircraft does not follow
GUST_WAVES = 24
PILOT_RAD_S = 0.5  # how fast a pilot brings a displaced aircraft back; our choice
ROLL_PER_GUST = 0.02  # rad of roll for 1 m/s of side gust; our choice
WANDER_HZ = (0.02, 0.1)  # of a flown path about the nominal one
SHAKE_HZ = (0.05, 0.4)  # of the attitude


@dataclass(frozen=True)
class FlightConfig:
    """How an approach or the profile is flown; unrelated views know nothing of it.

    Winds blow over the water; the ship's own speed comes on top. None: still air and no offset for the named presets,
    drawn widely for preset `train`.

    Args:
        glideslope_deg: of trajectory `approach`; the profile's heights are the paper's.
        speed_m_s: horizontal speed through the air.
        headwind_m_s: against the landing direction.
        crosswind_m_s: from the right; the nose turns into it.
        lateral_offset_m: to the right of the centre line at the start; the pilot closes it on the way.
        vertical_offset_m: above the path at the start.
        turbulence_m_s: 1-sigma of the gusts to the side and upwards; 1 is light, 3 severe.
        pointing: where the camera looks. `ahead`: along the aircraft's axis; `runway`: turned to the touchdown point
            with a level horizon. None: `runway` for trajectory `profile`, `ahead` for the others.

    Raises:
        ValueError: an unknown pointing, or a number out of its range.
    """

    glideslope_deg: float = 3.5
    speed_m_s: float = 65.0
    headwind_m_s: float | None = None
    crosswind_m_s: float | None = None
    lateral_offset_m: float | None = None
    vertical_offset_m: float | None = None
    turbulence_m_s: float | None = None
    pointing: Pointing | None = None

    def __post_init__(self) -> None:
        if not 1.0 <= self.glideslope_deg <= 15.0:
            raise ValueError(f"glideslope_deg must lie between 1 and 15, got {self.glideslope_deg}")
        if not 10.0 <= self.speed_m_s <= 150.0:
            raise ValueError(f"speed_m_s must lie between 10 and 150, got {self.speed_m_s}")
        for name, limit in (("headwind_m_s", 40.0), ("crosswind_m_s", 40.0), ("lateral_offset_m", 1000.0),
                            ("vertical_offset_m", 200.0)):  # fmt: skip
            value = getattr(self, name)
            if value is not None and not abs(value) <= limit:
                raise ValueError(f"{name} must lie between -{limit:g} and {limit:g}, got {value}")
        if self.turbulence_m_s is not None and not 0.0 <= self.turbulence_m_s <= 10.0:
            raise ValueError(f"turbulence_m_s must lie between 0 and 10, got {self.turbulence_m_s}")
        if self.pointing is not None and self.pointing not in get_args(Pointing):
            raise ValueError(f"pointing must be one of {get_args(Pointing)}, got {self.pointing!r}")


AS_STATED = FlightConfig()


@dataclass(frozen=True)
class Flight:
    """One flight's numbers, all random choices made."""

    speed_m_s: float
    headwind_m_s: float
    crosswind_m_s: float
    lateral_offset_m: float
    vertical_offset_m: float
    turbulence_m_s: float


def draw_flight(config: FlightConfig, train: bool, rng: np.random.Generator) -> Flight:
    """Numbers that the configuration leaves open; `train`: as preset `train` has them."""
    drawn = {
        "headwind_m_s": rng.uniform(0.0, 12.0),
        "crosswind_m_s": np.clip(rng.normal(0.0, 4.0), -12.0, 12.0),
        "lateral_offset_m": rng.normal(0.0, 20.0),
        "vertical_offset_m": rng.normal(0.0, 4.0),
        "turbulence_m_s": rng.uniform(0.0, 2.0),
    }
    chosen = {name: getattr(config, name) for name in drawn}
    open_ones = {name: float(drawn[name]) if train else 0.0 for name, value in chosen.items() if value is None}
    return Flight(config.speed_m_s, **(chosen | open_ones))


def closing_speed(
    along: NDArray[np.float64], ship_m_s: NDArray[np.float64], wind_m_s: NDArray[np.float64], speed_m_s: float
) -> float:
    """Speed, m/s, over the moving deck along a unit vector (2,) for an aircraft of a speed through the air.

    Solves |ship + c along - wind| = speed.

    Args:
        ship_m_s, wind_m_s: horizontal velocities (2,) over the water.

    Raises:
        ValueError: the wind is too strong for that speed.
    """
    drift = ship_m_s - wind_m_s
    ahead = float(drift @ along)
    inside = ahead**2 - float(drift @ drift) + speed_m_s**2
    closing = -ahead + np.sqrt(max(inside, 0.0))
    if inside < 0 or closing < 1.0:
        raise ValueError(
            f"an aircraft of {speed_m_s:g} m/s cannot approach a deck that moves at "
            f"{np.linalg.norm(drift):.1f} m/s through the air: choose less wind or a slower ship"
        )
    return float(closing)


def offset_left(phase: float) -> float:
    """Part of the first offset that is left at a part 0..1 of the way; its rate starts and ends at 0."""
    x = float(np.clip(phase / CLOSED, 0.0, 1.0))
    return 1.0 - x**3 * (10.0 - 15.0 * x + 6.0 * x * x)


def wander(time_s: float, band_hz: tuple[float, float], rng: np.random.Generator, waves: int = 4) -> float:
    """A sum of sines about 1 in size at a time, the same function for the same rng state."""
    amplitude, frequency, start = rng.normal(size=waves), rng.uniform(*band_hz, waves), rng.uniform(0, 2 * np.pi, waves)
    return float(np.sum(amplitude * np.sin(2 * np.pi * frequency * time_s + start)) / np.sqrt(waves / 2))


def gust(time_s: float, sigma_m_s: float, speed_m_s: float, rng: np.random.Generator) -> tuple[float, float]:
    """Gust along one axis, m/s, and how far it has moved the aircraft, m, the same function for the same rng state.

    Sines with the amplitudes of Dryden's longitudinal spectrum (MIL-F-8785C), scaled to the sigma inside the band. The
    aircraft moves with a gust except that its pilot brings it back, so slow gusts do not add up.
    """
    edges = 2 * np.pi * np.geomspace(*GUST_HZ, GUST_WAVES + 1)
    omega = np.sqrt(edges[:-1] * edges[1:])
    power = np.diff(edges) / (1.0 + (GUST_SCALE_M / speed_m_s * omega) ** 2)
    amplitude = sigma_m_s * np.sqrt(2.0 * power / power.sum())
    angle = omega * time_s + rng.uniform(0.0, 2 * np.pi, GUST_WAVES)
    velocity = np.sum(amplitude * np.sin(angle))
    moved = np.sum(amplitude * (PILOT_RAD_S * np.sin(angle) - omega * np.cos(angle)) / (PILOT_RAD_S**2 + omega**2))
    return float(velocity), float(moved)
