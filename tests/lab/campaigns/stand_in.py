"""A stand-in for landings, and a program that flies a campaign of them: PLAN OUT JOBS, where JOBS may be ray."""

import os
import sys
import time
from pathlib import Path

import numpy as np

from deckline_lab.campaigns.plan import read_plan
from deckline_lab.campaigns.runner import run_campaign
from deckline_sim.landing.config import LandingConfig
from deckline_sim.landing.touchdown import Outcome
from deckline_sim.processes import RayCluster

DEADLY_SEED = "DEADLY_SEED"  # environment: file of the seed at which a process dies; the file is removed
SECONDS = 0.002  # of one landing


class Flown:
    def __init__(self, outcome: Outcome, **values: object) -> None:
        none = dict.fromkeys(("beyond_aim_m", "right_m", "sink_m_s", "first_ok_m"))
        self.values = {"outcome": str(outcome), **none, "called_for": False, "misleading": 0, **values}

    def record(self) -> dict[str, object]:
        return self.values


def fly(config: LandingConfig, seed: int) -> Flown:
    deadly = Path(os.environ.get(DEADLY_SEED, "/nowhere"))
    if deadly.exists() and int(deadly.read_text()) == seed:
        deadly.unlink()
        os._exit(9)
    rng = np.random.default_rng(seed)
    time.sleep(SECONDS)
    if rng.random() < min(0.5, 60 / config.visibility_m):
        return Flown(Outcome.WAVE_OFF, called_for=bool(rng.random() < 0.9))
    if rng.random() < 0.01 * config.turbulence:
        return Flown(Outcome.RAMP_STRIKE)
    along, right, sink = rng.normal((2.0, 0.0, 3.3), (4.0, 0.5, 0.3))
    values = {"beyond_aim_m": along, "right_m": right, "sink_m_s": sink, "first_ok_m": 700.0}
    return Flown(Outcome.WIRE if along < 9 else Outcome.BOLTER, **values)


def accept(config: LandingConfig) -> None:
    assert config.turbulence >= 0


if __name__ == "__main__":
    who = RayCluster() if sys.argv[3] == "ray" else int(sys.argv[3])
    run_campaign(read_plan(Path(sys.argv[1])), Path(sys.argv[2]), fly, accept, who)
