"""Pictures of localization scores: errors with their bands against range, and how the errors are distributed."""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import norm

from deckline.atomic import write_atomic
from deckline.evaluation.localization_score import STATES, Score
from deckline.extras import needs_extra

with needs_extra("viz"):
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

PANELS = {  # figure: words, unit, its protection level
    "deviation": ("sideways,\nbeside the aircraft", "m", "lateral"),
    "lateral": ("sideways,\nat the touchdown point", "m", None),
    "heading": ("heading", "deg", None),
    "height": ("height,\nat the touchdown point", "m", "height"),
}
WIDTH_IN, ROW_IN, DPI = 9.0, 2.4, 110
BINS = np.linspace(-5.0, 5.0, 41)  # of errors over their 1-sigma
RANGE_BIN_M = 50.0  # medians of sigma, bound and protection level are drawn once in each
LEAST = 1e-4  # m or deg; smaller errors are drawn here
ERROR, SIGMA, BOUND, PROTECTION = "#555555", "#1f77b4", "#2ca02c", "#d62728"


def write_figure(path: Path, title: str, scores: Sequence[Score]) -> None:
    """Write a PNG: sizes of a centre line's errors against range, and a histogram of normalised errors.

    Raises:
        ValueError: no frame with a centre line.
    """
    known = [score for score in scores if "centre.lateral_m" in score.figures]
    if not known:
        raise ValueError(f"{title}: no frame with a centre line, so there is nothing to draw")
    figure = Figure(figsize=(WIDTH_IN, ROW_IN * (len(PANELS) + 1)), dpi=DPI, layout="constrained")
    axes = figure.subplots(len(PANELS) + 1, 1)
    for axis, what in zip(axes, PANELS, strict=False):
        _error_panel(axis, known, what)
    axes[0].set_title(title)
    axes[len(PANELS) - 1].set_xlabel("range to the ramp, m")
    _histogram(axes[-1], known)
    FigureCanvasAgg(figure)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(path, buffer.getvalue())


def _error_panel(axis: Any, scores: Sequence[Score], what: str) -> None:
    words, unit, protected = PANELS[what]
    errors = np.abs([score.figures[f"centre.{what}_{unit}"] for score in scores])
    range_m = [score.range_m for score in scores]
    axis.plot(range_m, np.maximum(errors, LEAST), ".", color=ERROR, markersize=3, label="error")
    bands = {"1-sigma": (f"centre.{what}_sigma_{unit}", SIGMA), "bound": (f"bound.{what}_{unit}", BOUND)}
    if protected is not None:
        bands["protection level"] = (f"protection.{protected}_{unit}", PROTECTION)
    for label, (name, colour) in bands.items():
        at, middle = medians_by_range(scores, name)
        if len(at):
            axis.plot(at, middle, color=colour, label=label)
    axis.set_ylabel(f"{words}, {unit}")
    axis.set_yscale("log")
    axis.grid(visible=True, alpha=0.3)
    axis.legend(loc="lower right", fontsize="small", ncols=4)


def medians_by_range(scores: Sequence[Score], name: str) -> tuple[np.ndarray, np.ndarray]:
    """Middle of each stretch of range that has the figure, m, and the figure's median there."""
    known = np.array([(score.range_m // RANGE_BIN_M, score.figures[name]) for score in scores if name in score.figures])
    bins, values = known.reshape(-1, 2).T
    places = np.unique(bins)
    return (places + 0.5) * RANGE_BIN_M, np.array([np.median(values[bins == place]) for place in places])


def _histogram(axis: Any, scores: Sequence[Score]) -> None:
    for name in STATES:
        figure = f"centre.ratio.{name}"
        values = np.clip([s.figures[figure] for s in scores if figure in s.figures], BINS[0], BINS[-1])
        if len(values):
            axis.hist(values, BINS, density=True, histtype="step", label=name)
    axis.plot(BINS, norm.pdf(BINS), color="black", linewidth=1, label="honest")
    axis.set_xlabel("error over its 1-sigma (beyond 5: in the outermost bins)")
    axis.set_ylabel("density")
    axis.legend(fontsize="small")
