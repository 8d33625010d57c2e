import json
from pathlib import Path

import numpy as np
import pytest
from hazy_recording import HORIZON_ROW, measured, pictures, run, write_network, write_recording
from refused import refuse
from skimage.metrics import peak_signal_noise_ratio

import deckline
from deckline_lab.evaluation.dehazing import SCORES_FILE
from deckline_lab.evaluation.no_reference import no_reference_figures, summarise_no_reference
from deckline_lab.rivals.dark_channel import DarkChannelDehazer


@pytest.fixture
def recording(tmp_path) -> Path:
    return write_recording(tmp_path / "recording")


def rows_of(folder: Path) -> list[dict]:
    lines = [json.loads(line) for line in (folder / SCORES_FILE).read_text().splitlines()]
    return [line["row"] for line in lines if "row" in line]


def test_rows_agree_with_a_direct_computation(recording, tmp_path, capsys):
    out = tmp_path / "out"
    found = measured(tmp_path / "f.json", recording, "--dehazer", "dark-channel", "--detector", "none", "--out", out)
    dark = DarkChannelDehazer()
    expected = {"none": [], "dark-channel": []}
    for index in range(4):
        clear, hazy, _ = pictures(index)
        for name, image in (("none", hazy), ("dark-channel", dark(hazy))):
            whole = peak_signal_noise_ratio(clear, image)
            expected[name].append((whole, peak_signal_noise_ratio(clear[HORIZON_ROW:], image[HORIZON_ROW:])))
    rows = rows_of(out)
    assert [row["dehazer"] for row in rows] == ["none", "dark-channel"] * 4
    for name, values in expected.items():
        mine = [
            (row["figures"]["psnr_db"], row["figures"]["psnr_db_surface"]) for row in rows if row["dehazer"] == name
        ]
        np.testing.assert_allclose(mine, values, atol=1e-9)
        means = found["visibility"]["all"][name]["means"]
        assert [means["psnr_db"], means["psnr_db_surface"]] == pytest.approx(np.mean(values, axis=0))
    difference = found["visibility"]["all"]["dark-channel"]["differences"]["psnr_db"]
    gains = np.subtract(expected["dark-channel"], expected["none"])[:, 0]
    assert difference["value"] == pytest.approx(gains.mean())
    assert gains.min() <= difference["low"] <= difference["value"] <= difference["high"] <= gains.max()
    assert list(found["visibility"]) == ["all", "150-300 m", "500-1000 m", "3000+ m"]
    assert found["visibility"]["150-300 m"]["none"]["images"] == 2
    assert found["size"] == {"none": None, "dark-channel": None}
    text = capsys.readouterr().out
    assert "below horizon, dB" in text and "Lines" not in text and f"deckline {deckline.__version__}" in text


def test_every_other_pair_and_the_markdown_of_the_same_numbers(recording, tmp_path):
    file = tmp_path / "t.md"
    arguments = ("--detector", "none", "--every", 2, "--dehazer", "none", "--markdown", file)
    found = measured(tmp_path / "f.json", recording, *arguments)
    means = found["visibility"]["all"]["none"]
    assert means["images"] == 2
    row = next(line for line in file.read_text().splitlines() if line.startswith("| none | 2 |"))
    assert row.split(" | ")[2] == f"{means['means']['psnr_db']:.2f}"
    assert "| 500-1000 m | none | 1 |" in file.read_text()


def test_a_stopped_command_goes_on_and_gives_the_same_numbers(recording, tmp_path, monkeypatch):
    arguments = (recording, "--detector", "none", "--dehazer", "dark-channel")
    whole = measured(tmp_path / "whole.json", *arguments)
    out, calls = tmp_path / "out", []
    inside = DarkChannelDehazer.__call__

    def stopped(self, image_rgb):
        calls.append(1)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return inside(self, image_rgb)

    with monkeypatch.context() as patch:
        patch.setattr(DarkChannelDehazer, "__call__", stopped)
        assert run(*arguments, "--out", out) == 130
    assert len(rows_of(out)) == 5
    with (out / SCORES_FILE).open("a") as file:
        file.write('{"key": ["half a l')
    with monkeypatch.context() as patch:
        patch.setattr(DarkChannelDehazer, "__call__", lambda self, image: calls.append(1) or inside(self, image))
        resumed = measured(tmp_path / "resumed.json", *arguments, "--out", out)
    assert len(calls) == 3 + 2
    assert len(rows_of(out)) == 8
    again = measured(tmp_path / "again.json", *arguments, "--out", out)
    numbers = whole.keys() - {"_command"}
    assert all(resumed[name] == again[name] == whole[name] for name in numbers)


