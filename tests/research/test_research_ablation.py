"""`deckline eval ablation` on a tiny dataset: two steps a row, the table against a direct computation."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from clear_scene import hazy_recording
from deckline.cli.main import main
from deckline.dehaze import OnnxDehazer
from deckline.evaluation.metrics import psnr_db, ssim
from deckline.evaluation.store import Store
from deckline.recording import open_recording
from deckline.research.ablation import HAZY, Scores, measure, summarise_rows

ROWS = ["baseline", "mix-attention", "mobilevit", "augmentation"]
BUDGET = ["--steps", "2", "--crop-height", "48", "--crop-width", "64", "--threads", "1", "--device", "cpu"]


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dataset")
    for split, frames in (("train", 12), ("test", 3)):
        hazy_recording(folder / split, frames)
    return folder


def test_rows_are_trained_measured_and_reported(dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    command = ["eval", "ablation", str(dataset), "--out", str(tmp_path), *BUDGET]
    assert main(command) == 0
    printed = capsys.readouterr().out
    assert "3 test images; 2 steps for each row" in printed
    table = json.loads((tmp_path / "ablation.json").read_text())
    assert [row["row"] for row in table["rows"]] == [HAZY, *ROWS]
    test, above = open_recording(dataset / "test"), None
    for row in table["rows"]:
        dehazer = None if row["row"] == HAZY else OnnxDehazer(tmp_path / row["row"] / "dehaze.onnx", threads=1)
        images = [test.load(k) for k in range(3)]
        pictures = [frame.image_rgb if dehazer is None else dehazer(frame.image_rgb) for frame in images]
        clear = [np.asarray(frame.truth.clear_rgb) for frame in images if frame.truth is not None]
        psnr = [psnr_db(a, b) for a, b in zip(pictures, clear, strict=True)]
        surface = [psnr_db(a[16:], b[16:]) for a, b in zip(pictures, clear, strict=True)]
        assert row["psnr_db"] == pytest.approx(np.mean(psnr))
        assert row["psnr_db_surface"] == pytest.approx(np.mean(surface))
        assert row["ssim"] == pytest.approx(np.mean([ssim(a, b) for a, b in zip(pictures, clear, strict=True)]))
        if above is not None:
            gain = row["gains"]["psnr_db"]
            assert gain["value"] == pytest.approx(np.mean(np.subtract(psnr, above)))
            assert gain["low"] <= gain["value"] <= gain["high"]
            assert row["steps"] == 2
        above = psnr
    markdown = (tmp_path / "ablation.md").read_text().splitlines()
    assert markdown[5].startswith("| row | PSNR, dB | gain [95 %] |")
    assert f"{table['rows'][1]['psnr_db']:.2f}" in markdown[8]
    assert f"{table['rows'][1]['parameters'] / 1e6:.3f}" in markdown[8]
    lines = (tmp_path / "images.jsonl").read_text()
    assert main(command) == 0
    assert (tmp_path / "images.jsonl").read_text() == lines, "nothing is measured twice"


def test_measuring_goes_on_where_it_was_stopped(dataset: Path, tmp_path: Path) -> None:
    source, calls = open_recording(dataset / "test"), []

    def dehazer(image: np.ndarray) -> np.ndarray:
        calls.append(1)
        return image // 2

    def run() -> Scores:
        return measure({HAZY: None, "half": dehazer}, source, range(3), Store(tmp_path, "images.jsonl", {}))

    whole = run()
    assert len(calls) == 3
    text = (tmp_path / "images.jsonl").read_text()
    (tmp_path / "images.jsonl").write_text(text[: text.rindex("\n", 0, -1) + 10])  # killed in the middle of a line
    assert run() == whole
    assert len(calls) == 4


def test_damaged_test_frames_are_skipped(dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copytree(dataset / "test", tmp_path / "test")
    images = sorted((tmp_path / "test" / "images").glob("*.ppm"))
    images[1].write_bytes(b"P6")
    scores = measure({HAZY: None}, open_recording(tmp_path / "test"), range(3), Store(None, "images.jsonl", {}))
    assert list(scores[HAZY]) == [0, 2]
    assert f"skipped {images[1].name}" in capsys.readouterr().err


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


def test_a_folder_that_is_no_dataset_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["eval", "ablation", str(tmp_path), "--out", str(tmp_path / "out"), "--steps", "1"]) == 2
    error = capsys.readouterr().err
    assert str(tmp_path / "test") in error
    assert error.count("\n") == 1


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


def test_a_figure_that_does_not_exist_is_left_out() -> None:
    a, b = summarise_rows({"a": {0: {"psnr_db": 20.0}}, "b": {0: {"psnr_db": 21.0, "psnr_db_surface": 22.0}}})
    assert "psnr_db_surface" not in a
    assert list(b["gains"]) == ["psnr_db"]


def test_a_row_without_images_is_refused() -> None:
    with pytest.raises(ValueError, match="no image could be evaluated for b"):
        summarise_rows({"a": {0: {"psnr_db": 20.0}}, "b": {}})
