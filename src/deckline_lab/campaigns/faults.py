"""The faults of `deckline eval integrity` in landings: a sight by points that a fault is put into."""

from dataclasses import replace

import numpy as np

from deckline.config import RunConfig
from deckline.types import Guidance
from deckline_lab.evaluation.approaches import Sighting
from deckline_lab.evaluation.integrity_faults import FAULTS, Fault, Runs
from deckline_sim.landing.config import LandingConfig
from deckline_sim.landing.landing import Sights
from deckline_sim.landing.navigation_sight import NavigationSight
from deckline_sim.landing.point_sight import PointSight
from deckline_sim.landing.sight import Moment
from deckline_sim.landing.surroundings import surroundings

ONSET_S = (3.0, 20.0)  # when a sudden fault begins, drawn evenly
FAULT = 71  # random stream


class FaultySight:
    """Points with a fault; a `Sight`.

    Args:
        config: what the landing is flown in; its `fault` is the name of one that needs no picture.
        seed: of the landing.

    Raises:
        ValueError: a fault that is not known, or one of pictures.
    """

    def __init__(self, config: LandingConfig, seed: int) -> None:
        self.fault = find_fault(config.fault)
        rng = np.random.default_rng([seed, FAULT])
        self.onset_s = float(rng.uniform(*ONSET_S)) if self.fault.sudden else 0.0
        side = float(rng.choice([-1.0, 1.0]))
        self.step = self.fault.begin(rng)
        told = misstate_width(surroundings(config, seed).run, side * self.fault.width_off)
        self.sight = PointSight(config, seed, run=told)
        self.flight: list[Sighting] = []
        self.first = 0  # index of the first frame with the fault

    def see(self, moment: Moment) -> Guidance | None:
        """Guidance of what the fault makes of the moment; None: it takes the frame away."""
        self.flight.append(Sighting(*self.sight.draw(moment)))
        if moment.time_s < self.onset_s:
            self.first = len(self.flight)
            changed = [self.flight[-1]]
        else:
            changed = list(self.step(self.flight, self.first))
        answers = [self.sight.answer(one.frame, one.detection) for one in changed if one.detection is not None]
        return answers[-1] if answers else None

    def close(self) -> None:
        """End the flight's threads."""
        self.sight.close()


def find_fault(name: str | None) -> Fault:
    """The fault of a name that needs no picture.

    Raises:
        ValueError: there is none.
    """
    known = [fault.name for fault in FAULTS.values() if Runs.MODELLED in fault.runs]
    if name not in known:
        raise ValueError(f"fault must be one of {', '.join(known)}, got {name!r}")
    return FAULTS[name]


def misstate_width(run: RunConfig, off: float) -> RunConfig:
    """The configuration with a runway width that is wrong by a share of it."""
    width_m = run.deck.width_m
    return run if width_m is None or not off else replace(run, deck=replace(run.deck, width_m=width_m * (1 + off)))


def faulty_sights(config: LandingConfig, seed: int) -> Sights:
    """The sights of a landing with a fault.

    Raises:
        ValueError: a fault that is not known, another sight than points, or guidance that cannot have it.
    """
    if config.sight != "points":
        raise ValueError(f"fault {config.fault!r} needs sight 'points', got {config.sight!r}")
    if config.guidance == "navigation":
        raise ValueError(
            f"fault {config.fault!r} is the picture's: guidance must be 'both' or 'picture', got 'navigation'"
        )
    if config.guidance == "picture" and find_fault(config.fault).of_pose:
        raise ValueError(
            f"fault {config.fault!r} is the pose's, which guidance 'picture' has none of: fly it with 'both'"
        )
    return Sights(FaultySight(config, seed), NavigationSight(config, seed) if config.guidance == "both" else None)
