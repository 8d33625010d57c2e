"""How a campaign flies one landing."""

from contextlib import closing

from deckline_lab.campaigns.faults import faulty_sights
from deckline_sim.landing.config import LandingConfig
from deckline_sim.landing.landing import Landing, Sights, fly, start_aircraft
from deckline_sim.landing.surroundings import surroundings


def fly_landing(config: LandingConfig, seed: int) -> Landing:
    """Fly one landing with the sights that its config names; errors as `check_landing`."""
    with closing(sights_of(config, seed)) as sights:
        return fly(config, seed, sights)


def sights_of(config: LandingConfig, seed: int) -> Sights:
    """The sights that a configuration names, with its fault; errors as `check_landing`."""
    return Sights.of_config(config, seed) if config.fault is None else faulty_sights(config, seed)


def check_landing(config: LandingConfig) -> None:
    """Refuse a landing that cannot be flown.

    Raises:
        ValueError: a fault that is not known, wind and ship too fast for the aircraft, or one that cannot be trimmed.
    """
    if config.fault is not None:
        faulty_sights(config, 0).close()
    start_aircraft(surroundings(config, 0))
