"""Times are only shown; the memory of a copy is known."""

from pathlib import Path

import pytest
from hazy_recording import measured, write_recording

from deckline.evaluation.dehazing_cost import CostTask, measure_costs, run_once


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


def test_what_cannot_be_measured_says_why(recording):
    task = CostTask("gone.onnx", str(recording), "0", (64, 48), False, None, None)
    costs, failed = measure_costs({"gone": task}, 2, lambda: None)
    assert costs == {} and "gone.onnx does not exist" in failed["gone"]


def test_cost_is_printed_with_its_ratio_to_the_reference(recording, tmp_path, monkeypatch):
    monkeypatch.setattr("deckline.evaluation.dehazing_cost.run_in_process", run_once)
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
