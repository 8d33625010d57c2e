"""What a pass of each detector's network costs: parameters, multiply-accumulates, time."""

import time
from collections.abc import Mapping
from statistics import median

import numpy as np

from deckline.detect import Detector, OnnxDetector
from deckline_lab.evaluation.tables import Columns, Figures, Table, cells

COLUMNS: Columns = {
    "parameters, M": ("parameters", 1e-6, ".2f"),
    "MACs, G": ("macs", 1e-9, ".2f"),
    "ms": ("pass_ms", 1.0, ".1f"),
}
SIZES = ("parameters", "macs")  # as `deckline train` stores them in a file
RUNS = 9  # timed of each, interleaved, after one that is not


def measure_costs(detectors: Mapping[str, Detector], runs: int = RUNS) -> dict[str, dict[str, float]]:
    """Figures of every detector that has a network, by name: parameters, macs, pass_ms (median, on this machine).

    A file without stored sizes has no parameters and no macs.
    """
    networks = {name: one for name, one in detectors.items() if isinstance(one, OnnxDetector)}
    times: dict[str, list[float]] = {name: [] for name in networks}
    for _ in range(1 + runs):
        for name, detector in networks.items():
            view = np.zeros((3, detector.config.grid.height, detector.config.grid.width), np.float32)
            start = time.perf_counter()
            detector.infer(view)
            times[name].append(time.perf_counter() - start)
    costs = {}
    for name, detector in networks.items():
        stored = {key: float(detector.session.config[key]) for key in SIZES if key in detector.session.config}
        costs[name] = {**stored, "pass_ms": 1e3 * median(times[name][1:])}
    return costs


def cost_table(costs: Mapping[str, Figures]) -> Table:
    """A row a detector."""
    rows = [(name, *cells(figures, COLUMNS)) for name, figures in costs.items()]
    return Table("one pass of the network", ("detector", *COLUMNS), rows)
