"""Tables and their files, and the page of results."""

import json
import math

import pytest
from refused import refuse

from deckline.cli.main import main
from deckline_lab.evaluation.tables import OutputFiles, Table, markdown, number, publish

TABLE = Table("errors", ("side", "m [1-sigma]"), [("left", "0.1 [0.0, 0.2]"), ("left", "-")], notes=("A note.",))


def test_figures_are_saved_beside_what_they_were_made_with(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("sys.argv", ["deckline", "eval", "chain", "--out", "there", "--seed", "3", "--json", "f.json"])
    files = tmp_path / "new" / "f.json", tmp_path / "t.md"
    publish(
        "two frames",
        [TABLE],
        {"a.median": math.nan, "b": {"c": [math.inf, 1.5]}},
        OutputFiles(*files),
        notes=["The end."],
    )
    saved = json.loads(files[0].read_text())
    assert saved["a.median"] is None and saved["b"] == {"c": [None, 1.5]}
    assert saved["_title"] == "two frames" and saved["_command"] == "deckline eval chain --seed 3"
    assert {"deckline", "machine", "python", "date"} <= saved["_made_with"].keys()
    assert saved["_tables"][0]["rows"] == [["left", "0.1 [0.0, 0.2]"], ["left", "-"]]
    assert saved["_notes"] == ["The end."]
    written = "**errors**\n\n| side | m [1-sigma] |\n| --- | ---: |\n| left | 0.1 [0.0, 0.2] |\n| left | - |\n\nA note."
    assert markdown(TABLE) == written and written in files[1].read_text()
    assert [number(value, ".1f") for value in (1.234, None, math.nan, math.inf)] == ["1.2", "-", "-", "-"]
    shown = capsys.readouterr().out
    for words in ("two frames", "errors", "0.1 [0.0, 0.2]", "A note.", "The end.", str(files[0]), str(files[1])):
        assert words in shown.replace("\n", "")


def save(path, title):
    table = Table("all frames", ("figure", "value"), [("found_rate", "0.97")], ("Of 3 frames.",))
    publish(title, [table, TABLE], {"found_rate": 0.97}, OutputFiles(path), notes=["Rates are shares."])


def test_a_page_has_a_section_for_every_file(tmp_path, capsys):
    save(tmp_path / "b.json", "second")
    save(tmp_path / "a.json", "first")
    page = tmp_path / "docs" / "results.md"
    assert main(["eval", "report", str(tmp_path), "--out", str(page)]) == 0
    text = page.read_text()
    assert text.index("## A\n\nfirst.") < text.index("## B\n\nsecond.")
    assert text.count("|found_rate|0.97|") == 2
    saved = json.loads((tmp_path / "a.json").read_text())
    for words in (saved["_command"], *saved["_made_with"].values(), "Of 3 frames.", "Rates are shares."):
        assert words in text
    assert capsys.readouterr().out.strip().endswith(str(page))
    assert main(["eval", "report", str(tmp_path), "--out", str(page), "--tables", "1"]) == 0
    assert "**errors**" in text and "**errors**" not in page.read_text()
    assert "|found_rate|0.97|" in page.read_text() and "Rates are shares." not in page.read_text()


CONTENTS = ('{"found_rate": 0.97}', "[1]", '{"_tables": ', '{"_tables": [{"title": 1}]}', None)


@pytest.mark.parametrize("content", CONTENTS)
def test_a_file_that_no_evaluation_saved_and_an_empty_folder_are_one_line(tmp_path, capsys, content):
    if content is not None:
        (tmp_path / "other.json").write_text(content)
    error = refuse(capsys, "report", tmp_path, "--out", tmp_path / "r.md")
    assert ("other.json" if content else str(tmp_path)) in error
    assert not (tmp_path / "r.md").exists()
