"""`deckline eval ablation` on a tiny dataset: two steps a row, the table against a direct computation."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from deckline.cli.main import main
from deckline.dehaze import OnnxDehazer
from deckline.evaluation.ablation import HAZY, Measured, measure
from deckline.evaluation.metrics import psnr_db, ssim
from deckline.geometry import Camera
from deckline.haze import add_haze, beta_from_visibility
from deckline.recording import RecordingWriter, open_recording
from deckline.types import Frame, Truth

CAMERA = Camera.from_fov(96, 64, 1.2)
ROWS = ["baseline", "mix-attention", "mobilevit", "augmentation"]
BUDGET = ["--steps", "2", "--crop-height", "48", "--crop-width", "64", "--threads", "1", "--device", "cpu"]


def pair(index: int) -> Frame:
    """Sky over a sea with a bright block on it, in haze."""
    rng = np.random.default_rng(index)
    clear = rng.normal((40, 60, 75), 6, (64, 96, 3)).clip(0, 255).astype(np.uint8)
    clear[:16] = (150, 170, 200)
    clear[32:, 4 * index : 4 * index + 20] = 200
    depth = np.full((64, 96), np.nan, dtype=np.float32)
    depth[16:] = np.geomspace(1500, 60, 48)[:, None]
    hazy = add_haze(clear, depth * CAMERA.ray_lengths(), beta_from_visibility(700.0), (150, 170, 200))
    frame = Frame("", float(index), hazy, CAMERA, depth_m=depth, world_from_body=RigidTransform.identity())
    return replace(frame, truth=Truth(visibility_m=700.0, clear_rgb=clear))


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dataset")
    for split, indices in (("train", range(12)), ("test", range(12, 15))):
        with RecordingWriter(folder / split, "ppm", {"preset": "test"}) as writer:
            for index in indices:
                writer.add(pair(index))
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
    source, file = open_recording(dataset / "test"), tmp_path / "images.jsonl"
    calls = []

    def dehazer(image: np.ndarray) -> np.ndarray:
        calls.append(1)
        return image // 2

    rows = [Measured(HAZY), Measured("half", dehazer, "abc")]
    whole = measure(rows, source, range(0, 3), file)
    assert len(calls) == 3
    text = file.read_text()
    lines = text.splitlines(keepends=True)
    file.write_text("".join(lines[:2]) + lines[2][:10])  # killed in the middle of a line
    assert measure(rows, source, range(0, 3), file) == whole
    assert file.read_text() == text
    assert len(calls) == 5
    other = [Measured(HAZY), Measured("half", lambda image: image // 3, "def")]  # other weights of the same row
    assert measure(other, source, range(0, 3, 2), file)["half"][2] != whole["half"][2]


def test_damaged_test_frames_are_skipped(dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copytree(dataset / "test", tmp_path / "test")
    images = sorted((tmp_path / "test" / "images").glob("*.ppm"))
    images[1].write_bytes(b"P6")
    scores = measure([Measured(HAZY)], open_recording(tmp_path / "test"), range(3), tmp_path / "images.jsonl")
    assert list(scores[HAZY]) == [0, 2]
    assert f"skipped {images[1].name}" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "give each row a budget: --minutes, --steps, or both"),
        (["--steps", "0"], "steps must be at least 1, got 0"),
        (["--steps", "1", "--every", "0"], "--every must be at least 1, got 0"),
        (["--steps", "1", "--recorded-share", "2"], "recorded_share must lie in 0..1, got 2"),
    ],
)
def test_bad_input_is_one_line(
    options: list[str], message: str, dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["eval", "ablation", str(dataset), "--out", str(tmp_path / "out"), *options]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_folder_that_is_no_dataset_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["eval", "ablation", str(tmp_path), "--out", str(tmp_path / "out"), "--steps", "1"]) == 2
    error = capsys.readouterr().err
    assert str(tmp_path / "test") in error
    assert error.count("\n") == 1


def test_a_file_of_something_else_is_refused(dataset: Path, tmp_path: Path) -> None:
    file = tmp_path / "images.jsonl"
    file.write_text('{"file": "a.png", "dehazer": "none"}\n')
    with pytest.raises(ValueError, match=r"images\.jsonl: a line is no figure of an image"):
        measure([Measured(HAZY)], open_recording(dataset / "test"), range(1), file)
