"""`deckline reproduce`: saved tables beside the paper's figures, and the commands that make them anew."""

import json
import shutil
import sys

import pytest

from deckline.cli.main import main
from deckline_lab.evaluation.tables import read_saved
from deckline_lab.reproduce import runs, table4, table5, table6
from deckline_lab.reproduce.command import SAVED
from deckline_lab.reproduce.table4 import DEHAZERS
from deckline_lab.reproduce.table6 import DETECTORS, with_paper_6

TABLES = ("table4", "table5", "table6")


@pytest.fixture
def commands(monkeypatch, tmp_path):
    """What a run anew calls, each ending at once; the last one leaves figures behind."""
    called = []

    def run(*words, quiet=False):
        called.append([str(word) for word in words])
        if words[0] == "eval":
            name = {"dehazing": "table4", "ablation": "table5", "localization": "table6"}[words[1]]
            written = tmp_path / "table5" / "ablation.json" if name == "table5" else tmp_path / f"{name}.json"
            written.parent.mkdir(exist_ok=True)
            shutil.copy(SAVED / f"{name}.json", written)

    for module in (runs, table4, table5, table6):
        monkeypatch.setattr(module, "run", run)
    monkeypatch.setattr(table4, "shrink_pairs", lambda recording, folder: folder)
    return called


@pytest.mark.parametrize(
    ("table", "figures"),
    [("table4", ["30.18", "0.972", "29.11"]), ("table5", ["28.94", "30.18"]), ("table6", ["8.5456", "0.0559", "88.9"])],
)
def test_a_saved_table_stands_beside_the_papers_figures(table, figures, capsys):
    assert main(["reproduce", table]) == 0
    shown = capsys.readouterr().out
    assert "Command: deckline eval" in shown and "What differs" in shown
    assert all(figure in shown for figure in figures)


def test_the_papers_improvement_is_computed_from_its_errors():
    lines, improved = with_paper_6(read_saved(SAVED / "table6.json").tables)
    assert lines.rows[2][0] == improved.rows[0][0] == "sad-lite0, hazy, paper's"
    assert improved.title.startswith("improvement over sad-lite0")
    paper = dict(zip(improved.columns, improved.rows[-1], strict=True))
    assert float(paper["direction both"]) == pytest.approx(100 * (1 - 1.3906 / 12.5405), abs=0.05)
    assert float(paper["intercept left"]) == pytest.approx(80.0, abs=0.05)


@pytest.mark.parametrize(("table", "networks"), [("table4", DEHAZERS), ("table6", DETECTORS)])
def test_a_table_made_anew_trains_every_network_for_the_same_minutes(table, networks, commands, tmp_path, capsys):
    assert main(["reproduce", table, "--runs", str(tmp_path), "--minutes", "3"]) == 0
    trained = [command for command in commands if command[0] == "train"]
    assert [command[command.index("--network") + 1] for command in trained] == list(networks)
    assert all(command[command.index("--minutes") + 1] == "3.0" for command in trained)
    assert commands[0][0] in ("dataset", "sim")
    files = [str(tmp_path / table / name) for name in networks]
    assert all(any(word.startswith(file) for word in commands[-1]) for file in files)
    assert "What differs" in capsys.readouterr().out


def test_the_ablation_made_anew_is_printed_again_without_training(commands, tmp_path, capsys):
    assert main(["reproduce", "table5", "--runs", str(tmp_path), "--minutes", "0.5"]) == 0
    first = capsys.readouterr().out
    count = len(commands)
    assert main(["reproduce", "table5", "--runs", str(tmp_path)]) == 0
    assert capsys.readouterr().out == first
    assert len(commands) == count


def test_wrong_use_is_one_line(tmp_path, capsys):
    folder = ["--runs", str(tmp_path)]
    assert main(["reproduce", "table4", "--minutes", "3"]) == 2
    assert main(["reproduce", "table4", *folder, "--minutes", "0"]) == 2
    assert main(["reproduce", "table4", *folder]) == 2
    (tmp_path / "table4.json").write_text(json.dumps({"rows": []}))
    assert main(["reproduce", "table4", *folder]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 4
    words = (["--minutes 3", "--runs"], ["--minutes 0"], ["table4.json", "--minutes"], ["table4.json", "--json"])
    assert all(word in line for line, parts in zip(lines, words, strict=True) for word in parts), lines


def test_a_command_that_fails_ends_with_its_code(monkeypatch):
    monkeypatch.setattr(sys, "executable", "/bin/false")
    with pytest.raises(SystemExit) as ended:
        runs.run("info")
    assert ended.value.code == 1
