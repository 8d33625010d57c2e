"""How carefully a picture is drawn."""

from dataclasses import dataclass

import numpy as np

from deckline.sim.scene.bake import SAMPLES


@dataclass(frozen=True)
class Quality:
    """How carefully a picture is drawn; a poor one looks like other renderers' work."""

    samples: int = SAMPLES  # per pixel, this many or 1, which leaves jagged edges
    anisotropy: float = 16.0  # of the deck's texture filter; 1 smears far markings together


BEST = Quality()


def random_quality(rng: np.random.Generator) -> Quality:
    """Mostly good."""
    anisotropy = float(rng.choice([1.0, 2.0, 4.0, 16.0], p=[0.15, 0.25, 0.25, 0.35]))
    return Quality(samples=1 if rng.random() < 0.15 else SAMPLES, anisotropy=anisotropy)
