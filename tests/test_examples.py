"""The examples run on the shipped approach."""

import runpy
import sys
import zipfile
from pathlib import Path

import pytest

from deckline.cli.run import SAMPLE

EXAMPLES = Path(__file__).parent.parent / "examples"
IMAGE = "images/img_deckline_0_0_6000000000.jpg"


@pytest.mark.parametrize(
    ("name", "arguments"),
    [("01_frame_to_guidance.py", ["", "60"]), ("04_numpy_frame.py", [IMAGE]), ("05_annotate.py", ["", "60"])],
)
def test_example_prints_guidance(name, arguments, tmp_path, monkeypatch, capsys):
    with zipfile.ZipFile(SAMPLE) as archive:
        archive.extractall(tmp_path)
    first, *others = arguments
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [name, str(tmp_path / first), *others])
    runpy.run_path(str(EXAMPLES / name), run_name="__main__")
    assert "unverified" in capsys.readouterr().out.split()


def test_pixel_lines_need_nothing_but_a_picture(tmp_path, monkeypatch, capsys):
    with zipfile.ZipFile(SAMPLE) as archive:
        archive.extract(IMAGE, tmp_path)
    monkeypatch.setattr(sys, "argv", ["10_pixel_lines.py", str(tmp_path / IMAGE)])
    runpy.run_path(str(EXAMPLES / "10_pixel_lines.py"), run_name="__main__")
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].endswith("both lines")
    assert [line.split(":")[0].strip() for line in lines[1:]] == ["left", "right"]
