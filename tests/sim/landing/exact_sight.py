"""A sight without errors: guidance from the truth."""

import math
from dataclasses import replace

from deckline.types import DepthMode, Guidance, Protection, Status
from deckline_sim.landing.config import LandingConfig
from deckline_sim.landing.deviations import Deviations, deviations, stated_guidance
from deckline_sim.landing.sight import Moment
from deckline_sim.landing.surroundings import surroundings

SIGMA = Deviations(*[0.01] * 8)
BOUNDS = Protection(2.0, 1.0, None, None, 1e-4)


class ExactSight:
    """Status `ok` up to a range, `not seen` beyond it; `bias_m` is added to lateral deviation and height."""

    def __init__(
        self, config: LandingConfig, seed: int, seen_m: float = math.inf, bias_m: tuple[float, float] = (0.0, 0.0)
    ) -> None:
        self.scene, self.seen_m, self.bias_m = surroundings(config, seed), seen_m, bias_m

    def see(self, moment: Moment) -> Guidance:
        scene, approach = self.scene, self.scene.run.approach
        truth = deviations(scene.deck, moment.time_s, moment.world_from_body, moment.velocity_m_s, approach)
        self.last = truth
        if truth.distance_m > self.seen_m:
            return Guidance(moment.time_s, Status.NOT_SEEN, DepthMode.NONE)
        lateral, height = truth.lateral_m + self.bias_m[0], truth.height_m + self.bias_m[1]
        found = replace(truth, lateral_m=lateral, height_m=height)
        return stated_guidance(moment.time_s, found, SIGMA, Status.OK, BOUNDS, approach)
