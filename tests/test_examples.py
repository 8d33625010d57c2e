"""The examples run on the shipped approach."""

import runpy
import sys
import zipfile
from pathlib import Path

import pytest

from deckline.cli.run import SAMPLE

EXAMPLES = Path(__file__).parent.parent / "examples"
IMAGE = "images/img_deckline_0_0_7257525084.png"


@pytest.mark.parametrize(
    ("name", "arguments"),
    [("01_frame_to_guidance.py", ["", "14"]), ("04_numpy_frame.py", [IMAGE]), ("05_annotate.py", ["", "14"])],
)
def test_example_prints_guidance(name, arguments, tmp_path, monkeypatch, capsys):
    with zipfile.ZipFile(SAMPLE) as archive:
        archive.extractall(tmp_path)
    first, *others = arguments
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [name, str(tmp_path / first), *others])
    runpy.run_path(str(EXAMPLES / name), run_name="__main__")
    assert "unverified" in capsys.readouterr().out.split()
