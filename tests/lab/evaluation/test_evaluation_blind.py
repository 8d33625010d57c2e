"""Blind sheets: their panels, their key, and the count of votes against one by hand."""

import csv
import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from hazy_recording import measured, run, write_recording
from refused import refuse

from deckline.dehaze.base import IdentityDehazer
from deckline.geometry import Camera
from deckline.types import Frame
from deckline_lab.evaluation.blind import (
    CONTROL_EVERY,
    GAP_PX,
    PANEL_PX,
    Vote,
    count_votes,
    draw_sheet,
    parse_order,
    read_votes,
    write_blind_sheets,
)
from deckline_lab.evaluation.dehazing_pairs import Pair, PairSource

LEVELS = {"none": 60, "brighter": 120, "darker": 20}
PANELS = {"A": "x", "B": "none"}


class Shift:
    """A dehazer that adds levels."""

    def __init__(self, levels: int) -> None:
        self.name, self.levels = "shift", levels

    def __call__(self, image_rgb: np.ndarray) -> np.ndarray:
        return (image_rgb.astype(int) + self.levels).astype(np.uint8)


DEHAZERS = {"none": IdentityDehazer(), "brighter": Shift(60), "same": IdentityDehazer(), "darker": Shift(-40)}


def load(key: str) -> Pair:
    image = np.full((90, 160, 3), LEVELS["none"], np.uint8)
    return Pair(Frame(f"{key}.png", 0.0, image, Camera.unknown(160, 90)), None, None, float("nan"), None)


SOURCE = PairSource("s", tuple("abcd"), load)


def write(out: Path, panels: int = 2, seed: int = 0) -> dict:
    write_blind_sheets(out, [SOURCE], DEHAZERS, panels, np.random.default_rng(seed))
    return json.loads((out / "key.json").read_text())


def vote(out: Path, orders: dict[str, str], file: str = "votes.csv") -> None:
    rows = [f"{number},{order}" for number, order in orders.items()]
    (out / file).write_text("\n".join(["sheet,order", *rows]))


