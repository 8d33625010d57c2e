from dataclasses import replace

import pytest
from recording_bytes import PIXELS, images, png, recording, row

from deckline.cli.main import main
from deckline.config import Approach, Deck, RunConfig, RunwaySurvey
from deckline.config_file import read_config
from deckline.options import RunOptions
from deckline.recording import RecordingError, open_recording, select_frames
from deckline.recording.convert import add_scene, drop_scene
from deckline.recording.read_options import ReadOptions

STATED = "[deck]\nwidth_m = 20\n[approach]\ntouchdown_m = 80.0\n"


@pytest.fixture
def folder(tmp_path):
    """A folder of two images with a runway.toml."""
    folder = tmp_path / "flight"
    folder.mkdir()
    (folder / "runway.toml").write_text(STATED)
    return images(folder, ["a.png", "b.png"], camera="")


def test_a_recording_states_its_deck(folder):
    source = open_recording(folder)
    assert source.base_config == RunConfig(deck=Deck(width_m=20.0), approach=Approach(touchdown_m=80.0))
    assert select_frames(source, every=2).base_config is source.base_config
    assert "deck.width_m = 20, approach.touchdown_m = 80.0" in source.notes[-1]
    (folder / "runway.toml").write_text("[survey]\nramp_m = [1, 2, -20]\nheading_deg = 9\n")
    assert open_recording(folder).base_config == RunConfig(survey=RunwaySurvey((1.0, 2.0, -20.0), 9.0))
    (folder / "runway.toml").unlink()
    assert open_recording(folder).base_config is None


def test_a_file_has_its_own_or_that_of_its_folder(folder):
    assert open_recording(folder / "a.png").base_config.deck.width_m == 20.0
    (folder / "a.png.runway.toml").write_text("[deck]\nwidth_m = 30\n")
    assert open_recording(folder / "a.png").base_config.deck.width_m == 30.0
    assert open_recording(folder / "b.png").base_config.deck.width_m == 20.0


def test_an_airsim_recording_has_one_and_takes_it_along(tmp_path):
    folder = recording(tmp_path / "a", [row(7)], {"img_Drone_0_0_7.png": png(PIXELS)})
    (folder / "runway.toml").write_text(STATED)
    add_scene(folder, tmp_path / "b", ReadOptions())
    assert open_recording(tmp_path / "b").base_config == open_recording(folder).base_config
    drop_scene(tmp_path / "b", tmp_path / "c")
    assert open_recording(tmp_path / "c").base_config is None


def test_the_file_and_the_options_override_the_recording(folder, tmp_path, capsys):
    (tmp_path / "mine.toml").write_text("[approach]\ntouchdown_m = 90.0\nglideslope_deg = 4.0\n")
    command = ["run", str(folder), "--detector", "ufld", "--dehazer", "none", "--out"]
    assert main([*command, str(tmp_path / "stated")]) == 0
    assert "runway.toml: deck.width_m = 20" in capsys.readouterr().err
    options = ["--config", str(tmp_path / "mine.toml"), "--glideslope-deg", "5"]
    assert main([*command, str(tmp_path / "overridden"), *options]) == 0
    stated, overridden = (read_config(RunConfig, tmp_path / name / "run.toml") for name in ("stated", "overridden"))
    base = RunOptions(detector="ufld", dehazer="none").run_config()
    assert stated == replace(base, deck=Deck(width_m=20.0), approach=Approach(touchdown_m=80.0))
    assert overridden == replace(stated, approach=Approach(5.0, 90.0))


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("[deck]\nwidht_m = 3\n", r"deck\.widht_m.*width_m"),
        ("[dek]\nwidth_m = 3\n", r"dek.*deck"),
        ("[approach]\npoint_m = [1, 2, 3]\n", r"approach\.point_m.*touchdown_m"),
        ("[sensors]\nposition_m = 3\n", "sensors"),
        ("[deck]\nwidth_m = 'wide'\n", r"deck\.width_m.*'wide'"),
        ("[deck]\nwidth_m = -1\n", r"deck\.width_m.*-1"),
        ("deck = 3\n", "deck"),
        ("[deck", "TOML"),
    ],
)
def test_what_is_no_deck_is_named(folder, text, named):
    (folder / "runway.toml").write_text(text)
    with pytest.raises(RecordingError, match=rf"runway\.toml.*{named}"):
        open_recording(folder)
