import json
import os
import re
import subprocess
import sys

import cv2
import numpy as np
import pytest
from PIL import Image

from deckline import __version__
from deckline.cli.main import main

EXAMPLES_IN = {"": 26, "run": 100}  # commands whose help begins with examples -> lines at most


def error_line(capsys) -> str:
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    return lines[0]


def test_an_output_that_nobody_reads_ends_without_a_word():
    code = "from deckline.cli.main import main; raise SystemExit(main(['info']))"
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run([sys.executable, "-c", code], stdout=writer, stderr=subprocess.PIPE, check=False)
    os.close(writer)
    assert (done.returncode, done.stderr) == (141, b"")


def test_any_other_pipe_that_breaks_is_an_error(monkeypatch, capsys):
    def break_pipe(*_args: object) -> int:
        raise BrokenPipeError("the simulator went away")

    monkeypatch.setattr("deckline.cli.main._run_command", break_pipe)
    assert main(["info"]) == 2
    assert "the simulator went away" in error_line(capsys)


def test_odd_pictures_without_a_camera_are_not_seen_or_named_in_one_line(tmp_path, capsys):
    folder, noise = tmp_path / "odd", np.random.default_rng(0).integers(0, 256, (90, 160, 3), np.uint8)
    folder.mkdir()
    sizes = {"one": (1, 1), "portrait": (160, 90), "square": (90, 90), "strip": (4, 900), "large": (1080, 1920)}
    pictures = {name: np.full((*size, 3), 90, np.uint8) for name, size in sizes.items()}
    pictures |= {"noise": noise, "deep": noise.astype(np.uint16) * 257, "grey": noise[..., 0], "black": 0 * noise}
    for name, picture in pictures.items():
        cv2.imwrite(str(folder / f"{name}.png"), picture)
    Image.fromarray(noise).convert("CMYK").save(folder / "cmyk.jpg")
    Image.fromarray(noise).save(folder / "gif.jpg", format="GIF")
    (folder / "text.jpg").write_text("no picture")
    (folder / "cut.jpg").write_bytes((folder / "cmyk.jpg").read_bytes()[:-999])
    assert main(["run", str(folder), "--out", str(tmp_path / "out"), "--dehazer", "none"]) == 0
    rows = [json.loads(line) for line in (tmp_path / "out" / "guidance.jsonl").read_text().splitlines()]
    skipped = {row["file"] for row in rows if "skipped" in row}
    assert skipped == {"gif.jpg", "text.jpg", "cut.jpg"}
    assert {row["status"] for row in rows if "skipped" not in row} == {"not seen"} and len(rows) == 13
    errors = capsys.readouterr().err
    assert errors.count("no camera file") == 1 and "Traceback" not in errors
    assert all(errors.count(f"skipped {name}: ") == 1 for name in skipped)


@pytest.mark.parametrize("group", [[], ["eval"], ["train"]])
def test_a_group_without_its_command_names_those_there_are(group, capsys):
    with pytest.raises(SystemExit) as end:
        main(group)
    assert end.value.code == 2
    assert "--help" in capsys.readouterr().err


@pytest.mark.parametrize(("words", "name", "near"), [(["rnu"], "rnu", "run"), (["eval", "chian"], "chian", "chain")])
def test_an_unknown_command_is_one_line_with_the_nearest_name(words, name, near, capsys):
    assert main(words) == 2
    assert re.search(rf"'{name}'.*'{near}'", error_line(capsys))


@pytest.mark.parametrize("command", ["demo", "sim", "dataset", "info", "", "run"])
def test_every_command_has_help_that_begins_with_examples(command, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "100")
    with pytest.raises(SystemExit) as end:
        main([*command.split(), "--help"])
    lines = capsys.readouterr().out.splitlines()
    assert end.value.code == 0
    assert f"deckline {command}".strip() in lines[0]
    if command not in EXAMPLES_IN:
        return
    assert len(lines) <= EXAMPLES_IN[command]
    first = lines.index("examples:")
    assert first <= 3
    assert all(line.startswith("  deckline ") for line in lines[first + 1 : first + 3])


def test_info_lists_the_checked_weights_and_version_the_version(capsys):
    assert main(["info"]) == 0
    text = capsys.readouterr().out
    assert "(checked)" in text
    assert "processor: " in text
    assert re.search(r"^  cpu +f32$", text, re.M)
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"deckline {__version__}\n"


@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="one core has no idle threads")
def test_a_command_leaves_the_cores_to_the_networks():
    run = "from deckline.cli.main import main; main(['--version'])"
    count = "import os, numpy; print(len(os.listdir('/proc/self/task')))"
    command = [sys.executable, "-c", f"{run}; {count}"]
    unset = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    for given, threads in (({}, 1), ({"OPENBLAS_NUM_THREADS": "2"}, 2)):
        done = subprocess.run(command, env=unset | given, capture_output=True, text=True, check=True)
        assert int(done.stdout.split()[-1]) == threads


@pytest.mark.parametrize(("text", "line"), [("", "deckline: stopped"), ("3 rows", "deckline: stopped: 3 rows")])
def test_ctrl_c_ends_with_130_and_the_text_of_the_command(text, line, monkeypatch, capsys):
    def interrupt(*_args: object) -> None:
        raise KeyboardInterrupt(*filter(None, [text]))

    monkeypatch.setattr("deckline.cli.main._run_command", interrupt)
    assert main(["info"]) == 130
    assert error_line(capsys) == line
