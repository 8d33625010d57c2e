import json
import math
import sys
from dataclasses import dataclass, field, fields

import numpy as np
import pytest

from deckline.cli.main import main
from deckline.cli.sim import RECORDING, SHEET, SimOptions
from deckline.recording import open_recording
from deckline.recording.images import read_image
from deckline.sim import SimConfig
from deckline.sim.record import (
    SheetConfig,
    parse_visibility,
    plain,
    repeatable_command,
    visibility_text,
    what_decides_a_frame,
)

SIM = ["sim", "--frames", "3", "--preset", "cvn", "--visibility", "400..900", "--width", "160", "--height", "90"]


@pytest.mark.parametrize(
    ("text", "expected"),
    [("clear", (math.inf, math.inf)), ("800", (800.0, 800.0)), ("300..3000", (300.0, 3000.0))],
)
def test_visibility_is_one_value_a_range_or_clear(text, expected):
    assert parse_visibility(text) == expected


@pytest.mark.parametrize("text", ["", "fog", "3000..300", "0", "-5..10", "nan"])
def test_other_visibilities_are_refused_by_name(text):
    with pytest.raises(ValueError, match=f"visibility .* got {text!r}"):
        parse_visibility(text)


def test_sim_writes_a_recording_with_poses_depth_and_truth(tmp_path):
    out = tmp_path / "a"
    assert main([*SIM, "--out", str(out), "--seed", "3"]) == 0
    recording = open_recording(out)
    assert len(recording) == 3
    for frame in recording:
        assert frame.world_from_body is not None
        assert frame.depth_m is not None
        assert 400 <= frame.truth.visibility_m <= 900
        assert frame.truth.clear_rgb.shape == (90, 160, 3)


def test_sim_given_again_writes_nothing_new_and_other_settings_are_refused(tmp_path, capsys):
    out = tmp_path / "a"
    main([*SIM, "--out", str(out), "--seed", "3"])
    rows = (out / "airsim_rec.txt").read_bytes()
    assert main([*SIM, "--out", str(out), "--seed", "3"]) == 0
    assert (out / "airsim_rec.txt").read_bytes() == rows
    assert main([*SIM, "--out", str(out), "--seed", "4"]) == 2
    assert "seed" in capsys.readouterr().err


def test_evaluating_a_recording_prints_and_writes_its_figures(tmp_path, capsys):
    out = tmp_path / "a"
    main([*SIM, "--out", str(out), "--seed", "3"])
    assert main(["eval", "recording", str(out), "--json", str(tmp_path / "figures.json")]) == 0
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert figures["frames"] == 3
    assert 0 <= figures["found_rate"] <= 1
    assert figures["psnr_db.mean"] > 0
    assert "found_rate" in capsys.readouterr().out


@pytest.mark.parametrize("text", ["clear", "800", "300..3000"])
def test_visibility_is_written_as_it_is_read(text):
    assert visibility_text(parse_visibility(text)) == text


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--visibility", "fog"], "--visibility: visibility must be metres, LOW..HIGH or clear, got 'fog'"),
        (["--fov-deg", "900"], "fov_deg must lie between 1 and 150, got 900"),
        (["--frames", "x"], "--frames: invalid literal for int"),
        (["--sheet.columns", "0"], "columns must be at least 1, got 0"),
        (["--contact-sheet", "a.png"], "needs --out FOLDER for a recording"),
    ],
)
def test_a_value_out_of_range_is_one_line(words, text, tmp_path, capsys):
    assert main(["sim", "--out", str(tmp_path / "a"), *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("deckline: error: ")
    assert text in line


def test_an_unknown_option_says_what_it_is(tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["sim", "--out", str(tmp_path), "--nope"])
    assert ended.value.code == 2
    assert "--nope" in capsys.readouterr().err


def test_the_commands_options_are_the_simulators(tmp_path):
    assert [item.name for item in fields(SimOptions)] == [item.name for item in fields(SimConfig)]
    assert type(RECORDING.plain()) is SimConfig
    assert (RECORDING.preset, RECORDING.trajectory) == ("paper", "approach")
    assert (SHEET.preset, SHEET.trajectory, SHEET.frames) == ("train", "random", 48)


@dataclass(frozen=True)
class Wind:
    speed_m_s: float = math.inf
    gusts: tuple[float, float] | None = None


@dataclass(frozen=True)
class Windy(SimConfig):
    wind: Wind = field(default_factory=Wind)


def test_what_decides_a_frame_is_plain_at_any_depth():
    values = what_decides_a_frame(Windy(trajectory="random", range_m=(30.0, 60.0)))
    assert values["wind"] == {"speed_m_s": "inf", "gusts": None}
    assert values["visibility_m"] == ["inf", "inf"]
    assert values["range_m"] == [30.0, 60.0]
    json.dumps(values, allow_nan=False)
    assert "length" not in values  # more random views go on with the same recording
    assert what_decides_a_frame(Windy(frames=7))["length"] == 7
    assert plain((1, [math.nan])) == [1, ["nan"]]


@pytest.mark.parametrize("words", [["--out", "x", "--jobs", "3"], ["--jobs=3", "--out=x"]])
def test_the_kept_command_leaves_out_what_does_not_change_the_frames(words, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["/somewhere/deckline", "sim", *words, "--seed", "3"])
    assert repeatable_command() == "deckline sim --seed 3"


def test_contact_sheet_is_one_picture_of_shrunken_frames_and_no_recording(tmp_path):
    out = tmp_path / "new" / "sheet.png"
    words = ["--contact-sheet", str(out), "--frames", "3", "--width", "160", "--height", "90"]
    assert main(["sim", *words, "--sheet.tile-px", "80", "--sheet.columns", "2"]) == 0
    assert [path.name for path in out.parent.iterdir()] == ["sheet.png"]
    sheet = read_image(out)
    assert sheet.shape == (90, 160, 3)
    assert not sheet[45:, 80:].any()
    before = sheet.copy()
    assert main(["sim", *words, "--sheet.tile-px", "80", "--sheet.columns", "2", "--jobs", "2"]) == 0
    np.testing.assert_array_equal(read_image(out), before)


def test_contact_sheet_of_another_kind_is_refused_before_rendering(tmp_path, capsys):
    assert main(["sim", "--contact-sheet", str(tmp_path / "a.gif")]) == 2
    assert "a contact sheet is .png, .jpg, .jpeg, got 'a.gif'" in capsys.readouterr().err


def test_contact_sheet_that_cannot_be_written_is_refused_before_rendering(tmp_path, capsys):
    (tmp_path / "file").write_bytes(b"")
    assert main(["sim", "--contact-sheet", str(tmp_path / "file" / "a.png")]) == 2
    said = capsys.readouterr().err
    assert "deckline: error:" in said and "rendering" not in said


def test_sheet_settings_out_of_range_are_named():
    with pytest.raises(ValueError, match="tile_px must be at least 1, got 0"):
        SheetConfig(tile_px=0)
