import csv
import json
from dataclasses import replace

import pytest

from approach_scene import chain, frame
from deckline.cli.main import main
from deckline.evaluation.localization import (
    LocalizationConfig,
    localization,
    score_approach,
    score_from,
    track_figures,
)
from deckline.evaluation.localization_flights import FlightsConfig
from deckline.evaluation.localization_methods import Bench, methods_of
from deckline.localize import LocalizeConfig
from deckline.pipeline import PipelineConfig
from deckline.types import Flag, Protection, Track, TrackState

METHODS, NOTES = methods_of("none", "classical", "classical", {"resa": None})
FRAMES = 6


class Exact:
    """A chain that sees the lines exactly, and none in frames of `blind`."""

    def __init__(self, method: str, blind: tuple[int, ...] = ()) -> None:
        self.config = PipelineConfig(localize=LocalizeConfig(method=method))
        self.blind, self.expected = blind, []

    def __call__(self, at, expected=None):
        self.expected.append(expected)
        return chain(at, () if round(at.time_s / 0.25) in self.blind else ("left", "right"))


def bench(blind=()) -> Bench:
    return Bench({m.name: Exact(m.estimator, blind) for m in METHODS}, lambda: None, {"made": "with"})


def frames():
    return (frame(k, 150.0 - 15.0 * k) for k in range(FRAMES))


def flown(of: Bench):
    return [score for each in score_approach(frames(), 3, METHODS, of, FlightsConfig().track) for score in each]


def test_every_method_scores_every_frame():
    scores = flown(bench())
    assert len(scores) == FRAMES * len(METHODS)
    assert {score.approach for score in scores} == {3}
    first = scores[0]
    assert (first.index, first.method, first.mode) == (0, METHODS[0].name, "coarse")
    assert first.range_m == pytest.approx(150.03, abs=0.01)
    for score in scores[: len(METHODS)]:
        if "direction_error_deg.left" in score.figures:
            assert score.figures["direction_error_deg.left"] < 0.01
            assert abs(score.figures["centre.lateral_m"]) < 0.02


def test_only_tracked_rows_ride_out_blind_frames_and_look_where_they_expect():
    of = bench(blind=(4,))
    scores = {(score.method, score.index): score for score in flown(of)}
    for method in METHODS:
        blind = scores[method.name, 4].figures
        assert ("centre.lateral_m" in blind) is method.tracked
        assert ("flagged" in blind) is method.tracked
        assert any(expected is not None for expected in of.pipelines[method.name].expected) is method.tracked


def test_a_track_takes_what_its_chain_made_of_a_frame_unless_a_line_is_missing():
    of = bench(blind=(4,))
    flown(of)
    asked = {name: len(pipeline.expected) for name, pipeline in of.pipelines.items()}
    tracked = {"dehazed, ours, tracked": 1, "hazy, ours, tracked": 1}  # both without a dehazer here
    assert asked == dict.fromkeys(asked, FRAMES) | tracked
    assert all(of.pipelines[name].expected[0] is not None for name in tracked)


def test_only_the_joint_estimator_alone_is_held_to_the_bound():
    scores = flown(bench())
    bounded = {score.method for score in scores if "bound.lateral_m" in score.figures}
    assert bounded == {"dehazed, ours"}
    known = next(score.figures for score in scores if score.method == "dehazed, ours")
    assert 0 < known["bound.heading_deg"] < 1.1 * known["centre.heading_sigma_deg"]
    assert 0 < known["bound.height_m"] < 1.1 * known["centre.height_sigma_m"]


def test_what_a_track_promises():
    kept = Track(0.0, TrackState.TRACKING, {}, Protection(2.0, 1.0, 1e-6))
    assert track_figures(kept) == {"flagged": 0.0, "protection.lateral_m": 2.0, "protection.height_m": 1.0}
    warned = Track(0.0, TrackState.LOST, {}, None, (Flag("frozen", "the picture does not move"),))
    assert track_figures(warned) == {"flagged": 1.0}


def test_the_command_writes_tables_scores_and_pictures_and_goes_on(tmp_path, capsys, monkeypatch):
    loaded, rendered = bench(), []

    def fly(flights, approach):
        rendered.append(approach)
        return frames()

    monkeypatch.setattr("deckline.evaluation.localization.load", lambda methods, config: loaded)
    monkeypatch.setattr("deckline.evaluation.localization.fly", fly)
    config = LocalizationConfig(
        approaches=2,
        flights=FlightsConfig(frames=FRAMES),
        detector="classical",
        dehazer="none",
        ufld="classical",
        out=tmp_path / "out",
        json_file=tmp_path / "figures.json",
        markdown=tmp_path / "tables.md",
    )
    assert localization(config) == 0
    told = capsys.readouterr().out
    assert "Table 6" in told
    assert "no row for resa: give its network with --resa FILE.onnx" in told
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert figures["dehazed, ours.found.left"] == 1.0
    assert "| true | left | - |" in (tmp_path / "tables.md").read_text()
    with (tmp_path / "out" / "localization.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * FRAMES * len(METHODS)
    assert float(rows[0]["true_slope.left"]) == 0.0
    assert (tmp_path / "out" / "figures" / "dehazed-ours-tracked.png").stat().st_size > 10_000
    lines = (tmp_path / "out" / "localization.jsonl").read_text().splitlines()
    (tmp_path / "out" / "localization.jsonl").write_text("\n".join(lines[:2]) + "\n" + lines[2][:99])
    assert localization(replace(config, markdown=None)) == 0
    assert (tmp_path / "out" / "localization.jsonl").read_text().splitlines() == lines
    assert rendered == [0, 1, 1]
    assert score_from(json.loads(lines[1])["run"][0]).visibility_m == float("inf")


def test_without_pictures_the_estimators_are_compared(tmp_path, capsys):
    words = ["--points", "--approaches", "1", "--frames", "5", "--range-m", "150", "60", "--visibility", "clear"]
    assert main(["eval", "localization", *words, "--json", str(tmp_path / "figures.json")]) == 0
    assert "improvement over paper's" in capsys.readouterr().out
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert figures["ours.found.left"] == figures["paper's.found.right"] == 1.0
    assert 0 < figures["ours.direction_error_deg.left"] < 0.5
    assert figures["ours, tracked.pilot.lateral_m.p95"] < 0.5


def test_processes_change_nothing(tmp_path):
    words = ["--points", "--approaches", "2", "--frames", "4", "--range-m", "150", "60", "--visibility", "clear"]
    for jobs in ("1", "2"):
        assert main(["eval", "localization", *words, "--jobs", jobs, "--out", str(tmp_path / jobs)]) == 0
    one, two = ((tmp_path / jobs / "localization.jsonl").read_text() for jobs in ("1", "2"))
    assert one == two


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--approaches", "0"), "--approaches must be at least 1, got 0"),
        (("--jobs", "-1"), "--jobs must not be negative, got -1"),
        (("--detector", "nobody"), "unknown detector 'nobody'"),
        (
            ("--visibility", "thick", "--dehazer", "none", "--detector", "classical", "--ufld", "classical"),
            "visibility must",
        ),
    ],
)
def test_wrong_use_gets_one_line(capsys, words, says):
    assert main(["eval", "localization", *words]) == 2
    *_, line = capsys.readouterr().err.strip().splitlines()
    assert says in line
