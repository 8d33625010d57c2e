"""`deckline benchmark` on three frames of the shipped approach."""

import json
from pathlib import Path

import pytest

from deckline.cli.main import main
from deckline.detect import OnnxDetector
from deckline.runtime import shipped_weights
from deckline_lab.evaluation import stage_timing
from deckline_lab.evaluation.stage_timing import ANSWER, FILM, GUIDANCE, PEER

SHORT = ["benchmark", "--duration", "0.25", "--dehazer", "none", "--threads", "1"]


def test_every_stage_of_both_modes_is_measured_beside_the_peer(tmp_path: Path) -> None:
    out = tmp_path / "profile.json"
    assert main([*SHORT, "--peer", str(shipped_weights("ufld")), "--out", str(out)]) == 0
    figures = json.loads(out.read_text())
    assert figures["engine"] == {"device": "cpu", "threads": 1, "precision": "f32"}
    stages = figures["file"]["stages"]
    assert set(stages) == {*ANSWER, *FILM, GUIDANCE}
    for each in (*stages.values(), *figures["live"]["stages"].values()):
        assert 0 <= each["p50_ms"] <= each["p95_ms"] <= each["p99_ms"]
    assert stages["guidance"]["p50_ms"] >= stages["detect"]["p50_ms"] > 0
    assert all(rate > 0 for rate in figures["file"]["frames_per_s"].values())
    assert figures["live"]["frames"] == 3
    assert set(figures["passes"]) == {"hybrid", PEER}
    file, live, passes = figures["_tables"]
    ratio = stages["detect"]["p50_ms"] / figures["passes"][PEER]["pass_ms"]
    assert next(row[-1] for row in file["rows"] if row[0] == "detect") == f"{ratio:.2f}"
    assert [row[-1] for row in passes["rows"] if row[0] == PEER] == ["1.00"]
    assert len(live["rows"]) == 1


def test_the_peer_is_the_published_network(tmp_path: Path) -> None:
    peer = OnnxDetector(stage_timing.export_peer(tmp_path), compare=True)
    assert (peer.config.grid.cells, peer.config.grid.rows) == (100, 56)
    assert peer.session.config["parameters"] > 30e6


def test_without_torch_there_are_no_ratios(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> None:
    def refuse(folder: Path) -> Path:
        raise ImportError("torch is not installed")

    monkeypatch.setattr(stage_timing, "export_peer", refuse)
    assert main([*SHORT, "--detector", "classical"]) == 0
    assert "torch is not installed" in capsys.readouterr().out


def test_a_single_frame_is_refused(capsys: pytest.CaptureFixture) -> None:
    assert main([*SHORT[:2], "0.05", *SHORT[3:], "--detector", "classical"]) == 2
    assert "1 usable frames" in capsys.readouterr().err
