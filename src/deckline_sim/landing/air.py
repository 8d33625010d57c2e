"""The air that an aircraft flies through behind a ship: steady wind, gusts, and the wake of the ship.

Gusts are Dryden's of MIL-F-8785C, low-altitude model, linear (no angular gusts), along and across the path over the
deck. The wake ("burble") is our own model with the features that are reported of carriers: the air behind the ship is
slower, sinks some hundred metres astern and rises close to the ramp, and is more turbulent.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deckline_sim.landing.aircraft import DYNAMICS_HZ, FT

LEAST_HEIGHT_M = 10 * FT  # of the low-altitude model
MOST_HEIGHT_M = 1000 * FT
LEAST_AIRSPEED_M_S = 10.0
# The wake, as shares of the wind over the deck at distances behind the ramp, m. Our choice.
WAKE_M = (0.0, 60.0, 150.0, 300.0, 600.0, 1000.0)
WAKE_DOWN = (-0.03, -0.02, 0.05, 0.04, 0.01, 0.0)  # positive: sinking air
WAKE_SLOWER = (0.05, 0.08, 0.08, 0.05, 0.02, 0.0)
WAKE_ROUGH = (0.06, 0.07, 0.06, 0.04, 0.01, 0.0)  # 1-sigma of its turbulence
WAKE_LENGTH_M = 40.0  # scale of the turbulence in the wake
WAKE_HALF_HEIGHT_M = 40.0  # above the deck, at which the wake has half its strength


@dataclass(eq=False)
class Gusts:
    """First- and second-order filters of white noise; call `step` once a step of the dynamics.

    Args:
        wind_20ft_m_s: W20, m/s.
        rng: of the noise.
    """

    wind_20ft_m_s: float
    rng: np.random.Generator

    def __post_init__(self) -> None:
        self._state = [0.0] * 8
        self._noise: list[list[float]] = []

    def step(self, height_m: float, airspeed_m_s: float, rough_m_s: float) -> tuple[float, float, float]:
        """Gusts along, to the right of and below the path, m/s.

        Args:
            height_m: above the water.
            airspeed_m_s: that carries the aircraft through them.
            rough_m_s: 1-sigma of the wake's turbulence, here.
        """
        dt, speed = 1 / DYNAMICS_HZ, max(airspeed_m_s, LEAST_AIRSPEED_M_S)
        height_ft = min(max(height_m, LEAST_HEIGHT_M), MOST_HEIGHT_M) / FT
        ratio = 0.177 + 0.000823 * height_ft
        sigma_w = 0.1 * self.wind_20ft_m_s
        sigma_u = sigma_w / ratio**0.4
        length_u, length_w = height_ft / ratio**1.2 * FT, height_ft * FT
        if not self._noise:
            self._noise = self.rng.standard_normal((240, 6)).tolist()
        noise, state = self._noise.pop(), self._state
        state[0] = _first_order(state[0], sigma_u, speed / length_u, dt, noise[0])
        side, state[1], state[2] = _second_order(state[1], state[2], sigma_u, speed / length_u, dt, noise[1])
        down, state[3], state[4] = _second_order(state[3], state[4], sigma_w, speed / length_w, dt, noise[2])
        for k in range(3):  # the wake's, of unit variance: its strength changes on the way
            state[5 + k] = _first_order(state[5 + k], 1.0, speed / WAKE_LENGTH_M, dt, noise[3 + k])
        return state[0] + rough_m_s * state[5], side + rough_m_s * state[6], down + rough_m_s * state[7]


def _first_order(value: float, sigma: float, rate: float, dt: float, noise: float) -> float:
    """The next value of a first-order Gauss-Markov process."""
    decay = math.exp(-rate * dt)
    return decay * value + sigma * math.sqrt(1 - decay**2) * noise


def _second_order(
    slow: float, fast: float, sigma: float, rate: float, dt: float, noise: float
) -> tuple[float, float, float]:
    """Dryden's transverse filter, sigma sqrt(rate) (sqrt(3) s + rate) / (s + rate)^2 of white noise of unit intensity.

    With x'' + 2 rate x' + rate^2 x = noise the gust is sigma sqrt(rate) (sqrt(3) x' + rate x), here in steps.

    Returns:
        gust, and the states x and x' of the filter.
    """
    accelerated = noise / math.sqrt(dt) - 2 * rate * fast - rate**2 * slow
    fast = fast + dt * accelerated
    slow = slow + dt * fast
    return sigma * math.sqrt(rate) * (math.sqrt(3.0) * fast + rate * slow), slow, fast


def wake(
    behind_ramp_m: float, above_deck_m: float, wind_over_deck_m_s: float, factor: float
) -> tuple[float, float, float]:
    """The ship's wake at a place on the extended centre line.

    Returns:
        air that sinks, m/s; wind that is missing, m/s; 1-sigma of the turbulence, m/s.
    """
    if factor == 0.0 or behind_ramp_m > WAKE_M[-1]:
        return 0.0, 0.0, 0.0
    near = wind_over_deck_m_s * factor * 0.5 ** (max(above_deck_m, 0.0) / WAKE_HALF_HEIGHT_M)
    at = max(behind_ramp_m, 0.0)
    down, slower, rough = (float(np.interp(at, WAKE_M, shares)) for shares in (WAKE_DOWN, WAKE_SLOWER, WAKE_ROUGH))
    return near * down, near * slower, near * rough


def steady_wind(along: NDArray[np.float64], wind_m_s: float, from_deg: float) -> NDArray[np.float64]:
    """Wind (3,) over the water, world, m/s.

    Args:
        along: (2,) landing direction, world.
        wind_m_s: its speed.
        from_deg: 0 against the landing direction; positive from its right.
    """
    angle = math.radians(from_deg)
    right = np.array([-along[1], along[0]])
    return np.array([*(-wind_m_s * (math.cos(angle) * along + math.sin(angle) * right)), 0.0])
