"""Simulated time, and the sun's position at a date and time."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime, timedelta

import numpy as np
from numpy.typing import NDArray

from deckline_sim.config import TimeOfDay
from deckline_sim.scene.weather import DUSK_DEG, ELEVATION_DEG

TILT_DEG = 23.45  # of the Earth's axis
DARK_DEG = -6.0  # the sun's elevation at the end of civil twilight: below it, the moon is opposite the sun
FORMAT = "%Y-%m-%d %H:%M:%S"  # AirSim's
SUMMER_TIME = timedelta(hours=1)  # ahead of the solar time


class SimClock:
    """Simulated seconds since its creation: it runs with the wall clock, is paused, or runs for a given time.

    Every thread may read it.

    Args:
        ticks: a monotonic clock, s.
        epoch_ns: time of its creation, ns since 1970; None: now.
    """

    def __init__(self, ticks: Callable[[], float] = time.monotonic, epoch_ns: int | None = None) -> None:
        self._ticks = ticks
        self._epoch_ns = time.time_ns() if epoch_ns is None else epoch_ns
        self.run = (0.0, ticks(), math.inf)  # seconds at the start of this run, its tick, how long it may last

    def seconds(self) -> float:
        start_s, tick, limit_s = self.run
        return start_s + min(self._ticks() - tick, limit_s)

    def nanoseconds(self, seconds: float) -> int:
        """A simulated time as a time stamp, ns since 1970."""
        return self._epoch_ns + round(seconds * 1e9)

    @property
    def paused(self) -> bool:
        _, tick, limit_s = self.run
        return self._ticks() - tick >= limit_s

    def pause(self, paused: bool) -> None:
        """Pause or resume."""
        self.run_for(0.0 if paused else math.inf)

    def run_for(self, seconds: float) -> None:
        """Run for some seconds, then pause."""
        self.run = (self.seconds(), self._ticks(), seconds)


@dataclass(frozen=True)
class SolarClock:
    """A running date and time, local solar."""

    start: datetime  # when it was set
    since_s: float  # simulated time when it was set
    speed: float = 1.0  # seconds of the sun for a simulated one
    step_s: float = 60.0  # simulated seconds between two moves of the sun

    def at(self, time_s: float) -> datetime:
        """Date and time at a simulated time; a ValueError beyond the calendar."""
        steps = math.floor((time_s - self.since_s) / self.step_s)
        try:
            return self.start + timedelta(seconds=steps * self.step_s * self.speed)
        except OverflowError:
            raise ValueError(f"a clock {self.speed:g} times as fast has left the calendar: set it anew") from None


def read_time(text: object, daylight_saving: bool = False) -> datetime:
    """Solar time of '2026-02-12 15:20:00' as AirSim writes it, or of summer time; anything else is a ValueError."""
    try:
        return datetime.strptime(str(text), FORMAT) - SUMMER_TIME * daylight_saving
    except (ValueError, OverflowError):
        raise ValueError(f"a date and time is written like 2026-02-12 15:20:00, got {text!r:.40}") from None


def sun_angles(when: datetime, latitude_deg: float) -> tuple[float, float]:
    """Elevation and azimuth (from north over east) of the sun, rad, at a local solar time.

    Source: Cooper 1969 for the declination, within 1 degree; spherical trigonometry for the rest.
    """
    day = when.timetuple().tm_yday
    declination = math.radians(TILT_DEG) * math.sin(2 * math.pi * (284 + day) / 365)
    hours = when.hour + when.minute / 60 + when.second / 3600
    hour_angle, latitude = math.radians(15 * (hours - 12)), math.radians(latitude_deg)
    east = -math.cos(declination) * math.sin(hour_angle)
    north = math.sin(declination) * math.cos(latitude)
    north -= math.cos(declination) * math.sin(latitude) * math.cos(hour_angle)
    up = math.sin(latitude) * math.sin(declination)
    up += math.cos(latitude) * math.cos(declination) * math.cos(hour_angle)
    return math.asin(min(max(up, -1.0), 1.0)), math.atan2(east, north)


def light_at(when: datetime, latitude_deg: float) -> tuple[TimeOfDay, NDArray[np.float64]]:
    """Day, dusk or night, and the unit vector (3,) from the sun, at night the moon, to the ground, world NED.

    The elevation is clipped to the range that the simulator draws for that time of day.
    """
    elevation, azimuth = sun_angles(when, latitude_deg)
    time_of_day: TimeOfDay = "day"
    if elevation < math.radians(DARK_DEG):
        time_of_day, elevation, azimuth = "night", -elevation, azimuth + math.pi
    elif elevation < math.radians(DUSK_DEG):
        time_of_day = "dusk"
    low, high = (math.radians(limit) for limit in ELEVATION_DEG[time_of_day])
    elevation = min(max(elevation, low), high)
    level = -math.cos(elevation)
    return time_of_day, np.array([level * math.cos(azimuth), level * math.sin(azimuth), math.sin(elevation)])
