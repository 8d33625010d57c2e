"""Sight without errors: what ship, air and autopilot do to a landing by themselves."""

from deckline.types import DepthMode, Guidance, Protection, Status
from deckline_sim.landing.config import LandingConfig
from deckline_sim.landing.deviations import Deviations, deviations, stated_guidance
from deckline_sim.landing.sight import Moment
from deckline_sim.landing.surroundings import surroundings

SIGMA = Deviations(*[0.01] * 8)  # nominal, each in its unit: records need one though the errors are 0
LEVEL_M = 0.1  # of its protection


class ExactSight:
    """Guidance from the truth, `ok` from the visibility on; a `Sight`.

    Args:
        config: what the landing is flown in.
        seed: of the landing.
        seen_m: to the ramp, from which on it is `ok`, m; None: the visibility.
    """

    def __init__(self, config: LandingConfig, seed: int, seen_m: float | None = None) -> None:
        self.surroundings = surroundings(config, seed)
        self.seen_m = config.visibility_m if seen_m is None else seen_m

    def see(self, moment: Moment) -> Guidance:
        """Guidance of the moment."""
        run = self.surroundings.run
        true = self.truth(moment)
        if true.distance_m > self.seen_m:
            return Guidance(moment.time_s, Status.NOT_SEEN, DepthMode.NONE)
        level = Protection(LEVEL_M, LEVEL_M, None, None, run.integrity.risk)
        return stated_guidance(moment.time_s, true, SIGMA, Status.OK, level, run.approach)

    def truth(self, moment: Moment) -> Deviations:
        """Where the aircraft is at the moment."""
        return deviations(self.surroundings, moment.time_s, moment.world_from_body, moment.velocity_m_s)
