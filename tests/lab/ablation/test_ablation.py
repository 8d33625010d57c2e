"""`deckline eval ablation` on a tiny dataset: what differs between the rows, their training, and the table."""

import json
import re
import shutil
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from clear_scene import QUICK, clear_recording, hazy_recording, interrupting
from deckline.cli.main import main
from deckline.config import Engine
from deckline.dehaze import OnnxDehazer
from deckline.recording import open_recording
from deckline_lab.ablation.rows import ROWS, check_pairs, is_finished, row_recipe
from deckline_lab.ablation.table import HAZY, measure, summarise_rows
from deckline_lab.evaluation.metrics import psnr_db, ssim
from deckline_lab.evaluation.store import Store
from deckline_lab.train import loop
from deckline_lab.train.checkpoint import read_progress
from deckline_lab.train.dehaze import build_ours
from deckline_lab.train.dehaze_samples import make_batch
from deckline_lab.train.export import network_cost
from deckline_lab.train.pair_views import open_clear_views

TINY = replace(QUICK, steps=2)
OPTIONS = ["--steps", "2", "--crop-height", "48", "--crop-width", "64", "--threads", "1", "--device", "cpu"]


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dataset")
    for split, frames in (("train", 12), ("test", 3)):
        hazy_recording(folder / split, frames)
    return folder


