import json
import math

import pytest

from deckline.app.cli import main
from deckline.app.simulate import parse_visibility
from deckline.recording import open_source

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
    recording = open_source(out)
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