@pytest.mark.parametrize(("panels", "sheets"), [(2, 12 + 2), (3, 4 + 1), (9, 4 + 1)])
def test_every_combination_has_a_sheet_whose_panels_the_key_names(tmp_path: Path, panels: int, sheets: int) -> None:
    key = write(tmp_path, panels)
    assert len(key) == sheets == len(list((tmp_path / "sheets").glob("*.png")))
    controls = 0
    for number, sheet in key.items():
        image = cv2.imread(str(tmp_path / "sheets" / f"{number}.png"))
        for k, name in enumerate(sheet["panels"].values()):
            v, u = (np.array(divmod(k, 2)) * [90 + GAP_PX, 160 + GAP_PX] + GAP_PX + 80).tolist()
            assert (image[v, u] == LEVELS[name]).all()
        controls += len(set(sheet["panels"].values())) < len(sheet["panels"])
    assert controls == -(-(sheets - controls) // CONTROL_EVERY)
    with (tmp_path / "votes.csv").open() as file:
        assert [row["sheet"] for row in csv.DictReader(file)] == sorted(key)


def test_the_seed_decides_orders_and_numbers(tmp_path: Path) -> None:
    first, again, other = (write(tmp_path / name, seed=seed) for name, seed in (("a", 1), ("b", 1), ("c", 2)))
    assert first == again != other
    letters = {tuple(sheet["panels"].values()).index("none") for sheet in first.values() if "none" in str(sheet)}
    assert letters == {0, 1}
    with pytest.raises(ValueError, match=re.escape(str(tmp_path / "a"))):
        write(tmp_path / "a")
    with pytest.raises(ValueError, match="no sheets"):
        write_blind_sheets(tmp_path / "d", [SOURCE], {"same": IdentityDehazer()}, 2, np.random.default_rng(0))


def test_large_pictures_are_made_smaller() -> None:
    images = [np.full((1200, 1920, 3), level, np.uint8) for level in (10, 20)]
    assert draw_sheet(images).shape == (600 + 2 * GAP_PX, 2 * PANEL_PX + 3 * GAP_PX, 3)


def test_votes_are_counted_as_by_hand() -> None:
    four = {"A": "none", "B": "x", "C": "y", "D": "x"}
    votes = [
        Vote("1", PANELS, {"A": 0, "B": 1}),  # x above the input
        Vote("2", PANELS, {"B": 0}),  # x below it, which the vote leaves out
        Vote("3", PANELS, {"A": 0, "B": 0}),
        Vote("4", {"A": "y", "B": "y"}, {"A": 1, "B": 0}),  # a control taken for two
        Vote("5", four, {"C": 0, "A": 1, "B": 2, "D": 2}),  # y, input, both x
    ]
    counts = count_votes(votes)
    columns = ("first", "second", "first_preferred", "same", "second_preferred")
    rows = [tuple(pair[column] for column in columns) for pair in counts["pairs"]]
    assert rows == [("x", "none", 1, 1, 3), ("x", "y", 0, 0, 2), ("y", "none", 1, 0, 0)]
    assert counts["worse_than_input"] == {"x": ["2", "5"]}
    assert (counts["controls"], counts["told_apart"]) == (2, 1)


def test_letters_that_a_vote_leaves_out_are_below_and_not_compared() -> None:
    counts = count_votes([Vote("1", {"A": "x", "B": "y", "C": "none"}, {"B": 0})])
    assert [(pair["first"], pair["second"]) for pair in counts["pairs"]] == [("x", "y"), ("y", "none")]


@pytest.mark.parametrize(("text", "ranks"), [("A>B", {"A": 0, "B": 1}), (" b = a ", {"A": 0, "B": 0}), ("b", {"B": 0})])
def test_orders_are_read(text: str, ranks: dict) -> None:
    assert parse_order(text, PANELS, "here") == ranks


@pytest.mark.parametrize("text", ["C", "A>A", "A>", ">", "A B", "better"])
def test_orders_that_are_none_are_named(text: str) -> None:
    with pytest.raises(ValueError, match=rf"^here:.*{re.escape(repr(text))}"):
        parse_order(text, PANELS, "here")


def test_bad_votes_are_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    number = next(iter(write(tmp_path / "sheets")))
    for orders, message in (
        ({number: "Q"}, f"votes.csv: sheet {number}: "),
        ({"7": "A"}, "'7'"),
        ({number: " "}, str(tmp_path / "sheets")),
    ):
        vote(tmp_path / "sheets", orders)
        assert message in refuse(capsys, "dehazing", "--votes", tmp_path / "sheets")
    (tmp_path / "sheets" / "votes.csv").write_text(f"sheet;order\n{number};A\n")
    assert "sheet,order" in refuse(capsys, "dehazing", "--votes", tmp_path / "sheets")
    assert str(tmp_path / "key.json") in refuse(capsys, "dehazing", "--votes", tmp_path)
    assert "--votes" in refuse(capsys, "dehazing", tmp_path, "--votes", tmp_path)


def test_sheets_are_written_judged_and_counted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "blind"
    recording = write_recording(tmp_path / "hazy", clear_too=False)
    assert run(recording, "--detector", "none", "--dehazer", "dark-channel", "--blind", out) == 0
    assert "5 sheets to judge" in capsys.readouterr().out.replace("\n", "")
    assert str(out) in refuse(
        capsys, "dehazing", recording, "--detector", "none", "--dehazer", "dark-channel", "--blind", out
    )
    key = json.loads((out / "key.json").read_text())
    best = {n: "AB"[list(sheet["panels"].values()).index("dark-channel")] for n, sheet in key.items()
            if len(set(sheet["panels"].values())) == 2}  # fmt: skip
    vote(out, best)
    (control,) = key.keys() - best.keys()
    vote(out, {control: "A=B", next(iter(best)): ""}, "votes-second.csv")
    votes, empty = read_votes(out)
    assert (len(votes), empty) == (5, 1)
    counts = measured(tmp_path / "votes.json", "--votes", out)
    (pair,) = counts["pairs"]
    assert (pair["first"], pair["first_preferred"], pair["second_preferred"]) == ("dark-channel", 4, 0)
    assert (counts["controls"], counts["told_apart"], counts["not_judged"]) == (1, 0, 1)
    assert "Control pairs told apart: 0 of 1." in capsys.readouterr().out
