import numpy as np
import pytest

from approach_scene import frame
from deckline.cli.main import main
from deckline.evaluation.detection_lanes import TuSimple
from deckline.evaluation.detection_measure import DetectionScore, Scene
from deckline.evaluation.detectors import comparison_tables, label
from deckline.recording import RecordingWriter


def score(index: int, found: int, range_m: float = 150.0, scene: Scene = Scene.DECK) -> DetectionScore:
    errors = {"left": [1.0] * (found > 0), "right": [2.0] * (found > 1)}
    sure = {side: [0.9] * len(values) for side, values in errors.items()}
    return DetectionScore(
        "a", index, "", "cvn", scene, range_m, 800.0, 1280, 50.0, errors, sure, TuSimple(1.0, 0.0, 0.0), None
    )


def test_differences_are_of_the_same_decks_and_bands_of_the_share_found():
    first = [score(k, 2 if k < 10 else 0) for k in range(20)] + [score(20, 1, scene=Scene.EMPTY)]
    other = [score(k, 2, 150.0 if k < 19 else 500.0) for k in range(20)] + [score(20, 0, scene=Scene.EMPTY)]
    tables = comparison_tables({("one", "none"): first, ("two", "none"): other})
    rows = [dict(zip(tables[0].columns, row, strict=True)) for row in tables[0].rows]
    assert tables[0].title == "20 decks, 1 frames without a runway"
    assert [row["found %"] for row in rows] == ["50.0", "100.0"]
    assert [row["false %"] for row in rows] == ["100.0", "0.0"]
    assert rows[0]["found, to the first"] == "-"
    value, low, high = (float(part.strip("[],")) for part in rows[1]["found, to the first"].split())
    exact = 1.96 * 100 * np.sqrt(0.5 * 0.5 / 20)  # of a share of a half
    assert value == 50.0
    assert high - value == pytest.approx(exact, abs=6)
    assert value - low == pytest.approx(exact, abs=6)
    assert "by visibility" in tables[2].title


def test_a_file_is_called_by_its_own_name_or_its_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert label("detect.onnx") == tmp_path.name
    assert label("ufld") == "ufld"
    assert label("runs/hybrid/detect.onnx") == "hybrid"
    assert label("weights/mine.onnx") == "mine"


def test_detectors_and_dehazers_on_one_recording(tmp_path, capsys):
    with RecordingWriter(tmp_path / "approach", scene={"preset": "cvn"}) as writer:
        for index in range(2):
            writer.add(frame(index, 120.0))
    command = [
        "eval",
        "detectors",
        str(tmp_path / "approach"),
        "--detector",
        "classical",
        "--out",
        str(tmp_path / "out"),
    ]
    assert main([*command, "--dehazer", "none"]) == 0
    capsys.readouterr()
    assert main([*command, "--dehazer", "none", "dark-channel", "--markdown", str(tmp_path / "t.md")]) == 0
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["classical+dark-channel", "classical+none"]
    lines = (tmp_path / "t.md").read_text().splitlines()
    assert [line.split(" | ")[:2] for line in lines if line.startswith("| classical")][:2] == [
        ["| classical", "none"],
        ["| classical", "dark-channel"],
    ]
