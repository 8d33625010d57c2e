import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from deckline.cli.main import main
from deckline.evaluation.flicker import clear_picture, without_truth
from deckline.evaluation.flicker_score import flicker_figures, sequence_errors
from deckline.recording import RecordingWriter, open_recording
from deckline.sim import SimConfig, frames
from deckline.sim.config import DepthConfig
from deckline.types import Frame

COUNT = 4


@pytest.fixture(scope="module")
def approach(tmp_path_factory: pytest.TempPathFactory) -> Path:
    config = SimConfig(
        frames=COUNT,
        width=320,
        height=180,
        start_m=300,
        end_m=290,
        visibility_m=(700.0, 700.0),
        depth=DepthConfig(range_m=np.inf),
    )
    folder = tmp_path_factory.mktemp("approach") / "recording"
    with RecordingWriter(folder, scene={}) as writer:
        for frame in frames(config):
            writer.add(frame)
    return folder


def first_frame(folder: Path) -> Frame:
    frame = open_recording(folder).load(0)
    assert isinstance(frame, Frame)
    return frame


def test_the_table_and_the_file_say_what_the_functions_do(approach, tmp_path, capsys):
    file = tmp_path / "figures.json"
    assert main(["eval", "flicker", str(approach), "--dehazer", "none", "dark-channel", "--json", str(file)]) == 0
    figures = json.loads(file.read_text())
    expected = flicker_figures(
        list(sequence_errors((f, {"clear": f.truth.clear_rgb, "none": f.image_rgb}) for f in open_recording(approach))),
        truth="clear",
    )
    assert figures["pairs"] == COUNT - 1
    for name, value in expected.items():
        assert figures[name] == pytest.approx(value)
    assert figures["dark-channel.sky.flicker"] > figures["none.sky.flicker"]
    printed = capsys.readouterr().out
    for words in (f"pairs of frames: {COUNT - 1}", "deck", "water", "sky", "dark-channel"):
        assert words in printed
    assert f"{expected['none.deck.rmse']:.2f}" in printed


def test_every_and_limit_choose_frames(approach, tmp_path):
    file = tmp_path / "figures.json"
    for options, pairs in ((["--every", "3"], 1), (["--limit", "2"], 1), (["--every", "2", "--limit", "9"], 1)):
        assert main(["eval", "flicker", str(approach), "--dehazer", "none", "--json", str(file), *options]) == 0
        assert json.loads(file.read_text())["pairs"] == pairs


def test_a_frame_that_cannot_be_read_parts_its_neighbours(approach, tmp_path, capsys):
    broken = tmp_path / "broken"
    broken.mkdir()
    for path in approach.rglob("*"):
        if path.is_file():
            target = broken / path.relative_to(approach)
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(path.read_bytes())
    name = open_recording(broken).load(1).file
    (broken / "images" / name).write_bytes(b"cut")
    assert main(["eval", "flicker", str(broken), "--dehazer", "none"]) == 0
    said = capsys.readouterr()
    assert f"skipped {name}" in said.err
    assert "pairs of frames: 1," in said.out  # 3 frames are left; the first stands alone


def test_a_dehazer_sees_no_truth_and_only_near_depth(approach):
    frame = first_frame(approach)
    assert np.nanmax(frame.depth_m) > 1000
    flown = without_truth(frame, 200.0)
    assert flown.truth is None
    near = frame.depth_m <= 200.0
    np.testing.assert_array_equal(flown.depth_m[near], frame.depth_m[near])
    assert np.isnan(flown.depth_m[~near]).all()
    assert without_truth(frame, 0.0).depth_m is None
    np.testing.assert_array_equal(flown.image_rgb, frame.image_rgb)


def test_clear_air_is_its_own_truth(approach):
    frame = first_frame(approach)
    np.testing.assert_array_equal(clear_picture(frame), frame.truth.clear_rgb)
    fair = replace(frame, truth=replace(frame.truth, clear_rgb=None, visibility_m=np.inf))
    assert clear_picture(fair) is fair.image_rgb
    with pytest.raises(ValueError, match="no picture without haze to compare with; record with deckline sim"):
        clear_picture(replace(frame, truth=None))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--every", "0"], "--every must be at least 1, got 0"),
        (["--limit", "1"], "--limit must be at least 2, got 1"),
        (["--camera-depth-m", "-5"], "--camera-depth-m must be at least 0, got -5"),
        (["--dehazer", "fog-lamp"], "unknown dehazer 'fog-lamp': use one of none, dark-channel"),
        (["--dehazer", "clear/dehaze.onnx"], "clear/dehaze.onnx would be called clear, as the truth is"),
        (["--dehazer", "a/b.onnx", "c/b.onnx"], "a/b.onnx and c/b.onnx would both be called b"),
        (["--every", "9"], "no two frames follow each other"),
    ],
)
def test_wrong_use_is_one_line(approach, capsys, options, words):
    assert main(["eval", "flicker", str(approach), *options]) == 2
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("deckline: error")]
    assert len(lines) == 1
    assert words in lines[0]


def test_a_folder_without_poses_is_one_line(tmp_path, approach, capsys):
    (tmp_path / "camera.toml").write_text("width = 320\nheight = 180\nfx = 160.0\nfy = 160.0\ncx = 159.5\ncy = 89.5\n")
    image = next((approach / "clear").glob("*.png"))
    for name in ("a.png", "b.png"):
        (tmp_path / name).write_bytes(image.read_bytes())
    assert main(["eval", "flicker", str(tmp_path), "--dehazer", "none"]) == 2
    assert "a.png: no picture without haze" in capsys.readouterr().err
