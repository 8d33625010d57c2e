import numpy as np
import pytest

from deckline_lab.evaluation.coverage import coverage_table, flight_interval, two_sided
from deckline_lab.evaluation.integrity_score import FrameState


def state(error: float, range_m: float = 100.0, flagged: bool = False) -> FrameState:
    return FrameState(0.0, False, flagged, error, None, None, None, lateral_sigma_m=2.0, range_m=range_m)


def test_errors_drawn_as_promised_are_covered_as_promised():
    rng = np.random.default_rng(0)
    flights = [[state(2.0 * float(error)) for error in rng.standard_normal(50)] for _ in range(200)]
    table = coverage_table("nominal", flights)
    assert [row[0] for row in table.rows] == ["0 to 150 m", "all"]
    lateral = table.rows[0][table.columns.index("lateral")]
    low, rest = lateral.split(", ", 1)
    assert float(low) == pytest.approx(68, abs=2)
    assert float(rest.split(" ")[0]) == pytest.approx(95, abs=1)
    assert float(lateral.split("; ")[1]) == pytest.approx(1.0, abs=0.05)
    assert table.rows[0][table.columns.index("height")] == "-"


def test_flagged_frames_promise_nothing():
    flights = [[state(0.1), state(99.0, flagged=True)], [state(0.1, range_m=600.0)]]
    table = coverage_table("nominal", flights)
    assert [row[0] for row in table.rows] == ["0 to 150 m", "500 to 1000 m", "all"]
    assert table.rows[-1][1].startswith("100, 100.0 [100, 100], 100.0; 0.0")


def test_frames_of_one_flight_count_as_one_that_is_drawn():
    flights, inside = np.repeat(np.arange(20), 100), np.repeat(np.arange(20) < 10, 100)
    low, high = flight_interval(flights, inside)
    assert (low, high) == (pytest.approx(28, abs=4), pytest.approx(72, abs=4))  # not 48 to 52, as of 2000 draws


def test_quantiles_of_a_normal():
    assert [two_sided(share) for share in (0.68, 0.95, 0.999)] == pytest.approx([0.994, 1.960, 3.291], abs=1e-3)
