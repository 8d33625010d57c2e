"""Dehazers by name, and what one costs."""

from pathlib import Path

import numpy as np
import pytest
from hazy_recording import measured, pictures, write_network, write_recording

from deckline.runtime import sha256_of, shipped_weights
from deckline_lab.evaluation.dehazers import CostTask, build_dehazer, by_name, measure_costs, model_of, run_once


def test_two_files_of_one_name_are_refused(tmp_path):
    for folder in ("a", "b"):
        (tmp_path / folder / "net").mkdir(parents=True)
    files = [str(tmp_path / folder / "net" / "dehaze.onnx") for folder in ("a", "b")]
    assert by_name(["none", files[0], files[0]]) == {"none": "none", "net": files[0]}
    with pytest.raises(ValueError, match=r"a/net/dehaze\.onnx.*b/net/dehaze\.onnx.* net\b"):
        by_name(files)


def test_full_size_networks_see_the_whole_picture_and_coarse_ones_what_they_are_made_for(tmp_path):
    path = str(write_network(tmp_path / "net" / "dehaze.onnx"))
    image = pictures(0)[0]
    assert not np.array_equal(build_dehazer(path)(image), image)
    np.testing.assert_array_equal(build_dehazer(path, full_size=True)(image), image)
    shipped = str(shipped_weights("coarse-t"))
    used = build_dehazer(shipped)
    assert used.coarse
    assert build_dehazer(shipped, full_size=True).working_long_side_px == used.working_long_side_px


def test_a_model_is_its_weights_or_the_code_that_dehazes(tmp_path, monkeypatch):
    path = write_network(tmp_path / "net" / "dehaze.onnx")
    assert model_of(build_dehazer(str(path))) == f"weights {sha256_of(path)}"
    own = model_of(build_dehazer("geometry"))
    assert own == model_of(build_dehazer("dark-channel"))
    (tmp_path / "__init__.py").write_text("changed = True\n")
    monkeypatch.setattr("deckline.dehaze.__file__", str(tmp_path / "__init__.py"))
    assert model_of(build_dehazer("geometry")) != own


@pytest.fixture
def recording(tmp_path) -> Path:
    return write_recording(tmp_path / "recording")


def test_a_copy_takes_the_memory_of_a_picture_in_a_fresh_process(recording):
    task = CostTask("none", str(recording), "0", (2000, 1000), False, None, None)
    steps = []
    costs, failed = measure_costs({"none": task}, 1, lambda: steps.append(1))
    assert not failed and len(steps) == 1
    assert costs["none"].seconds > 0
    assert 6e6 * 0.9 < costs["none"].peak_bytes < 6e6 * 1.5  # 2000 x 1000 x 3 bytes


def test_what_cannot_be_measured_has_a_reason(recording):
    task = CostTask("gone.onnx", str(recording), "0", (64, 48), False, None, None)
    costs, failed = measure_costs({"gone": task}, 2, lambda: None)
    assert costs == {} and "gone.onnx does not exist" in failed["gone"]


def test_cost_is_printed_with_its_ratio_to_the_reference(recording, tmp_path, monkeypatch):
    monkeypatch.setattr("deckline_lab.evaluation.dehazers.run_in_process", run_once)
    file = tmp_path / "t.md"
    arguments = ("--dehazer", "dark-channel", "--reference", "dark-channel", "--cost", "--cost-runs", 1)
    found = measured(
        tmp_path / "f.json", recording, "--detector", "none", *arguments, "--cost-size", 64, 48, "--markdown", file
    )
    assert set(found["cost"]) == {"none", "dark-channel"} and found["cost_size_px"] == [64, 48]
    row = next(line for line in file.read_text().splitlines() if line.startswith("| dark-channel |"))
    assert "(1.00)" in row
    ratio = found["cost"]["none"]["seconds"] / found["cost"]["dark-channel"]["seconds"]
    assert f"({ratio:.2f})" in file.read_text()
