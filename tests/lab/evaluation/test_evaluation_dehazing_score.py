"""Scores of dehazers, and their tables."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from level_deck import CAMERA, LEFT, RIGHT, frame_at, pixels_of, result_of

from deckline.types import Segment, Truth
from deckline_lab.evaluation.dehazers import Cost
from deckline_lab.evaluation.dehazing_pairs import Pair, film_of, labelled_lines, seen_length_px, true_lines
from deckline_lab.evaluation.dehazing_score import (
    ImageScore,
    lines_are_right,
    restoration,
    score_lines,
    summarise,
    summarise_film,
    visible_figures,
    worse_lines,
)
from deckline_lab.evaluation.dehazing_tables import DehazingResults, dehazing_tables, json_of
from deckline_lab.evaluation.false_content import false_edges
from deckline_lab.evaluation.metrics import psnr_db, ssim
from deckline_lab.evaluation.visible_distance import TITLE
from deckline_sim.visible_line import find_visible_line
from golden import check_golden

GOLDEN = Path(__file__).parent / "golden"
FILMED = {"a": "dry and sharp", "b": "rain", "c": "rain", "d": None}


def pixels(segment: Segment) -> np.ndarray:
    return pixels_of(frame_at(), segment)


def score(key: str, dehazer: str, psnr_db: float, visibility_m: float = 800.0, **more) -> ImageScore:
    return ImageScore("here", key, dehazer, visibility_m, {"psnr_db": psnr_db}, **more)


def test_figures_are_of_the_whole_picture_and_of_the_surface():
    rng = np.random.default_rng(0)
    clear, image = (rng.integers(40, 200, (48, 64, 3)).astype(np.uint8) for _ in range(2))
    surface = np.zeros((48, 64), dtype=bool)
    surface[30:, 10:] = True
    below = psnr_db(image[30:, 10:], clear[30:, 10:])
    expected = {"psnr_db": psnr_db(image, clear), "psnr_db_surface": below, "ssim": ssim(image, clear)}
    expected["false_edges_per_mille"] = 1e3 * false_edges(image, clear)
    assert restoration(image, clear, surface) == pytest.approx(expected, abs=1e-12)


def test_an_untouched_picture_counts_60_db_and_what_does_not_exist_is_left_out():
    small = np.full((8, 20, 3), 7, np.uint8)
    untouched = {"psnr_db": 60.0, "false_edges_per_mille": 0.0}
    assert restoration(small, small, None) == untouched
    assert restoration(small, small, np.zeros((8, 20), dtype=bool)) == untouched


def test_the_part_of_a_line_inside_the_image_is_measured():
    along = np.linspace(0, 1, 1001)[:, None]
    across = np.array([-100.0, 50.0]) + along * [1000.0, 0.0]  # enters at u = 0, leaves at u = 639
    assert seen_length_px(across, CAMERA) == pytest.approx(639.0)
    assert seen_length_px(np.full((10, 2), np.nan), CAMERA) == 0.0


def test_lines_behind_the_aircraft_or_a_speck_far_away_are_not_asked_for():
    assert true_lines(frame_at()) is not None
    assert true_lines(frame_at(x_m=300.0)) is None
    assert true_lines(frame_at(x_m=-9000.0)) is None  # 20 m high: the 200 m of the line are 0.02 px tall
    assert true_lines(replace(frame_at(), truth=None)) is None
    assert true_lines(replace(frame_at(), truth=Truth(visibility_m=500.0))) is None


def test_exact_points_are_found_with_no_error_and_shifted_ones_are_off_by_the_shift():
    left, right = pixels(LEFT), pixels(RIGHT)
    lines = true_lines(frame_at())
    found, distances_px = score_lines(result_of(frame_at(), left, right), lines)
    assert found
    np.testing.assert_allclose(distances_px, np.zeros(60), atol=1e-9)
    slope = np.diff(left[[0, -1]], axis=0)[0]
    normal = np.array([-slope[1], slope[0]]) / np.linalg.norm(slope)
    _, distances_px = score_lines(result_of(frame_at(), left + 3.0 * normal, right), lines)
    np.testing.assert_allclose(distances_px, [3.0] * 30 + [0.0] * 30, atol=1e-9)
    assert score_lines(result_of(frame_at(), [], []), lines) == (False, [])


def test_labelled_lines_give_the_same_distances_as_true_ones():
    truth, labelled = true_lines(frame_at()), labelled_lines({"left": pixels(LEFT), "right": pixels(RIGHT)}, CAMERA)
    points = np.array([[100.0, 300.0], [320.0, 200.0]])
    for side in ("left", "right"):
        np.testing.assert_allclose(labelled[side](points), truth[side](points), atol=1e-6)
    assert labelled_lines({"left": pixels(LEFT), "right": None}, CAMERA) is None
    assert labelled_lines({"left": pixels(LEFT), "right": pixels(RIGHT) + 1000.0}, CAMERA) is None


def test_means_and_paired_differences_of_known_numbers():
    hazy = [score(str(i), "none", 10.0 + i) for i in range(4)]
    better = [score(str(i), "net", 12.5 + i, note="left" if i == 3 else "") for i in range(4)]
    summary = summarise([*better, *hazy], "none")["all"]
    assert summary["none"].means == {"psnr_db": 11.5} and summary["net"].means == {"psnr_db": 14.0}
    assert summary["none"].differences == {}
    gain = summary["net"].differences["psnr_db"]
    assert (gain.value, gain.low, gain.high, gain.images) == (2.5, 2.5, 2.5, 4)
    assert summary["net"].left_alone == 1 and summary["net"].images == 4


def test_summaries_by_visibility_and_film():
    """Unpaired images, both ends of a band, unknown visibility, a dehazer without points, rain."""
    visibilities_m = (90.0, 150.0, 299.9, 300.0, 1000.0, 3000.0, np.inf, np.nan, 800.0, 800.0)
    films = (*FILMED.values(), *[None] * 6)
    scores = [
        score(str(k), "none", 10.0 + k, visibility_m, film=film, found=True, distances_px=[1.0, 1.0, 4.0])
        for k, (visibility_m, film) in enumerate(zip(visibilities_m, films, strict=True))
    ]
    ours = [replace(one, dehazer="net", figures={"psnr_db": 20.0 + 2 * k}) for k, one in enumerate(scores)]
    scores += [replace(one, found=k < 5, distances_px=[2.0, 2.0]) for k, one in enumerate(ours[:9])]
    scores += [replace(ours[9], found=False, distances_px=[]), score("only ours", "net", 50.0)]
    by_visibility, by_film = summarise(scores, "none"), summarise_film(scores, "none")
    found, farther = by_visibility["all"]["net"].line_differences.values()
    assert found.value == -0.5 and -0.9 <= found.low < found.high <= -0.1 and found.images == 10
    assert (farther.value, farther.images) == (1.0, 9)
    check_golden(GOLDEN / "dehazing_summaries.json", {"visibility": by_visibility, "film": by_film})
    assert summarise_film([one for one in scores if one.film != "rain"], "none") == {}
    with pytest.raises(ValueError):
        summarise([], "none")


def test_higher_psnr_with_worse_lines_is_named_and_no_other():
    names = {"none": (10.0, True, 1.0), "worse": (15.0, False, 1.0), "farther": (15.0, True, 2.0)}
    names |= {"good": (15.0, True, 1.0), "lower": (9.0, False, 1.0)}
    scores = [
        score(str(i), name, psnr, found=found, distances_px=[px])
        for name, (psnr, found, px) in names.items()
        for i in range(12)
    ]
    assert worse_lines(summarise(scores, "none")["all"]) == ["worse", "farther"]


@pytest.mark.parametrize(
    ("exposure", "film"),
    [
        ({"rain_mm_h": 0.0, "lens_drops": 0, "exposure_s": 0.0}, "dry and sharp"),
        ({"rain_mm_h": 4.0, "lens_drops": 0, "exposure_s": 0.0}, "rain"),
        ({"rain_mm_h": 0.0, "lens_drops": 3, "exposure_s": 0.0}, "rain"),
        ({"rain_mm_h": 0.0, "lens_drops": 0, "exposure_s": 0.01}, "motion blur"),
        ({"rain_mm_h": 9.0, "lens_drops": 0, "exposure_s": 0.01}, "rain and motion blur"),
        ({"rain_mm_h": 9.0, "lens_drops": 0}, None),
        ({"rain_mm_h": "much", "lens_drops": 0, "exposure_s": 0.01}, None),
        ("long", None),
    ],
)
def test_rain_and_blur_are_read_from_the_truth(exposure, film):
    assert film_of({"exposure": exposure}) == film
    assert film_of({}) is None


def scores(name: str, psnr_db: float, found: bool) -> list[ImageScore]:
    lines = {"found": found, "distances_px": [1.0, 3.0]}
    return [ImageScore("/a", str(i), name, 400.0, {"psnr_db": psnr_db + i}, **lines) for i in range(8)]


def results(**changes) -> DehazingResults:
    both = [*scores("none", 10.0, True), *scores("[net]", 14.0, False)]
    sizes = {"none": None, "[net]": (1_500_000, 2_340_000_000)}
    plain = DehazingResults("8 pairs", "[net]", summarise(both, "[net]"), {}, sizes, {}, (1280, 720), {}, (), {})
    return replace(plain, **changes)


def cases() -> dict[str, DehazingResults]:
    wet = [replace(one, film="rain") for one in scores("none", 10.0, True)]
    both = [*scores("none", 10.0, True), *scores("[net]", 14.0, True)]
    single = [*scores("none", 10.0, True)[:1], *scores("[net]", 14.0, True)[:1]]
    costs = {"none": Cost(0.05, 10 * 2.0**20), "[net]": Cost(0.2, 40 * 2.0**20)}
    return {
        "plain": results(),  # higher PSNR, worse lines
        "rain": results(film=summarise_film(wet, "[net]"), costs=costs),
        "good_lines": results(summaries=summarise(both, "none"), costs=costs, reference="none"),
        "no_cost": results(costs={"[net]": Cost(0.2, None)}, failed={"none": "no memory"}),
        "one_pair": results(skipped=(("/a: 9.png", "cut short"),), summaries=summarise(single, "none")),
    }


@pytest.mark.parametrize("name", cases())
def test_tables_and_json_of_known_scores(name):
    measured = cases()[name]
    check_golden(GOLDEN / f"dehazing_{name}.json", {"tables": dehazing_tables(measured), "figures": json_of(measured)})


def test_lines_are_right_where_a_pairs_truth_has_them():
    at = frame_at()
    seen = tuple(find_visible_line(at, segment) for segment in (LEFT, RIGHT))
    pair = Pair(at, None, None, 800.0, true_lines(at), in_view=seen, range_m=200.0)
    detection = result_of(at, pixels(LEFT), pixels(RIGHT)).detection
    assert lines_are_right(detection, pair)
    assert not lines_are_right(result_of(at, pixels(LEFT) + np.array([40.0, 0.0]), pixels(RIGHT)).detection, pair)
    assert not lines_are_right(result_of(at, [], pixels(RIGHT)).detection, pair)
    assert not lines_are_right(detection, replace(pair, in_view=()))
    assert not lines_are_right(detection, replace(pair, lines=None))


def test_each_dehazer_has_the_range_from_which_its_lines_are_held():
    def flight(dehazer: str, right_from_m: float) -> list[ImageScore]:
        ranges = 600.0 - 10.0 * np.arange(50)
        where = ({"time_s": k / 5, "range_m": m, "is_right": bool(m <= right_from_m)} for k, m in enumerate(ranges))
        return [score(str(k), dehazer, 20.0, 500.0, **one) for k, one in enumerate(where)]

    scores = [*flight("none", 300.0), *flight("net", 400.0)]
    figures = visible_figures(scores)
    assert [figures[name]["first_held_m.90"] for name in ("none", "net")] == [300.0, 400.0]
    assert figures["net"]["first_held_of_visibility.50"] == 0.8
    summaries = summarise(scores, "none")
    results = DehazingResults("", "none", summaries, {}, {}, {}, (1, 1), {}, (), figures)
    [table] = [table for table in dehazing_tables(results) if table.title == TITLE]
    assert [row[:3] for row in table.rows] == [("none", "1", "300"), ("net", "1", "400")]
    assert json_of(results)["visible_distance"] == figures
