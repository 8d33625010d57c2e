"""`deckline reproduce`: saved tables beside the paper's figures, and the commands that make them anew."""

import json
import sys

import pytest

from clear_scene import hazy_recording
from deckline.cli.main import main
from deckline.recording.images import read_image
from deckline_lab.ablation import rows
from deckline_lab.ablation.rows import ROWS
from deckline_lab.evaluation import dehazers, visible_distance
from deckline_lab.evaluation.localization_tables import (
    GAINS_NOTE,
    IMPROVEMENT_NOTE,
    LINES_NOTE,
    PAIRED,
    USABLE_NOTE,
    USABLE_TITLE,
)
from deckline_lab.evaluation.tables import Table, read_saved
from deckline_lab.reproduce import figures, line_figures, runs, table4, table5, table6
from deckline_lab.reproduce.runs import SAVED
from deckline_lab.reproduce.table6 import with_paper_6

SMALL = table4.RECIPE.replace("256", "48").replace("held_out = 0.02", "held_out = 0.2\nsteps = 2")
SMALL_6 = """steps = 1
batch = 2
held_out = 0.2
cpu_minutes = true
[shape]
frozen_blocks = 5
[shape.grid]
width = 128
height = 64
cells = 32
rows = 16
"""
MODULES = {"table4": table4, "table5": table5, "table6": table6}
FORMS = {"printed": ("full-t", "aod-net"), "coarse": ("coarse-t", "aod-net-coarse")}


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """A folder of runs with the dataset of twelve and six small pairs."""
    folder = tmp_path_factory.mktemp("runs")
    for split, frames in (("train", 12), ("test", 6)):
        hazy_recording(folder / "data" / split, frames)
    return folder


@pytest.fixture
def called(monkeypatch):
    """The commands that a table calls, executed in this process; the dataset is there already."""
    commands = []

    def run(*words, quiet=False):
        commands.append([str(word) for word in words])
        if words[0] != "dataset":
            assert main(commands[-1]) == 0

    for module in (runs, table4, table5, table6):
        monkeypatch.setattr(module, "run", run)
    return commands


@pytest.mark.parametrize("table", ["table4", "table5", "table6"])
def test_a_saved_table_is_printed(table, capsys):
    assert main(["reproduce", table]) == 0
    shown = capsys.readouterr().out
    saved = read_saved(SAVED / f"{table}.json")
    assert saved.command.startswith("deckline ")
    words = " ".join(shown.split())
    for text in (saved.title.split(";")[0], saved.command.split()[-1], MODULES[table].DIFFERS):
        assert " ".join(text.split()) in words


def test_table_4_is_trained_measured_and_drawn_in_pieces(data, no_tiles, called, monkeypatch, capsys):
    settings = {"RECIPE": SMALL, "FORMS": FORMS, "EVERY": 1, "COST_SIZE": (96, 64), "COST_RUNS": 1}
    for name, value in settings.items():
        monkeypatch.setattr(table4, name, value)
    monkeypatch.setattr(dehazers, "run_in_process", dehazers.run_once)
    command = ["reproduce", "table4", "--runs", str(data), "--minutes", "5", "--threads", "1"]
    monkeypatch.setattr(sys, "argv", ["deckline", *command])
    assert main(command) == 0
    trained = [words[words.index("--network") + 1] for words in called if words[0] == "train"]
    assert trained == [name for names in FORMS.values() for name in names]
    saved = read_saved(data / "table4.json")
    table = [dict(zip(saved.tables[0].columns, row, strict=True)) for row in saved.tables[0].rows]
    assert [row["network"] for row in table] == ["hazy", *trained]
    assert saved.command == f"deckline {' '.join(command)}"
    for row in table[1:]:
        assert row["steps"] == "2" and float(row["PSNR, dB"]) > 5 and float(row["ms"]) > 0
        assert ("[" in row["to ours [95 %], dB"]) == row["network"].startswith("aod-net")
    for row in table[1::2]:
        assert float(row["GMACs 1280x720"]) > 3 * float(row["GMACs 256x256"]) > 0
    assert [row["paper, dB"] for row in table] == ["-", "30.18", "-", "-", "-"]
    sizes = json.loads((data / "table4.json").read_text())["forms"]["printed"]["size"]
    saving = 100 * (sizes["full-t"]["parameters"] / sizes["aod-net"]["parameters"] - 1)
    assert any(f"parameters {saving:+.2f}" in note and "-29.44" in note for note in saved.tables[0].notes)
    assert read_image(data / "figures" / "figure12.jpg").shape == (6 * 240, 4 * 360, 3)
    assert (data / "figures" / "figure11.png").read_bytes().startswith(b"\x89PNG")
    called.clear()
    assert main(command) == 0
    assert capsys.readouterr().out.count("finished before") == 4
    assert [words[0] for words in called] == ["dataset"]


