from dataclasses import replace

import numpy as np
import pytest

from deckline.config import RunConfig
from deckline_lab.evaluation.localization_methods import point_methods
from deckline_lab.evaluation.localization_score import Score
from deckline_lab.evaluation.localization_tables import (
    MARKS,
    USABLE,
    by_range,
    by_visibility,
    efficiency,
    flat_figures,
    found_share,
    improvement,
    line_means,
    localization_tables,
    measure_mark,
    misleads,
    run_mean,
    sizes,
    unusable_improvement,
    usable_share,
)
from deckline_lab.evaluation.pictures import medians_by_range, write_figure
from deckline_lab.statistics import percentile

# Table 6: errors of direction, degrees, of the lines without dehazing and with it.
PRINTED = {"left": (8.5456, 1.3347), "right": (3.9949, 0.0559)}


def score(approach=0, range_m=100.0, visibility_m=800.0, **figures) -> Score:
    named = {name.replace("__", "."): value for name, value in figures.items()}
    return Score(approach, 0, "ours", range_m, visibility_m, "fine", named)


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


def test_quantiles_are_of_sizes():
    values = np.linspace(-1.0, 1.0, 201)
    found = sizes([score(x=float(value)) for value in values], "x")
    assert (percentile(found, 50.0), percentile(found, 95.0)) == (pytest.approx(0.5), pytest.approx(0.95, abs=0.01))
    assert np.isnan(percentile(sizes([], "x"), 95.0))


def test_a_mark_looks_at_its_band_and_at_both_lines():
    mark = MARKS[1]
    near = score(range_m=149.0, direction_error_deg__left=0.1, direction_error_deg__right=0.5)
    far = score(range_m=150.0, direction_error_deg__left=9.0)
    assert measure_mark([near, far], mark) == pytest.approx(0.48)
    assert np.isnan(measure_mark([far], mark))


def test_usable_frames_have_both_lines_and_none_is_left_out():
    good = {f"{name}__{side}": value for side in ("left", "right") for name, value in USABLE.items()}
    wrong = {**good, "direction_error_deg__right": 0.31}
    one = {name: value for name, value in good.items() if name.endswith("left")}
    plain = [score(**good), score(**wrong), score(**one), score()]
    assert usable_share(plain) == pytest.approx(1 / 4)
    assert unusable_improvement([score(**good)] * 9 + [score()], plain) == pytest.approx(1 - 0.1 / 0.75)
    assert np.isnan(unusable_improvement(plain, [score(**good)]))


def test_the_unit_alone_has_a_row_of_its_own():
    scores = [score(0, unit__direction_error_deg__left=0.1), score(1, unit__direction_error_deg__left=0.3), score(1)]
    assert line_means(scores, "left", "unit.") == {"direction_error_deg": pytest.approx(0.2)}
    assert line_means(scores, "right", "unit.") == {}


def test_bands():
    scores = [score(range_m=r, visibility_m=v) for r, v in ((50, 600), (149.9, 1500), (150, 1500), (900, np.inf))]
    counts = {name: len(members) for name, members in by_range(scores).items()}
    assert counts == {"0 to 150 m": 2, "150 to 300 m": 1, "500 to 1000 m": 1}
    assert list(by_visibility(scores)) == ["500 to 1000 m", "1000 to 2000 m", "2000 m and more"]


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


def frame(method: str, approach: int, index: int, scale: float) -> Score:
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
    return Score(approach, index, method, 100.0 + 100.0 * index, 800.0, mode, figures)


def all_scores(scales=(10.0, 1.0, 1.0)) -> dict[str, list[Score]]:
    named = {
        method.name: [frame(method.name, k, index, scale) for k in range(2) for index in range(3)]
        for method, scale in zip(METHODS, scales, strict=True)
    }
    levels = {"protection.lateral_m": 0.5, "protection.height_m": 0.4, "flagged": 0.0}
    named["ours, tracked"] = [replace(one, figures=one.figures | levels) for one in named["ours, tracked"]]
    named["ours"] = [replace(one, figures=one.figures | {"bound.lateral_m": 0.005}) for one in named["ours"]]
    return named


def cells(title: str, given=None) -> list[dict[str, str]]:
    table = next(t for t in localization_tables(given or all_scores(), METHODS) if t.title.startswith(title))
    return [dict(zip(table.columns, row, strict=True)) for row in table.rows]


def test_table_6_begins_with_the_truth():
    rows = cells("Table 6")
    assert [(row["method"], row["line"]) for row in rows[:2]] == [("true", "left"), ("true", "right")]
    assert (rows[2]["method"], rows[2]["line"]) == ("paper's", "left")
    assert (rows[0]["slope"], rows[0]["intercept, m"], rows[0]["direction off, deg"]) == ("-0.16300", "35.789", "-")
    assert (rows[2]["direction off, deg"], rows[2]["found %"]) == ("0.1000", "100.0")


