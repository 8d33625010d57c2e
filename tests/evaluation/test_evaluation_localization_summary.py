import numpy as np
import pytest

from deckline.evaluation.localization_measure import Score
from deckline.evaluation.localization_summary import (
    MARKS,
    LineRow,
    by_range,
    by_visibility,
    efficiency,
    honesty,
    improvement,
    line_row,
    measured,
    quantiles,
    run_mean,
    unit_measured,
    unit_row,
    unusable_improvement,
    usable_share,
)

# Table 6: errors of direction, degrees, of the lines without dehazing and with it.
PRINTED = {"left": (8.5456, 1.3347), "right": (3.9949, 0.0559)}


LIMITS = {"direction_error_deg": 0.3, "lateral_error_m": 1.0}  # of a frame that is of use


def score(approach=0, range_m=100.0, visibility_m=800.0, **figures) -> Score:
    named = {name.replace("__", "."): value for name, value in figures.items()}
    return Score(approach, 0, "ours", range_m, visibility_m, "fine", named)


def test_means_are_over_approaches_first():
    """An approach with many frames counts like one with few."""
    scores = [score(0, slope__left=1.0)] * 3 + [score(1, slope__left=5.0), score(1)]
    assert run_mean(scores, "slope.left") == pytest.approx(3.0)
    row = line_row(scores, "left")
    assert row.found == pytest.approx(4 / 5)
    assert row.means == {"slope": pytest.approx(3.0)}


def test_the_improvement_of_the_paper_s_own_numbers():
    plain, dehazed = (
        {side: LineRow({"direction_error_deg": errors[k]}, 1.0) for side, errors in PRINTED.items()} for k in (0, 1)
    )
    name = "direction_error_deg"
    assert improvement([dehazed["left"]], [plain["left"]], name) == pytest.approx(0.8438, abs=1e-4)
    assert improvement(list(dehazed.values()), list(plain.values()), name) == pytest.approx(0.8891, abs=1e-4)
    assert np.isnan(improvement([LineRow({}, 0.0)], [plain["left"]], name))


def test_quantiles_are_of_sizes():
    values = np.linspace(-1.0, 1.0, 201)
    found = quantiles([score(x=float(value)) for value in values], ["x"])
    assert (found.p50, found.p95, found.frames) == (pytest.approx(0.5), pytest.approx(0.95, abs=0.01), 201)
    assert np.isnan(quantiles([], ["x"]).p95)


def test_a_mark_looks_at_its_band_and_at_both_lines():
    mark = MARKS[1]
    near = score(range_m=149.0, direction_error_deg__left=0.1, direction_error_deg__right=0.5)
    far = score(range_m=150.0, direction_error_deg__left=9.0)
    assert measured([near, far], mark) == pytest.approx(0.48)
    assert np.isnan(measured([far], mark))


def test_usable_frames_have_both_lines_and_none_is_left_out():
    good = {f"{name}__{side}": value for side in ("left", "right") for name, value in LIMITS.items()}
    wrong = {**good, "direction_error_deg__right": 0.31}
    one = {name: value for name, value in good.items() if name.endswith("left")}
    plain = [score(**good), score(**wrong), score(**one), score()]
    assert usable_share(plain) == pytest.approx(1 / 4)
    assert unusable_improvement([score(**good)] * 9 + [score()], plain) == pytest.approx(1 - 0.1 / 0.75)
    assert np.isnan(unusable_improvement(plain, [score(**good)]))


def test_what_the_unit_alone_gives_is_compared_with_the_same_mark():
    scores = [score(unit__direction_error_deg__left=0.1, unit__direction_error_deg__right=0.5)]
    assert unit_measured(scores, MARKS[1]) == pytest.approx(0.48)
    assert np.isnan(unit_measured(scores, MARKS[3]))


def test_the_unit_alone_has_a_row_of_its_own():
    scores = [score(0, unit__direction_error_deg__left=0.1), score(1, unit__direction_error_deg__left=0.3), score(1)]
    assert unit_row(scores, "left") == LineRow({"direction_error_deg": pytest.approx(0.2)}, 1.0)
    assert unit_row(scores, "right").means == {}


def test_bands():
    scores = [score(range_m=r, visibility_m=v) for r, v in ((50, 600), (149.9, 1500), (150, 1500), (900, np.inf))]
    assert {name: len(members) for name, members in by_range(scores).items()} == {
        "0 to 150 m": 2,
        "150 to 300 m": 1,
        "500 to 1000 m": 1,
    }
    assert list(by_visibility(scores)) == ["500 to 1000 m", "1000 to 2000 m", "2000 m and more"]


def test_honest_covariances_give_three_and_ninety_five_percent():
    rng = np.random.default_rng(0)
    scores = [score(k % 20, normalised=float(value)) for k, value in enumerate(rng.chisquare(3, 4000))]
    found = honesty(scores, "normalised", rng)
    assert found.low < 3.0 < found.high
    assert found.high - found.low < 0.4
    assert found.inside == pytest.approx(0.95, abs=0.012)
    boastful = honesty([score(k, normalised=12.0) for k in range(3)], "normalised", rng)
    assert (boastful.mean, boastful.low, boastful.inside) == (12.0, 12.0, 0.0)


def test_frames_of_one_approach_do_not_narrow_the_interval():
    shared = np.random.default_rng(1).chisquare(3, 10)
    few, many = (
        honesty(
            [score(k, n=float(v)) for k, v in enumerate(shared) for _ in range(count)], "n", np.random.default_rng(2)
        )
        for count in (1, 50)
    )
    assert many.high - many.low == pytest.approx(few.high - few.low, rel=1e-9)
    assert np.isnan(honesty([score(0, n=1.0)] * 9, "n", np.random.default_rng(0)).low)


def test_efficiency_is_the_bound_over_the_mean_square():
    rng = np.random.default_rng(3)
    scores = [score(e=float(2.0 * rng.normal()), b=1.0) for _ in range(4000)] + [score(e=99.0)]
    value, frames = efficiency(scores, "e", "b")
    assert frames == 4000
    assert value == pytest.approx(0.25, rel=0.1)
    assert efficiency([], "e", "b")[1] == 0


def test_no_scores_are_refused():
    with pytest.raises(ValueError, match="no frame"):
        line_row([], "left")
    with pytest.raises(ValueError, match="no frame could be evaluated"):
        usable_share([])
