"""`deckline eval joined` on one short approach."""

import json

import cv2

from deckline.cli.main import main


def test_several_frames_are_compared_with_one(tmp_path):
    out, figure = tmp_path / "joined.json", tmp_path / "joined.png"
    command = ["eval", "joined", "--approaches", "1", "--frames", "3", "--visibility", "3000"]
    assert main([*command, "--figure", str(figure), "--json", str(out)]) == 0
    figures = json.loads(out.read_text())
    assert figures["3000.still.one: right"] == 1
    assert figures["3000.still.joined: beside"] == 0
    assert cv2.imread(str(figure)).std() > 10
