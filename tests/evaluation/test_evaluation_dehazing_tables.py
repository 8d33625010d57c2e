import io
import json
from dataclasses import replace

import numpy as np
from rich.console import Console

from deckline.evaluation.dehazing_cost import Cost
from deckline.evaluation.dehazing_measure import ImageScore, LineScore, summarise, summarise_film
from deckline.evaluation.dehazing_tables import Results, json_of, markdown_of, print_results, sheets_of


def scores(name: str, psnr_db: float, found: bool) -> list[ImageScore]:
    line = LineScore(found, np.array([1.0, 3.0]))
    return [ImageScore(("/a", str(i)), name, 400.0, {"psnr_db": psnr_db + i}, "", line) for i in range(8)]


def results(**changes) -> Results:
    both = [*scores("none", 10.0, True), *scores("[net]", 14.0, False)]
    plain = Results(
        title="8 pairs",
        about={"machine": "abacus with 2 rods"},
        reference="[net]",
        summaries=summarise(both, "[net]", "none"),
        film={},
        sizes={"none": None, "[net]": (1_500_000, 2_340_000_000)},
        costs={},
        cost_size_px=(1280, 720),
        failed={},
        skipped=(),
    )
    return replace(plain, **changes)


def rows_of(sheet) -> dict[str, dict[str, str]]:
    return {row[sheet.columns.index("dehazer")]: dict(zip(sheet.columns, row, strict=True)) for row in sheet.rows}


def test_cells_of_known_numbers():
    first, _, lines = sheets_of(results())
    net, none = rows_of(first)["[net]"], rows_of(first)["none"]
    assert (net["PSNR, dB"], net["to [net], dB"], net["SSIM"]) == ("17.50", "-", "-")
    assert none["to [net], dB"] == "-4.00 [-4.00, -4.00]"
    assert (net["parameters"], net["MACs 256x256"], none["parameters"]) == ("1.500 M", "2.34 G", "-")
    assert "below horizon, dB" not in first.columns
    assert rows_of(lines)["[net]"]["difference, points"] == "-100.0 [-100.0, -100.0]"
    assert rows_of(lines)["none"]["points, median px"] == "2.00"


def test_rain_has_a_table_of_its_own():
    wet = [replace(one, film="rain") for one in scores("none", 10.0, True)]
    measured = results(film=summarise_film(wet, "[net]", "none"))
    first, _, film, _ = sheets_of(measured)
    assert film.columns[0] == "rain and motion blur" and "rain and motion blur" not in first.columns
    assert [row[:4] for row in film.rows] == [("rain", "none", "8", "13.50")]
    assert json_of(measured)["film"]["rain"]["none"]["images"] == 8
    assert "Restoration by rain and motion blur" in markdown_of(measured)
    assert "rain" not in markdown_of(results())


def test_a_higher_psnr_with_worse_lines_is_said():
    assert "Higher PSNR, worse lines: [net] (all), [net] (300-500 m)." in sheets_of(results())[-1].captions
    both = [*scores("none", 10.0, True), *scores("[net]", 14.0, True)]
    assert not any(
        "worse" in line for line in sheets_of(results(summaries=summarise(both, "none", "none")))[-1].captions
    )


def test_cost_has_its_ratio_to_the_reference_and_a_failure_its_reason():
    costs = {"none": Cost(0.05, 10 * 2.0**20), "[net]": Cost(0.2, 40 * 2.0**20)}
    row = rows_of(sheets_of(results(costs=costs))[0])["none"]
    assert (row["ms at 1280x720"], row["peak MiB"]) == ("50.0 (0.25)", "10 (0.25)")
    compared_with_nothing = results(costs=costs, reference="none")
    assert rows_of(sheets_of(compared_with_nothing)[0])["[net]"]["ms at 1280x720"] == "200.0"
    broken = sheets_of(results(costs={"[net]": Cost(0.2, None)}, failed={"none": "no memory"}))[0]
    assert rows_of(broken)["none"]["peak MiB"] == rows_of(broken)["[net]"]["peak MiB"] == "-"
    assert "none: no cost: no memory" in broken.captions


def test_screen_and_markdown_show_the_same_words_and_json_has_no_nan():
    single = [*scores("none", 10.0, True)[:1], *scores("[net]", 14.0, True)[:1]]
    one = results(skipped=(("/a: 9.png", "cut short"),), summaries=summarise(single, "none", "none"))
    screen = io.StringIO()
    print_results(Console(file=screen, width=200), results())
    for word in ("8 pairs", "abacus with 2 rods", "[net]", "-4.00 [-4.00, -4.00]"):
        assert word in screen.getvalue() and word in markdown_of(results())
    assert "skipped 1; the first: /a: 9.png: cut short" in markdown_of(one)
    json.dumps([json_of(one), json_of(results())], allow_nan=False)
    assert json_of(one)["visibility"]["all"]["[net]"]["differences"]["psnr_db"]["low"] is None
    assert json_of(results())["higher_psnr_worse_lines"] == {"all": ["[net]"], "300-500 m": ["[net]"]}
