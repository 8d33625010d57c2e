from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from deckline.config import RunConfig
from deckline.types import SIDES
from deckline_lab.evaluation.localization_methods import point_methods
from deckline_lab.evaluation.localization_requirements import REQUIREMENTS, measure_required
from deckline_lab.evaluation.localization_score import LocalizationScore
from deckline_lab.evaluation.localization_tables import (
    GAINS_NOTE,
    IMPROVEMENT_NOTE,
    LINES_NOTE,
    USABLE,
    dehazing_gains,
    detector_gains,
    efficiency,
    flat_figures,
    found_share,
    improvement,
    line_means,
    localization_tables,
    run_mean,
    unusable_improvement,
    usable_share,
    visible_figures,
)
from deckline_lab.evaluation.pictures import medians_by_range, write_figure
from golden import check_golden

GOLDEN = Path(__file__).parent / "golden"
# Table 6: errors of direction, degrees, of the lines without dehazing and with it.
PRINTED = {"left": (8.5456, 1.3347), "right": (3.9949, 0.0559)}


def score(approach=0, range_m=100.0, visibility_m=800.0, **figures) -> LocalizationScore:
    named = {name.replace("__", "."): value for name, value in figures.items()}
    return LocalizationScore(approach, 0, "ours", range_m, visibility_m, "fine", named)


def test_means_are_over_approaches_first():
    """An approach with many frames counts like one with few."""
    scores = [score(0, slope__left=1.0)] * 3 + [score(1, slope__left=5.0), score(1)]
    assert run_mean(scores, "slope.left") == pytest.approx(3.0)
    assert found_share(scores, "left") == pytest.approx(4 / 5)
    assert line_means(scores, "left") == {"slope": pytest.approx(3.0)}


def test_the_improvement_of_the_paper_s_own_numbers():
    plain, dehazed = ({side: {"direction_error_deg": errors[k]} for side, errors in PRINTED.items()} for k in (0, 1))
    name = "direction_error_deg"
    assert improvement([dehazed["left"]], [plain["left"]], name) == pytest.approx(0.8438, abs=1e-4)
    assert improvement(list(dehazed.values()), list(plain.values()), name) == pytest.approx(0.8891, abs=1e-4)
    assert np.isnan(improvement([{}], [plain["left"]], name))


def test_a_requirement_counts_both_lines_in_its_band():
    required = REQUIREMENTS[1]
    near = score(range_m=149.0, direction_error_deg__left=0.1, direction_error_deg__right=0.5)
    far = score(range_m=150.0, direction_error_deg__left=9.0)
    assert measure_required([near, far], required) == pytest.approx(0.48)
    assert np.isnan(measure_required([far], required))


def test_usable_frames_have_both_lines_and_none_is_left_out():
    good = {f"{name}__{side}": value for side in ("left", "right") for name, value in USABLE.items()}
    wrong = {**good, "direction_error_deg__right": 0.31}
    one = {name: value for name, value in good.items() if name.endswith("left")}
    plain = [score(**good), score(**wrong), score(**one), score()]
    assert usable_share(plain) == pytest.approx(1 / 4)
    assert unusable_improvement([score(**good)] * 9 + [score()], plain) == pytest.approx(1 - 0.1 / 0.75)
    assert np.isnan(unusable_improvement(plain, [score(**good)]))


def errors_seen(errors):
    """Scores of a method's frames, an approach each, by its errors of direction; None: no line."""

    def seen(method, index, error):
        figures = {f"slope.{side}": 0.0 for side in SIDES if error is not None}
        figures |= {f"direction_error_deg.{side}": error for side in SIDES if error is not None}
        figures |= {f"intercept_error_m.{side}": 2.0 for side in SIDES if error is not None}
        return LocalizationScore(index, 0, method, 100.0, 800.0, "coarse", figures)

    return {name: [seen(name, k, each) for k, each in enumerate(values)] for name, values in errors.items()}


def test_dehazing_is_counted_where_both_rows_have_both_lines():
    errors = {"a, hazy, x": (0.4, 0.2, None, 9.0), "a, dehazed, x": (0.1, 0.2, 0.3, None), "b, hazy": (1.0,) * 4}
    (row,) = dehazing_gains(errors_seen(errors)).rows
    assert row[:3] == ("a, x", "75.0", "75.0")
    assert row[3:5] == ("0.3000", "0.1500") and row[5].startswith("-0.1500 [") and row[6] == "50.0"
    assert row[7:9] == ("2.000", "2.000") and row[10] == "0.0"


def test_detectors_are_compared_where_both_have_both_lines():
    """Over their own frames both have the same mean; on the two frames of both b has half of a's."""
    errors = {"a, hazy, paper's": (0.4, 0.2, None, None), "b, hazy, paper's": (0.2, 0.1, 0.3, 0.6)}
    others = {"b, hazy, paper's, exact pose": (0.1,) * 4, "b, dehazed, paper's": (0.1,) * 4}
    table = detector_gains(errors_seen(errors | others))
    ((name, shared, first, here, change, better, *intercept),) = table.rows
    assert (name, shared, first, here, better) == ("b, hazy, paper's", "50.0", "0.3000", "0.1500", "50.0")
    assert change.startswith("-0.1500 [") and intercept[:2] == ["2.000", "2.000"]
    assert len(table.columns) == 10 and table.title.endswith("a, hazy, paper's")
    assert detector_gains(errors_seen(others)).rows == []


