"""`deckline eval ablation` on a tiny dataset: what differs between the rows, their training, and the table."""

import json
import re
import shutil
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise, product
from pathlib import Path

import numpy as np
import pytest

from clear_scene import clear_recording, hazy_recording, interrupting
from deckline.cli.main import main
from deckline.config import Engine
from deckline.dehaze import OnnxDehazer
from deckline_lab.ablation import rows
from deckline_lab.ablation.rows import ROWS, Training, base_recipe, check_pairs, list_trainings, row_recipe
from deckline_lab.ablation.table import HAZY, measure, summarise_rows
from deckline_lab.datasets.tiles import tile_corners
from deckline_lab.evaluation.dehazing_pairs import open_pairs
from deckline_lab.evaluation.metrics import psnr_db, ssim
from deckline_lab.evaluation.store import Store
from deckline_lab.train import loop
from deckline_lab.train.checkpoint import read_progress
from deckline_lab.train.dehaze import build_ours
from deckline_lab.train.dehaze_samples import make_batch
from deckline_lab.train.export import network_cost
from deckline_lab.train.loop import is_finished
from deckline_lab.train.pair_views import open_clear_views

TRAINED = (ROWS[0], ROWS[-1])  # rows that are trained here: they differ in every part
SIZE = (64, 96)  # height and width of the pictures, px
OPTIONS = ["--steps", "2", "--sub-image-px", "48", "--seeds", "0", "1", "--recorded-share", "0", "--threads", "1"]
BASE = base_recipe(None, 2, "t", 4, 0.0, 48, batch=2, lr=5e-4, threads=1, device="cpu", cpu_minutes=False)


def trainings(out: Path) -> list[Training]:
    return list_trainings(BASE, SIZE, (0, 1), out)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dataset")
    for split, frames in (("train", 12), ("test", 3)):
        hazy_recording(folder / split, frames)
    return folder


@pytest.fixture(scope="module", autouse=True)
def two_rows() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rows, "ROWS", TRAINED)
        yield


