"""Are stated 1-sigmas true? The share of errors that lie within the intervals they promise, by range."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from deckline.report.bands import by_band
from deckline_lab.evaluation.integrity_score import FrameState
from deckline_lab.evaluation.tables import MISSING, Table
from deckline_lab.statistics import APPROACH_RANGE_M, resample_runs

PROMISED = (0.68, 0.95, 0.999)  # shares of errors within an interval of a normal
QUANTITIES = {  # error and 1-sigma, by what people call them
    "lateral": ("lateral_m", "lateral_sigma_m"),
    "height": ("height_m", "height_sigma_m"),
    "heading": ("heading_deg", "heading_sigma_deg"),
    "distance": ("distance_m", "distance_sigma_m"),
}
Flights = Sequence[Sequence[FrameState]]


def coverage_table(name: str, flights: Flights) -> Table:
    """How many errors of unflagged frames lie within the intervals of 68, 95 and 99.9 %; at 95 % with its interval.

    The interval is a bootstrap over flights, as frames of one flight err together.
    """
    numbered = [(number, frame) for number, flight in enumerate(flights) for frame in flight if not frame.flagged]
    known = [(number, frame, frame.range_m) for number, frame in numbered if frame.range_m is not None]
    bands = by_band(known, lambda item: item[2], APPROACH_RANGE_M)
    rows = []
    for band, items in {**bands, "all": known}.items():
        frames = [(number, frame) for number, frame, _ in items]
        rows.append((band, *(_cell(frames, *fields) for fields in QUANTITIES.values())))
    title = (
        f"{name}, {len(flights)} flights: errors within 68, 95 [by flight] and 99.9 % intervals, %; how wide 95 % is"
    )
    return Table(title, ("range", *QUANTITIES), rows)


def _cell(frames: Sequence[tuple[int, FrameState]], error: str, sigma: str) -> str:
    pairs = [(number, getattr(frame, error), getattr(frame, sigma)) for number, frame in frames]
    known = [(number, abs(e) / s) for number, e, s in pairs if e is not None and s]
    if not known:
        return MISSING
    flights, ratios = np.array([number for number, _ in known]), np.array([ratio for _, ratio in known])
    inside = [100 * float(np.mean(ratios <= two_sided(share))) for share in PROMISED]
    low, high = flight_interval(flights, ratios <= two_sided(0.95))
    width = float(np.quantile(ratios, 0.95)) / two_sided(0.95)
    return f"{inside[0]:.0f}, {inside[1]:.1f} [{low:.0f}, {high:.0f}], {inside[2]:.1f}; {width:.2f}"


def two_sided(share: float) -> float:
    """Standard deviations of a normal within which this share lies."""
    return float(norm.isf((1 - share) / 2))


def flight_interval(flights: NDArray[np.int64], inside: NDArray[np.bool_]) -> tuple[float, float]:
    """95 % percentile bootstrap interval, %, of the share of frames (N,) that are inside, drawn flight by flight."""
    _, index = np.unique(flights, return_inverse=True)
    hits = np.bincount(index, inside).astype(np.float64)
    low, high = resample_runs(hits, np.bincount(index), np.random.default_rng(0))
    return 100 * low, 100 * high
