"""Table 5's figures: what each row reaches, and what it adds to the row above on the same images."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from deckline.evaluation.dehazing_score import FIGURES
from deckline.evaluation.statistics import Difference, paired_difference

Figures = Mapping[str, float]  # of one image, by FIGURES; those that exist


@dataclass(frozen=True)
class TrainedRow:
    """A row of the table, trained."""

    key: str  # of files and figures
    name: str  # for people: what it adds to the row above
    paper_psnr_db: float  # on the paper's own pictures
    weights: Path  # ONNX file
    steps: int
    minutes: float  # of training, without export
    parameters: int
    macs_256: int  # at 256x256 px


@dataclass(frozen=True, eq=False)
class RowSummary:
    """One row over all images. What does not exist is left out of the mappings."""

    images: int
    means: Figures
    gains: Mapping[str, Difference]  # by FIGURES, over the row above


def summarise_rows(scores: Mapping[str, Mapping[int, Figures]], seed: int = 0) -> dict[str, RowSummary]:
    """Row -> summary, in the order of `scores`; the first row gains over none.

    Args:
        scores: row -> image -> figures, the table's rows from above.
        seed: of the intervals.

    Raises:
        ValueError: a row without images.
    """
    summaries: dict[str, RowSummary] = {}
    above: Mapping[int, Figures] = {}
    for row, images in scores.items():
        if not images:
            raise ValueError(f"no image could be evaluated for {row}")
        summaries[row] = _summary(images, above, np.random.default_rng(seed))
        above = images
    return summaries


def _summary(images: Mapping[int, Figures], above: Mapping[int, Figures], rng: np.random.Generator) -> RowSummary:
    means, gains = {}, {}
    for name in FIGURES:
        values = [figures[name] for figures in images.values() if name in figures]
        if values:
            means[name] = float(np.mean(values))
        both = [
            figures[name] - above[image][name]
            for image, figures in images.items()
            if name in figures and name in above.get(image, {})
        ]
        if both:
            gains[name] = paired_difference(both, rng)
    return RowSummary(len(images), means, gains)
