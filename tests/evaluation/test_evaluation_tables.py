import json
import math

import pytest

from deckline.evaluation.tables import OutputFiles, Table, markdown, number, publish

TABLE = Table("errors", ("side", "m [1-sigma]"), [("left", "0.1 [0.0, 0.2]"), ("left", "-")], notes=("A note.",))


def test_a_table_as_markdown():
    assert markdown(TABLE).splitlines() == [
        "**errors**",
        "",
        "| side | m [1-sigma] |",
        "| --- | ---: |",
        "| left | 0.1 [0.0, 0.2] |",
        "| left | - |",
        "",
        "A note.",
    ]


def test_figures_are_saved_beside_what_they_were_made_with(tmp_path, capsys):
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
    assert saved["_title"] == "two frames" and saved["_command"]
    assert {"deckline", "machine", "python", "date"} <= saved["_made_with"].keys()
    assert saved["_tables"][0]["rows"] == [["left", "0.1 [0.0, 0.2]"], ["left", "-"]]
    assert saved["_notes"] == ["The end."]
    assert markdown(TABLE) in files[1].read_text()
    shown = capsys.readouterr().out
    for words in ("two frames", "errors", "0.1 [0.0, 0.2]", "A note.", "The end.", str(files[0]), str(files[1])):
        assert words in shown.replace("\n", "")


@pytest.mark.parametrize(("value", "text"), [(1.234, "1.2"), (None, "-"), (math.nan, "-"), (math.inf, "-")])
def test_numbers_in_cells(value, text):
    assert number(value, ".1f") == text
