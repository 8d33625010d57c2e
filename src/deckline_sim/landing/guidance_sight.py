"""Sight by modelled guidance: no picture, no chain; for tens of thousands of landings."""

from math import exp

import numpy as np
from numpy.typing import NDArray

from deckline.types import DepthMode, Guidance, Protection, Status
from deckline_sim.landing.config import LandingConfig
from deckline_sim.landing.deviations import Deviations, deviations, stated_guidance
from deckline_sim.landing.guidance_model import (
    DEPTHS,
    GRADES,
    QUANTITIES,
    RANGE_M,
    ROUGH_SEA,
    SCORES,
    STATUSES,
    GuidanceModel,
    read_guidance_model,
)
from deckline_sim.landing.sight import Moment
from deckline_sim.landing.surroundings import surroundings

Array = NDArray[np.float64]
ERRORS = 63  # random stream
OK, NOT_OK = 0, 1  # groups of the tables


class GuidanceSight:
    """Draws status, errors and protection levels of guidance from a model; a `Sight`.

    Args:
        config: what the landing is flown in.
        seed: of the landing.
        model: None: the shipped one.
    """

    def __init__(self, config: LandingConfig, seed: int, model: GuidanceModel | None = None) -> None:
        self.surroundings = surroundings(config, seed)
        self.model = model or read_guidance_model()
        self.condition = GRADES.index(config.navigation), int(config.sea_state >= ROUGH_SEA)
        self.rng = np.random.default_rng([seed, ERRORS])
        self.scores: Array = self.rng.standard_normal(len(QUANTITIES))  # independent, each with its time constant
        self.level_factor = exp(self.model.level_spread * self.rng.standard_normal())
        self.status = STATUSES.index(Status.NOT_SEEN)
        self.time_s: float | None = None
        self.owed_s = 0.0  # of the chain's next step

    def see(self, moment: Moment) -> Guidance:
        """Guidance of the moment with drawn errors."""
        approach = self.surroundings.run.approach
        true = deviations(self.surroundings, moment.time_s, moment.world_from_body, moment.velocity_m_s)
        self._advance(moment.time_s, true.distance_m / self.surroundings.config.visibility_m)
        status = STATUSES[self.status]
        if status is Status.NOT_SEEN:
            return Guidance(moment.time_s, status, DepthMode.NONE)
        errors, sigmas, levels = self._draw(true.distance_m, OK if status is Status.OK else NOT_OK)
        found = Deviations(*(value + error for value, error in zip(vars(true).values(), errors, strict=True)))
        lateral_m, height_m, heading_rad, distance_m = levels
        risk = self.surroundings.run.integrity.risk
        protection = Protection(lateral_m, height_m, heading_rad, distance_m, risk)
        return stated_guidance(moment.time_s, found, Deviations(*sigmas), status, protection, approach)

    def _advance(self, time_s: float, depth: float) -> None:
        """Move status and scores on to a time; `depth`: range over visibility."""
        model, first = self.model, self.time_s is None
        passed_s = 1.0 / model.rate_hz if self.time_s is None else time_s - self.time_s
        self.time_s = time_s
        self.owed_s += passed_s * model.rate_hz
        table = model.transitions[self.condition[0], max(int(np.searchsorted(DEPTHS, depth, "right")) - 1, 0)]
        while self.owed_s > 0.5:
            self.owed_s -= 1.0
            self.status = int(np.searchsorted(table[self.status], self.rng.random()))
        if not first:
            kept = np.exp(-passed_s / model.correlation_s)
            self.scores = kept * self.scores + np.sqrt(1.0 - kept**2) * self.rng.standard_normal(len(QUANTITIES))

    def _draw(self, range_m: float, group: int) -> tuple[list[float], list[float], list[float]]:
        """Errors, 1-sigmas and protection levels at a range."""
        model = self.model
        at = min(max(range_m, RANGE_M[0]), RANGE_M[-1])
        below = min(int(np.searchsorted(RANGE_M, at, "right")) - 1, len(RANGE_M) - 2)
        share = (at - RANGE_M[below]) / (RANGE_M[below + 1] - RANGE_M[below])
        mixed = [
            (1.0 - share) * table[self.condition][group, below] + share * table[self.condition][group, below + 1]
            for table in (model.errors, model.sigmas, model.levels)
        ]
        scores = model.mixing @ self.scores
        low = np.clip(np.searchsorted(SCORES, scores) - 1, 0, len(SCORES) - 2)
        rows, knots = np.arange(len(QUANTITIES)), np.array(SCORES)
        start, end = mixed[0][rows, low], mixed[0][rows, low + 1]
        errors = start + (end - start) * (scores - knots[low]) / (knots[low + 1] - knots[low])
        levels = self.level_factor * mixed[2]
        errors[: len(levels)] *= levels
        return errors.tolist(), mixed[1].tolist(), levels.tolist()
