"""How a campaign flies one landing."""

from deckline_sim.landing.config import LandingConfig
from deckline_sim.landing.landing import Landing, fly, start_aircraft
from deckline_sim.landing.surroundings import surroundings


def fly_landing(config: LandingConfig, seed: int) -> Landing:
    """Fly one landing with the sights that its config names; errors as `check_landing`."""
    return fly(config, seed)


def check_landing(config: LandingConfig) -> None:
    """Refuse a landing that cannot be flown.

    Raises:
        ValueError: an unknown aircraft, or one that cannot be trimmed in that wind.
    """
    start_aircraft(surroundings(config, 0))
