"""`deckline eval joined` on one short approach."""

import json

import cv2
import pytest

from deckline.cli.main import main


def test_several_frames_are_compared_with_one(tmp_path):
    out, figure = tmp_path / "joined.json", tmp_path / "joined.png"
    command = ["eval", "joined", "--approaches", "1", "--frames", "3", "--visibility", "3000"]
    assert main([*command, "--figure", str(figure), "--json", str(out)]) == 0
    figures = json.loads(out.read_text())
    assert figures["3000.still.one: right"] == 1
    assert figures["3000.still.joined: beside"] == 0
    assert cv2.imread(str(figure)).std() > 10


def test_thicker_haze_is_seen_through_from_nearer(tmp_path):
    out = tmp_path / "joined.json"
    command = ["eval", "joined", "--approaches", "1", "--frames", "3", "--visibility", "300", "--json", str(out)]
    right = []
    for range_m in ("150", "600"):
        assert main([*command, "--range-m", range_m]) == 0
        right.append(json.loads(out.read_text())["300.still.one: right"])
    assert right == [1, 0]


@pytest.mark.parametrize("range_m", ["0", "-5", "nan"])
def test_an_impossible_range_is_named(range_m, capsys):
    assert main(["eval", "joined", "--range-m", range_m]) != 0
    assert "range-m" in capsys.readouterr().err