@pytest.fixture(scope="module")
def trained(dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The command's folder."""
    out = tmp_path_factory.mktemp("rows")
    assert main(["eval", "ablation", str(dataset), "--out", str(out), *OPTIONS]) == 0
    return out


def test_every_row_adds_one_part() -> None:
    parts = [(row.attention, row.transformer, row.augmented) for row in ROWS]
    assert (parts[0], parts[-1]) == (("depthwise", "plain", False), ("mix", "mobilevit", True))
    for above, below in pairwise(parts):
        assert sum(a != b for a, b in zip(above, below, strict=True)) == 1


@pytest.mark.parametrize(("row", "as_recorded"), [(ROWS[2], True), (ROWS[3], False)], ids=["plain", "augmented"])
def test_rows_without_augmentation_see_each_pair_as_it_was_recorded(row, as_recorded: bool, dataset: Path) -> None:
    recipe = row_recipe(row, replace(TINY, crop_height=64, crop_width=96))  # crops as large as the pictures
    views = open_clear_views([dataset / "train"], 640, 0.0)
    recorded = {(views[k].clear_rgb.tobytes(), np.asarray(views[k].hazy_rgb).tobytes()) for k in range(len(views))}
    for step in range(4):
        hazy, clear, *_ = make_batch(views, 2, (64, 96), recipe.haze, [0, step], False)
        for images in zip(clear, hazy, strict=True):
            drawn = tuple((255 * x).round().byte().permute(1, 2, 0).numpy().tobytes() for x in images)
            assert (drawn in recorded) == as_recorded


def test_the_table_holds_the_figures_of_the_trained_networks(dataset: Path, trained: Path) -> None:
    table = json.loads((trained / "ablation.json").read_text())
    assert [row["row"] for row in table["rows"]] == [HAZY, *(row.key for row in ROWS)]
    test, above = open_recording(dataset / "test"), None
    images = [test.load(k) for k in range(3)]
    clear = [np.asarray(frame.truth.clear_rgb) for frame in images if frame.truth is not None]
    for row, entry in zip([None, *ROWS], table["rows"], strict=True):
        dehazer = None if row is None else OnnxDehazer(trained / row.key / "dehaze.onnx", engine=Engine(threads=1))
        pictures = [frame.image_rgb if dehazer is None else dehazer(frame.image_rgb) for frame in images]
        pairs = list(zip(pictures, clear, strict=True))
        psnr = [psnr_db(a, b) for a, b in pairs]
        assert entry["psnr_db"] == pytest.approx(np.mean(psnr))
        assert entry["psnr_db_surface"] == pytest.approx(np.mean([psnr_db(a[16:], b[16:]) for a, b in pairs]))
        assert entry["ssim"] == pytest.approx(np.mean([ssim(a, b) for a, b in pairs]))
        if row is not None and above is not None and dehazer is not None:
            gain, cost = entry["gains"]["psnr_db"], network_cost(build_ours(row_recipe(row, TINY)))
            assert gain["value"] == pytest.approx(np.mean(np.subtract(psnr, above)))
            assert gain["low"] <= gain["value"] <= gain["high"]
            assert (entry["parameters"], entry["macs_256"], entry["steps"]) == (cost.parameters, cost.macs, 2)
            network, haze = dehazer.session.config["network"], dehazer.session.config["recipe"]["haze"]
            assert (network["attention"], network["transformer"]) == (row.attention, row.transformer)
            assert haze["recorded_share"] == (0.0 if row.augmented else 1.0)
        above = psnr
    markdown = (trained / "ablation.md").read_text()
    assert "| row | PSNR, dB | gain [95 %] |" in markdown
    assert f"{table['rows'][1]['psnr_db']:.2f}" in markdown
    assert f"{table['rows'][1]['parameters'] / 1e6:.3f}" in markdown


def test_rows_are_trained_and_measured_once(
    dataset: Path, trained: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    command = ["eval", "ablation", str(dataset), "--out", str(trained), *OPTIONS]
    before = {path: path.read_bytes() for path in trained.rglob("*") if path.suffix in (".onnx", ".jsonl")}
    assert main(command) == 0
    assert capsys.readouterr().out.count("finished before") == 4
    assert {path: path.read_bytes() for path in before} == before
    assert main([*command, "--batch", "1"]) == 2
    assert "images.jsonl was made with batch 2, not 1" in capsys.readouterr().err
    # A row that is missing is trained again, from where Ctrl-C stopped it.
    last = trained / ROWS[-1].key
    shutil.rmtree(last)
    monkeypatch.setattr(loop, "_step", interrupting(loop._step, at=1))
    assert main(command) == 130
    monkeypatch.undo()
    progress = read_progress(last)
    assert progress is not None and progress["step"] == 1
    assert not is_finished(TINY, last)
    assert main(command) == 0
    assert is_finished(TINY, last)


def test_damaged_test_frames_are_skipped(dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copytree(dataset / "test", tmp_path / "test")
    images = sorted((tmp_path / "test" / "images").glob("*.ppm"))
    images[1].write_bytes(b"P6")
    scores = measure({HAZY: None}, open_recording(tmp_path / "test"), range(3), Store(None, "images.jsonl", {}))
    assert list(scores[HAZY]) == [0, 2]
    assert f"skipped {images[1].name}" in capsys.readouterr().err


def test_pictures_without_haze_are_no_pairs(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"clear.*0"):
        check_pairs(clear_recording(tmp_path / "clear", frames=2), 0.5)
    bad = hazy_recording(tmp_path / "bad", frames=1)
    next((bad / "images").glob("*_0_*")).write_bytes(b"P6")
    for held_out in (1.0, 0.05):  # none can be read; too few to hold any out
        with pytest.raises(ValueError, match=str(bad)):
            check_pairs(bad, held_out)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], r"--minutes.*--steps"),
        (["--steps", "0"], r"steps.*0"),
        (["--steps", "1", "--every", "0"], r"--every.*0"),
        (["--steps", "1", "--recorded-share", "2"], r"recorded_share.*2"),
    ],
)
def test_bad_input_is_one_line(
    options: list[str], message: str, dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["eval", "ablation", str(dataset), "--out", str(tmp_path / "out"), *options]) == 2
    error = capsys.readouterr().err
    assert re.search(message, error)
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_each_row_gains_over_the_one_above() -> None:
    first = {0: {"psnr_db": 20.0, "ssim": 0.8}, 1: {"psnr_db": 22.0, "ssim": 0.9}}
    second = {0: {"psnr_db": 21.0, "ssim": 0.8}, 1: {"psnr_db": 24.0, "ssim": 0.8}}
    third = {0: {"psnr_db": 20.5, "ssim": 0.8}, 1: {"psnr_db": 23.5, "ssim": 0.8}}
    a, b, c = summarise_rows({"a": first, "b": second, "c": third})
    assert a == {"row": "a", "images": 2, "psnr_db": 21.0, "ssim": pytest.approx(0.85), "gains": {}}
    # Resampling two images gives 1, 1.5 or 2.
    assert b["gains"]["psnr_db"] == {"value": 1.5, "low": 1.0, "high": 2.0, "images": 2}
    assert c["gains"]["psnr_db"]["value"] == -0.5  # against b, not a


def test_gains_count_the_images_of_both_rows_alone() -> None:
    rng = np.random.default_rng(0)
    above = {k: {"psnr_db": float(rng.uniform(15, 30))} for k in range(50)}
    row = {k: {"psnr_db": figures["psnr_db"] + 0.5} for k, figures in above.items() if k % 2} | {99: {"psnr_db": 60.0}}
    gain = summarise_rows({"above": above, "row": row})[1]["gains"]["psnr_db"]
    assert gain["images"] == 25
    assert [gain[part] for part in ("value", "low", "high")] == pytest.approx([0.5] * 3)


def test_a_figure_that_does_not_exist_is_left_out_and_a_row_without_images_is_refused() -> None:
    a, b = summarise_rows({"a": {0: {"psnr_db": 20.0}}, "b": {0: {"psnr_db": 21.0, "psnr_db_surface": 22.0}}})
    assert "psnr_db_surface" not in a and list(b["gains"]) == ["psnr_db"]
    with pytest.raises(ValueError, match=r"b$"):
        summarise_rows({"a": {0: {"psnr_db": 20.0}}, "b": {}})
