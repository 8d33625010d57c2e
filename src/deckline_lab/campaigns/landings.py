"""How a campaign flies one landing."""

from collections.abc import Callable

from deckline_sim.landing.aircraft import APPROACHES
from deckline_sim.landing.config import LandingConfig
from deckline_sim.landing.landing import Landing, Sights, fly, make_scene, start_aircraft

SIGHTS: dict[
    str, Callable[[LandingConfig, int], Sights]
] = {}  # makes the sights of a landing, by `sight` of its config


def fly_landing(config: LandingConfig, seed: int) -> Landing:
    """Fly one landing with the sights that its config names; errors as `check_landing`."""
    return fly(config, seed, _sights(config)(config, seed))


def check_landing(config: LandingConfig) -> None:
    """Refuse a landing that cannot be flown.

    Raises:
        ValueError: nothing makes such a sight, an unknown aircraft, or one that cannot be trimmed in that wind.
    """
    _sights(config)
    if config.aircraft not in APPROACHES:
        raise ValueError(f"aircraft must be one of {', '.join(APPROACHES)}, got {config.aircraft!r}")
    start_aircraft(config, make_scene(config, 0), 0)


def _sights(config: LandingConfig) -> Callable[[LandingConfig, int], Sights]:
    if config.sight not in SIGHTS:
        raise ValueError(f"sight must be one of {', '.join(SIGHTS) or 'none so far'}, got {config.sight!r}")
    return SIGHTS[config.sight]
