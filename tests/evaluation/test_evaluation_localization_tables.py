import numpy as np
import pytest

from deckline.evaluation.localization_figures import medians_by_range, write_figure
from deckline.evaluation.localization_measure import Score
from deckline.evaluation.localization_methods import Method
from deckline.evaluation.localization_tables import flat_figures, localization_tables, misleading

METHODS = [
    Method("ufld, hazy, paper's", "none", "ufld", "paper"),
    Method("ours", "none", "ufld", "joint"),
    Method("ours, tracked", "none", "ufld", "joint", tracked=True),
]
TRUE = {"true_slope.left": -0.163, "true_intercept_m.left": 35.788523, "true_height_m.left": 6.08}
TRUE |= {"true_slope.right": -0.15632, "true_intercept_m.right": 20.889669, "true_height_m.right": 6.08}


def frame(method: str, approach: int, index: int, scale: float, **more) -> Score:
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
    return Score(
        approach, index, method, 100.0 + 100.0 * index, 800.0, "fine" if index == 0 else "coarse", figures | more
    )


def scores(scales=(10.0, 1.0, 1.0)) -> dict[str, list[Score]]:
    named = {
        method.name: [frame(method.name, k, index, scale) for k in range(2) for index in range(3)]
        for method, scale in zip(METHODS, scales, strict=True)
    }
    levels = {"protection.lateral_m": 0.5, "protection.height_m": 0.4, "flagged": 0.0}
    named["ours, tracked"] = [
        Score(**(vars(score) | {"figures": score.figures | levels})) for score in named["ours, tracked"]
    ]
    named["ours"] = [
        Score(**(vars(score) | {"figures": score.figures | {"bound.lateral_m": 0.005}})) for score in named["ours"]
    ]
    return named


def cells(title: str, given=None) -> list[dict[str, str]]:
    table = next(t for t in localization_tables(given or scores(), METHODS) if t.title.startswith(title))
    return [dict(zip(table.columns, row, strict=True)) for row in table.rows]


def test_table_6_begins_with_the_truth():
    rows = cells("Table 6")
    assert [(row["method"], row["line"]) for row in rows[:3]] == [
        ("true", "left"),
        ("true", "right"),
        ("ufld, hazy, paper's", "left"),
    ]
    assert (rows[0]["slope"], rows[0]["intercept, m"], rows[0]["direction off, deg"]) == ("-0.16300", "35.789", "-")
    assert (rows[2]["direction off, deg"], rows[2]["found %"]) == ("0.1000", "100.0")


def test_the_improvement_is_over_the_first_row():
    rows = {row["method"]: row for row in cells("improvement over ufld, hazy, paper's")}
    assert rows["ufld, hazy, paper's"]["direction both"] == "0.0"
    assert rows["ours"]["direction both"] == rows["ours"]["intercept left"] == "90.0"
    assert rows["unit alone"]["direction both"] == "-"
    given = scores()
    for score in given["ufld, hazy, paper's"]:
        score.figures.update({"unit.direction_error_deg.left": 0.004, "unit.direction_error_deg.right": 0.002})
    alone = next(row for row in cells("improvement", given) if row["method"] == "unit alone")
    assert [alone[f"direction {which}"] for which in ("left", "right", "both")] == ["96.0", "98.0", "97.0"]


def test_frames_without_a_line_lower_the_found_share_alone():
    given = scores()
    given["ours"] = given["ours"][:3] + [
        Score(**(vars(score) | {"figures": dict(TRUE), "mode": "none"})) for score in given["ours"][3:]
    ]
    row = next(row for row in cells("Table 6", given) if row["method"] == "ours")
    assert (row["found %"], row["direction off, deg"]) == ("50.0", "0.0100")
    pilot = next(row for row in cells("pilot, all frames", given) if row[""] == "ours")
    assert (pilot["given %"], pilot["fine %"], pilot["lateral 95 %, m"]) == ("50.0", "17", "0.010")


def test_marks_are_starred_where_reached():
    rows = cells("accuracy asked for")
    direction = next(row for row in rows if row["error"] == "direction, median" and row["range"] == "0-150 m")
    assert (direction["ufld, hazy, paper's"], direction["ours"]) == ("0.100 *", "0.010 *")
    wide = cells("accuracy asked for", scores((20.0, 1.0, 1.0)))
    assert wide[0]["ufld, hazy, paper's"] == "0.200"


def test_frames_without_a_line_are_of_no_use():
    given = scores()
    given["ufld, hazy, paper's"] = [
        Score(**(vars(score) | {"figures": dict(TRUE) if k < 4 else score.figures}))
        for k, score in enumerate(given["ufld, hazy, paper's"])
    ]
    given["ours"] = [*given["ours"][:5], Score(**(vars(given["ours"][5]) | {"figures": dict(TRUE)}))]
    rows = {row["method"]: row for row in cells("both lines within 0.3 deg and 1 m", given)}
    assert [row["usable %"] for row in rows.values()] == ["33.3", "83.3", "100.0"]
    assert rows["ours"]["fewer not usable than ufld, hazy, paper's, %"] == "75.0"
    assert flat_figures(given)["ours.improvement.not_usable"] == pytest.approx(0.75)


def test_the_unit_alone_stands_beside_the_marks():
    given = scores()
    given["ufld, hazy, paper's"] = [
        Score(**(vars(score) | {"figures": score.figures | {"unit.lateral_error_m.left": 0.35}}))
        for score in given["ufld, hazy, paper's"]
    ]
    alone = {(row["error"], row["range"]): row["unit alone"] for row in cells("accuracy asked for", given)}
    assert alone["lateral at the ramp, 95 %", "150-800 m"] == "0.350 *"
    assert alone["lateral at the ramp, 95 %", "0-150 m"] == "0.350"
    assert alone["height, 95 %", "0-150 m"] == "-"


def test_honesty_of_the_centre_line_is_told_by_mode():
    rows = [row for row in cells("honesty") if row["method"] == "ours"]
    assert [(row["line"], row["frames"], row["mean, 3 is honest"][:4]) for row in rows] == [
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
    given = scores((10.0, 1.0, 1.0))
    first = given["ours, tracked"][0].figures
    first["centre.deviation_m"] = -0.6
    (row,) = cells("protection", given)
    assert (row["frames"], row["protected"], row["misleading"], row["lateral level, m"]) == ("6", "6", "1", "0.50")
    assert not misleading(first | {"flagged": 1.0})
    assert not misleading({"centre.height_m": 9.0, "protection.lateral_m": 1.0})
    first["flagged"] = 1.0
    (row,) = cells("protection", given)
    assert (row["flagged"], row["misleading"]) == ("1", "0")


def test_the_numbers_are_the_tables():
    figures = flat_figures(scores())
    assert figures["ours.improvement.direction"] == pytest.approx(0.9)
    assert figures["ours.direction_error_deg.left"] == pytest.approx(0.01)
    assert figures["ours.pilot.150 to 300 m.lateral_m.p95"] == pytest.approx(0.01)
    assert figures["ours.honesty.mean"] == pytest.approx(2.5)


def test_pictures_are_drawn(tmp_path):
    path = tmp_path / "figures" / "ours.png"
    write_figure(path, "ours", scores()["ours, tracked"])
    assert path.read_bytes()[:4] == b"\x89PNG"
    at, middle = medians_by_range(scores()["ours, tracked"], "protection.lateral_m")
    np.testing.assert_allclose(at, [125.0, 225.0, 325.0])
    np.testing.assert_allclose(middle, 0.5)
    with pytest.raises(ValueError, match="nothing to draw"):
        write_figure(path, "ours", [])
