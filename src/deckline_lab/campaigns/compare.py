"""Whether two ways to see agree: errors and statuses of looks, by distance."""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import ks_2samp

from deckline.types import Status
from deckline_lab.evaluation.tables import MISSING, Table
from deckline_lab.statistics import share_interval
from deckline_sim.landing.surroundings import Surroundings

Array = NDArray[np.float64]
Flights = Sequence[tuple[Surroundings, Sequence[Mapping[str, Any]]]]
BANDS_M = (0.0, 100.0, 250.0, 500.0, 800.0, 1500.0)  # distance to the ramp
DEPTH_BANDS = (0.0, 0.5, 0.8, 1.0, 1.2, 1.5)  # distance in visibilities
THIN_S = 1.0  # between looks that are compared: nearer ones err alike
LEAST = 8  # looks on either side
GUIDED = (Status.OK, Status.UNVERIFIED, Status.ONE_LINE, Status.COASTING)


def error_table(first: Flights, second: Flights, names: tuple[str, str], quantities: Sequence[str]) -> Table:
    """Quartile range and 95th percentile of errors of `ok` looks, and the two-sample Kolmogorov-Smirnov test."""
    rows = []
    for quantity in quantities:
        for low, high in itertools.pairwise(BANDS_M):
            both = [thinned_errors(flights, quantity, low, high) for flights in (first, second)]
            if min(map(len, both)) < LEAST:
                continue
            test = ks_2samp(*both)
            sizes = [str(len(errors)) for errors in both]
            shares = [f"{np.percentile(np.abs(errors), p):.2f}" for p in (50, 95) for errors in both]
            distance = f"{low:g} to {high:g} m"
            rows.append((quantity, distance, *sizes, *shares, f"{test.statistic:.2f}", f"{test.pvalue:.3f}"))
    columns = [f"{what}, {name}" for what in ("looks", "median, m", "95 %, m") for name in names]
    return Table(
        f"errors of ok guidance, looks {THIN_S:g} s apart", ("error", "distance", *columns, "KS distance", "p"), rows
    )


def thinned_errors(flights: Flights, quantity: str, low_m: float, high_m: float) -> Array:
    """Errors of `ok` looks between two distances, at least `THIN_S` apart in each flight."""
    values = []
    for _, looks in flights:
        last_s = -np.inf
        for look in looks:
            error = look["errors"].get(quantity)
            is_there = low_m <= look["range_m"] < high_m and look["status"] == Status.OK and error is not None
            if is_there and look["time_s"] - last_s >= THIN_S:
                values.append(error[0])
                last_s = look["time_s"]
    return np.array(values)


def status_table(first: Flights, second: Flights, names: tuple[str, str]) -> Table:
    """Shares of statuses by distance in visibilities.

    The 95 % intervals take looks as independent; those of one flight are not, and the intervals are too narrow.
    """
    rows = []
    for low, high in itertools.pairwise(DEPTH_BANDS):
        cells = []
        for flights in (first, second):
            statuses = [
                look["status"]
                for scene, looks in flights
                for look in looks
                if low <= look["range_m"] / scene.config.visibility_m < high
            ]
            cells += [str(len(statuses)), *(share_text(statuses, known) for known in ((Status.OK,), GUIDED))]
        rows.append((f"{low:g} to {high:g}", *cells))
    columns = [f"{what}, {name}" for name in names for what in ("looks", "ok, %", "guided, %")]
    return Table("status by distance in visibilities", ("distance", *columns), rows)


def share_text(statuses: Sequence[str], known: Sequence[Status]) -> str:
    """Share of looks with one of these statuses and its interval, percent."""
    if not statuses:
        return MISSING
    hits = sum(status in known for status in statuses)
    low, high = share_interval(hits, len(statuses))
    return f"{100 * hits / len(statuses):.0f} [{100 * low:.0f}, {100 * high:.0f}]"
