import json
from dataclasses import replace

from deckline.evaluation.dehazing_cost import Cost
from deckline.evaluation.dehazing_score import ImageScore, summarise, summarise_film
from deckline.evaluation.dehazing_tables import Results, dehazing_tables, json_of
from deckline.evaluation.tables import OutputFiles, publish


def scores(name: str, psnr_db: float, found: bool) -> list[ImageScore]:
    lines = {"found": found, "distances_px": [1.0, 3.0]}
    return [ImageScore("/a", str(i), name, 400.0, {"psnr_db": psnr_db + i}, **lines) for i in range(8)]


def results(**changes) -> Results:
    both = [*scores("none", 10.0, True), *scores("[net]", 14.0, False)]
    plain = Results(
        title="8 pairs",
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


def rows_of(table) -> dict[str, dict[str, str]]:
    return {row[table.columns.index("dehazer")]: dict(zip(table.columns, row, strict=True)) for row in table.rows}


def test_cells_of_known_numbers():
    first, _, lines = dehazing_tables(results())
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
    first, _, film, _ = dehazing_tables(measured)
    assert film.columns[0] == "rain and motion blur" and "rain and motion blur" not in first.columns
    assert [row[:4] for row in film.rows] == [("rain", "none", "8", "13.50")]
    assert json_of(measured)["film"]["rain"]["none"]["images"] == 8
    assert not any("rain" in table.title for table in dehazing_tables(results()))


def test_a_higher_psnr_with_worse_lines_is_said():
    assert "Higher PSNR, worse lines: [net] (all), [net] (300-500 m)." in dehazing_tables(results())[-1].notes
    both = [*scores("none", 10.0, True), *scores("[net]", 14.0, True)]
    assert not any(
        "worse" in line for line in dehazing_tables(results(summaries=summarise(both, "none", "none")))[-1].notes
    )


def test_cost_has_its_ratio_to_the_reference_and_a_failure_its_reason():
    costs = {"none": Cost(0.05, 10 * 2.0**20), "[net]": Cost(0.2, 40 * 2.0**20)}
    row = rows_of(dehazing_tables(results(costs=costs))[0])["none"]
    assert (row["ms at 1280x720"], row["peak MiB"]) == ("50.0 (0.25)", "10 (0.25)")
    compared_with_nothing = results(costs=costs, reference="none")
    assert rows_of(dehazing_tables(compared_with_nothing)[0])["[net]"]["ms at 1280x720"] == "200.0"
    broken = dehazing_tables(results(costs={"[net]": Cost(0.2, None)}, failed={"none": "no memory"}))[0]
    assert rows_of(broken)["none"]["peak MiB"] == rows_of(broken)["[net]"]["peak MiB"] == "-"
    assert "none: no cost: no memory" in broken.notes


def test_json_of_known_numbers(tmp_path):
    single = [*scores("none", 10.0, True)[:1], *scores("[net]", 14.0, True)[:1]]
    one = results(skipped=(("/a: 9.png", "cut short"),), summaries=summarise(single, "none", "none"))
    publish("one pair", dehazing_tables(one), json_of(one), OutputFiles(tmp_path / "f.json"))
    saved = json.loads((tmp_path / "f.json").read_text())
    assert saved["visibility"]["all"]["[net]"]["differences"]["psnr_db"]["low"] is None
    assert saved["skipped"] == [["/a: 9.png", "cut short"]]
    assert json_of(results())["higher_psnr_worse_lines"] == {"all": ["[net]"], "300-500 m": ["[net]"]}