def test_efficiency_is_the_bound_over_the_mean_square():
    rng = np.random.default_rng(3)
    scores = [score(e=float(2.0 * rng.normal()), b=1.0) for _ in range(4000)] + [score(e=99.0)]
    value, frames = efficiency(scores, "e", "b")
    assert frames == 4000
    assert value == pytest.approx(0.25, rel=0.1)
    assert efficiency([], "e", "b")[1] == 0


METHODS = point_methods(RunConfig())
TRUE = {"true_slope.left": -0.163, "true_intercept_m.left": 35.788523, "true_height_m.left": 6.08}
TRUE |= {"true_slope.right": -0.15632, "true_intercept_m.right": 20.889669, "true_height_m.right": 6.08}


def frame(method: str, approach: int, index: int, scale: float) -> LocalizationScore:
    """Every error is `scale` times that of a hundredth."""
    figures = dict(TRUE)
    for side in ("left", "right"):
        values = {"slope": -0.16, "intercept_m": 30.0, "height_m": 6.0, "slope_error": 0.01 * scale}
        values |= {name: 0.01 * scale for name in ("intercept_error_m", "height_error_m", "direction_error_deg")}
        values |= {"lateral_error_m": 0.01 * scale, "normalised": 3.0}
        figures |= {f"{name}.{side}": value for name, value in values.items()}
    centre = {"lateral_m": 0.01 * scale, "deviation_m": -0.02 * scale, "height_m": -0.01 * scale}
    centre |= {"heading_deg": 0.01 * scale, "lateral_sigma_m": 0.02, "deviation_sigma_m": 0.02, "height_sigma_m": 0.02}
    centre |= {"heading_sigma_deg": 0.02, "normalised": 2.5, "ratio.offset": 0.5, "ratio.azimuth": 0.2}
    figures |= {f"centre.{name}": value for name, value in centre.items()}
    mode = "fine" if index == 0 else "coarse"
    return LocalizationScore(approach, index, method, 100.0 + 100.0 * index, 800.0, mode, figures)


def all_scores() -> dict[str, list[LocalizationScore]]:
    named = {
        method.name: [frame(method.name, k, index, scale) for k in range(2) for index in range(3)]
        for method, scale in zip(METHODS, (10.0, 1.0, 1.0), strict=True)
    }
    levels = {"protection.lateral_m": 0.5, "protection.height_m": 0.4, "flagged": 0.0}
    named["ours, tracked"] = [replace(one, figures=one.figures | levels) for one in named["ours, tracked"]]
    named["ours"] = [replace(one, figures=one.figures | {"bound.lateral_m": 0.005}) for one in named["ours"]]
    return named


def mixed_scores() -> dict[str, list[LocalizationScore]]:
    """Frames without a line, errors of the navigation unit alone, a flag, and a frame that misleads."""
    given = all_scores()
    unit = {"unit.direction_error_deg.left": 0.004, "unit.direction_error_deg.right": 0.002}
    for one in given["paper's"]:
        one.figures.update(unit | {"unit.lateral_error_m.left": 0.35})
    given["ours"] = given["ours"][:3] + [replace(one, figures=dict(TRUE), mode="none") for one in given["ours"][3:]]
    given["paper's"][:2] = [replace(one, figures=TRUE | unit) for one in given["paper's"][:2]]
    given["ours, tracked"][0].figures["centre.deviation_m"] = -0.6
    given["ours, tracked"][1].figures["flagged"] = 1.0
    return given


@pytest.mark.parametrize(("name", "scores"), [("plain", all_scores()), ("mixed", mixed_scores())])
def test_tables_and_figures_of_known_scores(name, scores):
    results = {"tables": localization_tables(scores, METHODS), "figures": flat_figures(scores)}
    check_golden(GOLDEN / f"localization_{name}.json", results)


def test_every_note_explains_the_table_that_it_stands_under():
    tables = localization_tables(all_scores(), METHODS)
    notes = [note for table in tables for note in table.notes]
    assert len(set(notes)) == len(notes)
    assert [list(table.notes) for table in tables[:2]] == [[LINES_NOTE], [IMPROVEMENT_NOTE]]
    assert GAINS_NOTE not in notes  # no row has a dehazed picture
    assert list(dehazing_gains({}).notes) == [GAINS_NOTE]
    assert [list(table.notes) for table in tables if table.title == "protection"] == [[]]


def test_pictures_are_drawn(tmp_path):
    path = tmp_path / "figures" / "ours.png"
    write_figure(path, "ours", all_scores()["ours, tracked"])
    assert path.read_bytes()[:4] == b"\x89PNG"
    at, middle = medians_by_range(all_scores()["ours, tracked"], "protection.lateral_m")
    np.testing.assert_allclose(at, [125.0, 225.0, 325.0])
    np.testing.assert_allclose(middle, 0.5)
    with pytest.raises(ValueError, match=r"^ours: "):
        write_figure(path, "ours", [])


def test_each_method_has_the_range_from_which_it_holds_both_lines():
    def flown(approach: int, right_from_m: float) -> list[LocalizationScore]:
        return [
            LocalizationScore(
                approach, k, "ours", m, 1000.0, "coarse", {"time_s": k / 4, "is_right": float(m <= right_from_m)}
            )
            for k, m in enumerate(800.0 - 15.0 * np.arange(50))
        ]

    figures = visible_figures([*flown(0, 500.0), *flown(1, 350.0)])
    assert figures["approaches"] == 2
    assert (figures["first_held_m.50"], figures["first_held_m.90"]) == (500.0, 350.0)
    assert figures["first_held_of_visibility.90"] == 350.0 / 800.0
    assert visible_figures([replace(score, figures={}) for score in flown(0, 500.0)]) == {}
