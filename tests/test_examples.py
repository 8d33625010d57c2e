"""The examples run on the shipped approach."""

import runpy
import sys
import zipfile
from pathlib import Path

import pytest

from deckline.cli.run import SAMPLE

EXAMPLES = Path(__file__).parent.parent / "examples"
IMAGE = "images/img_deckline_0_0_6000000000.jpg"


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """What an example prints of a part of the shipped approach."""

    def printed(name, part, *others):
        with zipfile.ZipFile(SAMPLE) as archive:
            archive.extractall(tmp_path, [part] if part else None)
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", [name, str(tmp_path / part), *others])
        runpy.run_path(str(EXAMPLES / name), run_name="__main__")
        return capsys.readouterr().out

    return printed


@pytest.mark.parametrize(
    "arguments", [("01_frame_to_guidance.py", "", "60"), ("04_numpy_frame.py", IMAGE), ("05_annotate.py", "", "60")]
)
def test_example_prints_guidance(arguments, run):
    assert "unverified" in run(*arguments).split()


def test_pixel_lines_need_nothing_but_a_picture(run):
    lines = run("10_pixel_lines.py", IMAGE).splitlines()
    assert lines[0].endswith("both lines")
    assert [line.split(":")[0].strip() for line in lines[1:]] == ["left", "right"]