def test_the_improvement_is_over_the_first_row():
    rows = {row["method"]: row for row in cells("improvement over paper's")}
    assert rows["paper's"]["direction both"] == "0.0"
    assert rows["ours"]["direction both"] == rows["ours"]["intercept left"] == "90.0"
    assert rows["unit alone"]["direction both"] == "-"
    given = all_scores()
    for one in given["paper's"]:
        one.figures.update({"unit.direction_error_deg.left": 0.004, "unit.direction_error_deg.right": 0.002})
    alone = next(row for row in cells("improvement", given) if row["method"] == "unit alone")
    assert [alone[f"direction {which}"] for which in ("left", "right", "both")] == ["96.0", "98.0", "97.0"]


def test_frames_without_a_line_lower_the_found_share_alone():
    given = all_scores()
    given["ours"] = given["ours"][:3] + [replace(one, figures=dict(TRUE), mode="none") for one in given["ours"][3:]]
    row = next(row for row in cells("Table 6", given) if row["method"] == "ours")
    assert (row["found %"], row["direction off, deg"]) == ("50.0", "0.0100")
    pilot = next(row for row in cells("pilot, all frames", given) if row[""] == "ours")
    assert (pilot["given %"], pilot["fine %"], pilot["lateral 95 %, m"]) == ("50.0", "17", "0.010")


def test_marks_are_starred_where_reached():
    rows = cells("accuracy asked for")
    direction = next(row for row in rows if row["error"] == "direction, median" and row["range"] == "0-150 m")
    assert (direction["paper's"], direction["ours"]) == ("0.100 *", "0.010 *")
    wide = cells("accuracy asked for", all_scores((20.0, 1.0, 1.0)))
    assert wide[0]["paper's"] == "0.200"


def test_frames_without_a_line_are_of_no_use():
    given = all_scores()
    given["paper's"] = [
        replace(one, figures=dict(TRUE) if k < 4 else one.figures) for k, one in enumerate(given["paper's"])
    ]
    given["ours"] = [*given["ours"][:5], replace(given["ours"][5], figures=dict(TRUE))]
    rows = {row["method"]: row for row in cells("both lines within 0.3 deg and 1 m", given)}
    assert [row["usable %"] for row in rows.values()] == ["33.3", "83.3", "100.0"]
    assert rows["ours"]["fewer not usable than paper's, %"] == "75.0"
    assert flat_figures(given)["ours.improvement.not_usable"] == pytest.approx(0.75)


def test_the_unit_alone_stands_beside_the_marks():
    given = all_scores()
    given["paper's"] = [
        replace(one, figures=one.figures | {"unit.lateral_error_m.left": 0.35}) for one in given["paper's"]
    ]
    alone = {(row["error"], row["range"]): row["unit alone"] for row in cells("accuracy asked for", given)}
    assert alone["lateral at the ramp, 95 %", "150-800 m"] == "0.350 *"
    assert alone["lateral at the ramp, 95 %", "0-150 m"] == "0.350"
    assert alone["height, 95 %", "0-150 m"] == "-"


def test_consistency_of_the_centre_line_by_mode():
    rows = [row for row in cells("consistency") if row["method"] == "ours"]
    assert [(row["line"], row["frames"], row["mean, 3 is expected"][:4]) for row in rows] == [
        ("left", "6", "3.00"),
        ("right", "6", "3.00"),
        ("centre, from the aircraft", "6", "2.50"),
        ("centre, from the aircraft, fine", "2", "2.50"),
        ("centre, from the aircraft, coarse", "4", "2.50"),
    ]


def test_efficiency_is_of_the_untracked_joint_method():
    rows = cells("efficiency, ours")
    assert [row["lateral"] for row in rows] == ["0.25", "0.25", "0.25"]
    assert rows[0]["heading"] == "-"


def test_protection_counts_what_misled():
    given = all_scores((10.0, 1.0, 1.0))
    first = given["ours, tracked"][0].figures
    first["centre.deviation_m"] = -0.6
    (row,) = cells("protection", given)
    assert (row["frames"], row["protected"], row["misleading"], row["lateral level, m"]) == ("6", "6", "1", "0.50")
    assert not misleads(first | {"flagged": 1.0})
    assert not misleads({"centre.height_m": 9.0, "protection.lateral_m": 1.0})
    first["flagged"] = 1.0
    (row,) = cells("protection", given)
    assert (row["flagged"], row["misleading"]) == ("1", "0")


def test_the_numbers_are_the_tables():
    figures = flat_figures(all_scores())
    assert figures["ours.improvement.direction"] == pytest.approx(0.9)
    assert figures["ours.direction_error_deg.left"] == pytest.approx(0.01)
    assert figures["ours.pilot.150 to 300 m.lateral_m.p95"] == pytest.approx(0.01)
    assert figures["ours.honesty.mean"] == pytest.approx(2.5)


def test_pictures_are_drawn(tmp_path):
    path = tmp_path / "figures" / "ours.png"
    write_figure(path, "ours", all_scores()["ours, tracked"])
    assert path.read_bytes()[:4] == b"\x89PNG"
    at, middle = medians_by_range(all_scores()["ours, tracked"], "protection.lateral_m")
    np.testing.assert_allclose(at, [125.0, 225.0, 325.0])
    np.testing.assert_allclose(middle, 0.5)
    with pytest.raises(ValueError, match="nothing to draw"):
        write_figure(path, "ours", [])