@pytest.fixture(scope="module")
def trained(dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The command's folder."""
    out = tmp_path_factory.mktemp("rows")
    assert main(["eval", "ablation", str(dataset), "--out", str(out), *OPTIONS]) == 0
    return out


def test_every_row_adds_one_part() -> None:
    parts = [(row.attention, row.transformer, row.sub_images, row.redrawn) for row in ROWS]
    assert (parts[0], parts[-1]) == (("depthwise", "plain", False, False), ("mix", "mobilevit", True, True))
    for above, below in pairwise(parts):
        assert sum(a != b for a, b in zip(above, below, strict=True)) == 1


@pytest.mark.parametrize("row", ROWS[2:], ids=lambda row: row.key)
def test_a_row_sees_whole_pictures_or_flipped_sub_images_in_the_haze_that_it_is_for(row, dataset: Path) -> None:
    recipe = row_recipe(row, BASE, SIZE)
    views = open_clear_views([dataset / "train"], 640, 0.0)
    crop = (recipe.crop_height, recipe.crop_width)
    assert crop == ((48, 48) if row.sub_images else SIZE)
    whole = [(views[k].clear_rgb, np.asarray(views[k].hazy_rgb)) for k in range(len(views))]
    corners = tile_corners(96, 64, 48) if row.sub_images else [(0, 0)]
    flips = list(product((1, -1), (1, -1))) if row.sub_images else [(1, 1)]
    recorded = {}
    for pair, (left, top), (down, right) in product(whole, corners, flips):
        parts = [image[top : top + crop[0], left : left + crop[1]][::down, ::right] for image in pair]
        recorded[tuple(part.tobytes() for part in parts)] = down, right
    assert len(recorded) >= len(whole)
    seen = set()
    for step in range(16):
        hazy, clear, *_ = make_batch(views, 2, crop, recipe.haze, [0, step], False, None, recipe.sub_images)
        for images in zip(clear, hazy, strict=True):
            drawn = tuple((255 * x).round().byte().permute(1, 2, 0).numpy().tobytes() for x in images)
            assert (drawn in recorded) == (not row.redrawn)
            seen.add(recorded.get(drawn))
    assert seen == ({None} if row.redrawn else set(flips))


def test_the_table_holds_the_figures_of_the_trained_networks(dataset: Path, trained: Path) -> None:
    table = json.loads((trained / "ablation.json").read_text())
    assert [row["row"] for row in table["rows"]] == [HAZY, *(row.key for row in TRAINED)]
    test, above = open_pairs(dataset / "test"), np.empty((0, 3))
    pairs = [test.load(key) for key in test.keys]
    for row, entry in zip([None, *TRAINED], table["rows"], strict=True):
        mine = [training for training in trainings(trained) if training.row is row]
        dehazers = [OnnxDehazer(each.folder / "dehaze.onnx", engine=Engine(threads=1)) for each in mine]
        pictures = [[dehazer(pair.frame.image_rgb) for pair in pairs] for dehazer in dehazers]
        pictures = pictures or [[pair.frame.image_rgb for pair in pairs]]
        psnr = np.array([[psnr_db(a, b.clear_rgb) for a, b in zip(each, pairs, strict=True)] for each in pictures])
        assert entry["psnr_db"] == pytest.approx(psnr.mean())
        assert entry["psnr_db_of_trainings"] == pytest.approx(psnr.mean(axis=1))
        structure = [ssim(a, b.clear_rgb) for each in pictures for a, b in zip(each, pairs, strict=True)]
        assert entry["ssim"] == pytest.approx(np.mean(structure))
        if row is not None:
            gain, cost = entry["gains"]["psnr_db"], network_cost(build_ours(mine[0].recipe))
            assert gain["value"] == pytest.approx(psnr.mean() - above.mean())
            assert gain["low"] <= gain["value"] <= gain["high"]
            assert (entry["parameters"], entry["macs_256"], entry["steps"]) == (cost.parameters, cost.macs, 2)
            config = dehazers[1].session.config
            assert (config["network"]["attention"], config["network"]["transformer"]) == (
                row.attention,
                row.transformer,
            )
            assert config["recipe"] == mine[1].recipe.identity() and config["recipe"]["seed"] == 1
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
    shown = capsys.readouterr().out
    assert shown.count("finished before") == 4 == len(trainings(trained))
    assert trainings(trained)[-1].folder.name == "redrawn-1"
    assert {path: path.read_bytes() for path in before} == before
    assert main([*command, "--batch", "1"]) == 2
    assert "images.jsonl was made with batch 2, not 1" in capsys.readouterr().err
    # A training that is missing is made again, from where Ctrl-C stopped it.
    last = trainings(trained)[-1]
    shutil.rmtree(last.folder)
    monkeypatch.setattr(loop, "_step", interrupting(loop._step, at=1))
    assert main(command) == 130
    monkeypatch.undo()
    progress = read_progress(last.folder)
    assert progress is not None and progress["step"] == 1
    assert not is_finished(last.recipe, last.folder, "dehaze.onnx")
    assert main(command) == 0
    assert is_finished(last.recipe, last.folder, "dehaze.onnx")
    assert not is_finished(replace(last.recipe, lr=1e-3), last.folder, "dehaze.onnx")


def test_damaged_test_frames_are_skipped(dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copytree(dataset / "test", tmp_path / "test")
    images = sorted((tmp_path / "test" / "images").glob("*.ppm"))
    images[1].write_bytes(b"P6")
    scores = measure({HAZY: [None]}, open_pairs(tmp_path / "test"), 640, Store(None, "images.jsonl", {}))
    assert list(scores[HAZY][0]) == ["0", "2"]
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
        (["--steps", "1", "--every", "0"], r"every.*0"),
        (["--steps", "1", "--recorded-share", "2"], r"recorded_share.*2"),
        (["--steps", "1", "--seeds", "3", "3"], r"seeds.*3, 3"),
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
    first = [{"0": {"psnr_db": 20.0, "ssim": 0.8}, "1": {"psnr_db": 22.0, "ssim": 0.9}}]
    second = [{"0": {"psnr_db": 21.0, "ssim": 0.8}, "1": {"psnr_db": 24.0, "ssim": 0.8}}]
    third = [{"0": {"psnr_db": 20.5, "ssim": 0.8}, "1": {"psnr_db": 23.5, "ssim": 0.8}}]
    a, b, c = summarise_rows({"a": first, "b": second, "c": third})
    means = {"psnr_db": 21.0, "ssim": pytest.approx(0.85), "psnr_db_of_trainings": [21.0]}
    assert a == {"row": "a", "images": 2, **means, "gains": {}}
    # Resampling two images gives 1, 1.5 or 2.
    assert b["gains"]["psnr_db"] == {"value": 1.5, "low": 1.0, "high": 2.0, "images": 2}
    assert c["gains"]["psnr_db"]["value"] == -0.5  # against b, not a


def test_gains_count_the_images_of_both_rows_alone() -> None:
    rng = np.random.default_rng(0)
    above = {str(k): {"psnr_db": float(rng.uniform(15, 30))} for k in range(50)}
    row = {k: {"psnr_db": figures["psnr_db"] + 0.5} for k, figures in above.items() if int(k) % 2}
    row |= {"99": {"psnr_db": 60.0}}
    gain = summarise_rows({"above": [above], "row": [row]})[1]["gains"]["psnr_db"]
    assert gain["images"] == 25
    assert [gain[part] for part in ("value", "low", "high")] == pytest.approx([0.5] * 3)


def test_a_row_without_images_is_refused() -> None:
    with pytest.raises(ValueError, match=r"b$"):
        summarise_rows({"a": [{"0": {"psnr_db": 20.0}}], "b": [{}]})