def test_table_5_trains_every_row_with_every_seed_for_the_same_steps(data, called, monkeypatch, capsys):
    monkeypatch.setattr(table5, "SEEDS", (3,))
    monkeypatch.setattr(table5, "SUB_IMAGE_PX", 48)
    monkeypatch.setattr(rows, "ROWS", (ROWS[0], ROWS[-1]))
    command = ["reproduce", "table5", "--runs", str(data)]
    assert main([*command, "--minutes", "0.02", "--threads", "1"]) == 0
    shown = capsys.readouterr().out
    assert sorted(path.name for path in (data / "table5").glob("*-3")) == ["baseline-3", "redrawn-3"]
    table = read_saved(data / "table5.json").tables[0]
    steps, paper = table.columns.index("steps"), table.columns.index("paper, dB")
    assert [row[steps] for row in table.rows] == ["-", "2", "2"]
    assert [row[paper] for row in table.rows] == ["-", "28.94", "-"]
    called.clear()
    assert main(command) == 0
    assert shown.endswith(capsys.readouterr().out) and not called


def test_flights_are_neighbours_of_one_visibility(tmp_path):
    visibilities = (900.0, 900.0, 400.0, 900.0)
    frames = [
        {"file": f"{k}h.png", "pair_of": f"{k}c.png", "visibility_m": metres} for k, metres in enumerate(visibilities)
    ]
    (tmp_path / "labels.json").write_text(json.dumps({"frames": frames}))
    pairs = figures.PairSource("", tuple(frame["file"] for frame in frames), lambda key: None)
    assert figures.find_flights(tmp_path, pairs) == [["2h.png"], ["0h.png", "1h.png"], ["3h.png"]]


def test_the_papers_improvement_is_computed_from_its_errors():
    lines = Table("Table 6", ("method", "line", "slope off", "intercept off, m", "direction off, deg"), [])
    columns = [f"{what} {side}" for what in ("direction", "intercept") for side in ("left", "right", "both")]
    given = [lines, Table("improvement", ("method", *columns), []), Table("", (), []), Table("pilot", (), [])]
    lines, improved, _ = with_paper_6(given)
    wanted = [f"{PAIRED} ufld", visible_distance.TITLE, USABLE_TITLE]
    chosen = with_paper_6([*given, *(Table(title, (), []) for title in (*wanted, "consistency"))])
    assert [table.title for table in chosen[3:]] == wanted
    assert lines.rows[0] == ["the paper, without dehazing", "left", "0.15", "9.25", "8.5456"]
    paper = dict(zip(improved.columns, improved.rows[-1], strict=True))
    assert float(paper["direction both"]) == pytest.approx(100 * (1 - 1.3906 / 12.5405), abs=0.05)
    assert float(paper["intercept left"]) == pytest.approx(80.0, abs=0.05)


def test_the_notes_of_table_6_explain_its_tables_alone():
    saved = read_saved(SAVED / "table6.json")
    notes = [list(table.notes) for table in saved.tables]
    assert notes[:3] == [[LINES_NOTE], [IMPROVEMENT_NOTE], [GAINS_NOTE]]
    assert not any(notes[3:]) and not saved.notes


def test_table_6_is_trained_flown_and_drawn(tmp_path, no_tiles, called, monkeypatch, capsys):
    size = ("--frames", "6", "--test", "2", "--width", "320", "--height", "180")
    assert main(["dataset", str(tmp_path / "data"), "--views", "landing", "--one-scene", "--no-tiles", *size]) == 0
    settings = {"RECIPE": SMALL_6, "VIEWS": 2}
    settings |= {"DETECTORS": {"sad": "sad-lite0", "ours": "hybrid"}, "AIR": ("clear",)}
    settings |= {"DECK_SEEDS": (1100,), "DECK_FRAMES": 2}
    settings |= {"FLIGHTS": ("--approaches", 1, "--frames", 2, "--range-m", 150, 80)}
    for name, value in settings.items():
        monkeypatch.setattr(table6, name, value)
    monkeypatch.setattr(table4, "RECIPE", SMALL)
    monkeypatch.setattr(line_figures, "SHOWN_M", (10.0, 10000.0))
    command = ["reproduce", "table6", "--runs", str(tmp_path), "--minutes", "5", "--threads", "1"]
    assert main(command) == 0
    trained = [words[words.index("--network") + 1] for words in called if words[0] == "train"]
    assert trained == ["sad-lite0", "hybrid", "coarse-t"]
    saved = read_saved(tmp_path / "table6.json")
    lines, improved, _, paired, usable, approaches, views = saved.tables
    assert paired.title.startswith(PAIRED)
    assert usable.title == USABLE_TITLE and list(usable.notes) == [USABLE_NOTE]
    methods = [
        "true",
        *("sad, hazy, paper's", "sad, dehazed, paper's", "ours, hazy, paper's", "ours, dehazed, paper's"),
    ]
    assert list(dict.fromkeys(row[0] for row in lines.rows))[:5] == methods
    assert improved.title == "improvement over sad, hazy, paper's, %" and len(approaches.rows) == len(views.rows) == 2
    for name in ("figure14.png", "figure15.png"):
        assert read_image(tmp_path / "figures" / name).shape[0] == 2 * line_figures.TILE_PX[1]
    capsys.readouterr()
    called.clear()
    assert main(["reproduce", "table6", "--runs", str(tmp_path)]) == 0
    shown = capsys.readouterr().out
    assert all(error in shown for line in table6.PAPER_6.values() for side in line for error in side) and not called


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
