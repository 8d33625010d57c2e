"""A sight without errors: guidance from the truth."""

import math
from dataclasses import replace

import numpy as np

from deckline.types import DepthMode, Guidance, Protection, Status, Value
from deckline_sim.landing.config import LandingConfig
from deckline_sim.landing.landing import make_scene
from deckline_sim.landing.sight import Moment

STEP_S = 0.01  # over which rates are taken
SIGMA = 0.01
BOUNDS = Protection(2.0, 1.0, None, None, 1e-4)


class ExactSight:
    """Status `ok` up to a range, `not seen` beyond it; `bias_m` is added to lateral deviation and height."""

    def __init__(
        self, config: LandingConfig, seed: int, seen_m: float = math.inf, bias_m: tuple[float, float] = (0.0, 0.0)
    ) -> None:
        self.scene, self.seen_m, self.bias_m = make_scene(config, seed), seen_m, bias_m

    def see(self, moment: Moment) -> Guidance:
        scene, pose = self.scene, moment.world_from_body
        hook = pose.apply(scene.approach.point_m)
        now = scene.deck.position(hook, moment.time_s)
        later = scene.deck.position(hook + STEP_S * moment.velocity_m_s, moment.time_s + STEP_S)
        if now.to_touchdown_m > self.seen_m:
            return Guidance(moment.time_s, Status.NOT_SEEN, DepthMode.NONE)
        nose = pose.rotation.apply([1.0, 0.0, 0.0])
        lateral, height = now.lateral_m + self.bias_m[0], now.height_m + self.bias_m[1]
        rates = [(getattr(later, name) - getattr(now, name)) / STEP_S for name in ("lateral_m", "height_m")]
        exact = Guidance(
            moment.time_s,
            Status.OK,
            DepthMode.COARSE,
            lateral_deviation_m=_value(lateral),
            heading_error_rad=_value(math.atan2(nose[1], nose[0]) - now.heading_rad),
            height_above_deck_m=_value(height),
            vertical_deviation_m=_value(height - now.to_touchdown_m * scene.approach.slope),
            distance_to_touchdown_m=_value(now.to_touchdown_m),
            lateral_rate_m_s=_value(rates[0]),
            height_rate_m_s=_value(rates[1]),
        )
        closing = (now.to_touchdown_m - later.to_touchdown_m) / STEP_S
        return replace(exact, closing_m_s=_value(closing), protection=BOUNDS)


def _value(number: float) -> Value:
    return Value(float(np.float64(number)), SIGMA)