def test_more_dehazers_are_added_and_rows_of_other_settings_refused(recording, tmp_path, capsys):
    out = tmp_path / "out"
    assert run(recording, "--detector", "none", "--dehazer", "none", "--out", out) == 0
    before = (out / SCORES_FILE).read_text()
    found = measured(tmp_path / "f.json", recording, "--detector", "none", "--dehazer", "dark-channel", "--out", out)
    assert list(found["visibility"]["all"]) == ["none", "dark-channel"]
    assert (out / SCORES_FILE).read_text().startswith(before) and len(rows_of(out)) == 8
    for more, what in ((("--every", 3), "every"), (("--with-depth",), "with_depth"), (("--deck-z-m", -5), "deck_z_m")):
        assert f" {what} " in refuse(
            capsys, "dehazing", recording, "--detector", "none", "--dehazer", "none", "--out", out, *more
        )
    (out / SCORES_FILE).write_text('{"file": "guidance of another command"}\n')
    assert SCORES_FILE in refuse(capsys, "dehazing", recording, "--detector", "none", "--dehazer", "none", "--out", out)


def test_a_damaged_frame_is_skipped_counted_and_named(recording, tmp_path, capsys):
    second = sorted((recording / "images").glob("*.png"), key=lambda path: path.stat().st_mtime_ns)[1]
    second.write_bytes(second.read_bytes()[:100])
    found = measured(tmp_path / "f.json", recording, "--detector", "none", "--dehazer", "none")
    assert found["visibility"]["all"]["none"]["images"] == 3
    assert len(found["skipped"]) == 1 and second.name in found["skipped"][0][0]
    assert "skipped 1; the first:" in capsys.readouterr().out


def test_pictures_without_clear_ones_get_figures_without_reference(tmp_path, capsys):
    recording = write_recording(tmp_path / "hazy", clear_too=False)
    for source in (recording, recording / "images"):
        found = measured(tmp_path / "f.json", source, "--detector", "none", "--dehazer", "dark-channel")
        summary = found["visibility"]["all"]["dark-channel"]
        assert summary["means"] == {} and summary["images"] == 4
        dark = DarkChannelDehazer()
        figures = [no_reference_figures(dark(pictures(index)[1]), pictures(index)[1]) for index in range(4)]
        assert summary["no_reference"] == pytest.approx(summarise_no_reference(figures))
        untouched = found["visibility"]["all"]["none"]["no_reference"]
        assert untouched["gradient_ratio.worst"] == 1.0 and untouched["worse_than_input"] == 0.0
        text = capsys.readouterr().out
        assert "Without a clear picture" in text and "PSNR" not in text


def test_a_recording_of_which_no_frame_is_left_is_one_line(recording, capsys):
    for path in (recording / "clear").glob("*"):
        path.unlink()
    error = refuse(capsys, "dehazing", recording, "--detector", "none", "--dehazer", "none")
    assert "none of 4" in error and "clear" in error


def test_a_network_is_called_after_its_folder_and_its_size_is_shown(recording, tmp_path, capsys):
    path = write_network(tmp_path / "net" / "dehaze.onnx")
    found = measured(tmp_path / "f.json", recording, "--detector", "none", "--full-size", "--dehazer", path)
    assert found["size"] == {"none": None, "net": {"parameters": 484_000, "macs_256": 2_600_000_000}}
    assert found["visibility"]["all"]["net"]["differences"]["psnr_db"]["value"] == 0.0
    text = capsys.readouterr().out
    assert "0.484 M" in text and "2.60 G" in text
