import csv
import json
import shutil
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from approach_scene import chain, frame
from deckline.cli.main import main
from deckline.config import Models, RunConfig
from deckline.dehaze.base import DehazeResult
from deckline.detect import SearchingDetector
from deckline.localize import localize
from deckline.options import RunOptions
from deckline.types import Detection, LinePoints
from deckline_lab.evaluation.approaches import FlightsConfig, PointNoise
from deckline_lab.evaluation.dehazers import SharedDehazer
from deckline_lab.evaluation.localization import LocalizationConfig, localization
from deckline_lab.evaluation.localization_methods import SHIPPED, LocalizationBench, load, methods_of, point_bench
from deckline_lab.evaluation.localization_score import score_approach
from deckline_lab.evaluation.tables import OutputFiles

OPTIONS = RunOptions(grade="good", sea_state=0.0, dehazer="none", detector="classical")
METHODS = methods_of(OPTIONS.run_config(), ("classical",))
BENCH = replace(point_bench(METHODS, PointNoise()), settings={"made": "with"}, correlation=0.0)
FRAMES = 6
SHORT = ("--points", "--frames", "5", "--range-m", "150", "60", "--visibility", "clear", "--grade", "good")


def sightings(blind: int | None = None):
    """Frames of an approach whose lines are detected exactly, and not at all in one of them."""
    for k in range(FRAMES):
        at = frame(k, 150.0 - 15.0 * k)
        yield at, chain(at, () if k == blind else ("left", "right")).detection


@cache
def score_all(blind: int | None = None):
    return [score for scores in score_approach(sightings(blind), 3, METHODS, BENCH) for score in scores]


def test_every_method_scores_every_frame():
    scores = score_all()
    assert len(scores) == FRAMES * len(METHODS)
    assert {score.approach for score in scores} == {3}
    first = scores[0]
    assert (first.index, first.method, first.mode) == (0, METHODS[0].name, "coarse")
    assert first.range_m == pytest.approx(150.03, abs=0.01) and first.visibility_m == np.inf
    for score in scores[: len(METHODS)]:
        assert score.figures.get("direction_error_deg.left", 0.0) < 0.05
        assert abs(score.figures.get("centre.lateral_m", 0.0)) < 0.05


def test_the_detection_of_every_frame_is_compared_with_the_picture():
    scores = score_all(blind=4)
    assert [score.figures["is_right"] for score in scores if score.method == METHODS[0].name] == [
        float(index != 4) for index in range(FRAMES)
    ]
    assert [score.figures["time_s"] for score in scores[:: len(METHODS)]] == [0.25 * k for k in range(FRAMES)]


def test_only_tracked_rows_ride_out_blind_frames():
    scores = {(score.method, score.index): score.figures for score in score_all(blind=4)}
    for method in METHODS:
        blind = scores[method.name, 4]
        assert ("centre.lateral_m" in blind) is ("flagged" in blind) is method.tracked
        assert ("protection.lateral_m" in scores[method.name, 5]) is method.tracked


def test_only_the_joint_estimator_without_a_track_is_held_to_the_bound():
    scores = score_all()
    assert {score.method for score in scores if "bound.lateral_m" in score.figures} == {
        f"classical, {seen}, ours" for seen in ("hazy", "dehazed")
    }
    known = next(score.figures for score in scores if score.method == "classical, dehazed, ours")
    assert 0 < known["bound.heading_deg"] < 1.1 * known["centre.heading_sigma_deg"]
    assert 0 < known["bound.height_m"] < 1.1 * known["centre.height_sigma_m"]


def run_command(tmp_path, monkeypatch, rendered, **changes) -> Path:
    def fly(flights, approach):
        rendered.append(approach)
        return (at for at, _ in sightings())

    class Exact:
        name = "exact"

        def __call__(self, image_rgb, prior_box=None):
            return chain(frame(int(image_rgb[0, 0, 0]) - 120, 150.0 - 15.0 * (image_rgb[0, 0, 0] - 120.0))).detection

    def start(method):
        flight = BENCH.start(method)
        flight.detector = Exact()
        return flight

    monkeypatch.setattr("deckline_lab.evaluation.localization.load", lambda methods: replace(BENCH, start=start))
    monkeypatch.setattr("deckline_lab.evaluation.localization.fly", fly)
    flights = FlightsConfig(frames=FRAMES, options=OPTIONS)
    out = tmp_path / "out"
    config = LocalizationConfig(approaches=2, flights=flights, rival=("classical",), out=out)
    assert localization(replace(config, **changes)) == 0
    return out


def test_the_command_writes_tables_scores_and_pictures_and_resumes(tmp_path, capsys, monkeypatch):
    rendered, files = [], OutputFiles(tmp_path / "figures.json", tmp_path / "tables.md")
    out = run_command(tmp_path, monkeypatch, rendered, output=files)
    printed = capsys.readouterr().out
    assert "Table 6" in printed
    assert json.loads((tmp_path / "figures.json").read_text())["classical, dehazed, ours.found.left"] == 1.0
    assert "| true | left | - |" in (tmp_path / "tables.md").read_text()
    with (out / "localization.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * FRAMES * len(METHODS)
    assert float(rows[0]["true_slope.left"]) == 0.0
    assert (out / "figures" / "classical-dehazed-ours-tracked.png").stat().st_size > 10_000
    scores = out / "localization.jsonl"
    lines = scores.read_text().splitlines()
    scores.write_text("\n".join(lines[:2]) + "\n" + lines[2][:99])
    shutil.rmtree(out / "figures")
    capsys.readouterr()
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)  # without it the pictures are left out
    run_command(tmp_path, monkeypatch, rendered)
    assert scores.read_text().splitlines() == lines
    assert rendered == [0, 1, 1] and not (out / "figures").exists()
    errors = [line for line in capsys.readouterr().err.splitlines() if "no pictures" in line]
    assert len(errors) == 1 and 'pip install "deckline[viz]"' in errors[0]


def test_without_pictures_the_estimators_are_compared_in_any_number_of_processes(tmp_path):
    results, file = [], tmp_path / "figures.json"
    for options in (("--jobs", "1"), ("--jobs", "2", "--out", str(tmp_path))):
        words = [*SHORT, "--sea-state", "0", "--approaches", "2", *options, "--json", str(file)]
        assert main(["eval", "localization", *words]) == 0
        results.append(json.loads(file.read_text()))
    figures = results[0]
    assert figures["_tables"] == results[1]["_tables"]
    assert figures["ours.found.left"] == figures["paper's.found.right"] == 1.0
    assert 0 < figures["ours.direction_error_deg.left"] < 0.5
    assert figures["ours, tracked.pilot.lateral_m.p95"] < 0.5


class Counting:
    """Dehazer or detector that counts its calls."""

    name = "counting"

    def __init__(self) -> None:
        self.calls = []

    def restore(self, at):
        self.calls.append(at.file)
        return DehazeResult(at.image_rgb + np.uint8(1))

    def __call__(self, image_rgb, prior_box=None):
        self.calls.append(prior_box)
        return Detection(LinePoints.empty(), LinePoints.empty(), prior_box)


def test_a_frame_is_dehazed_once():
    counting = Counting()
    shared = SharedDehazer(counting)
    first, second = frame(0), frame(1)
    assert shared.restore(first) is shared.restore(first)
    np.testing.assert_array_equal(shared.restore(second).image_rgb, second.image_rgb + np.uint8(1))
    assert counting.calls == [first.file, second.file]


def test_single_rows_of_one_configuration_share_detections_and_tracked_rows_detect_on_their_own():
    detectors = {method.name: Counting() for method in METHODS}

    def start(method):
        flight = BENCH.start(method)
        flight.detector = detectors[method.name]
        return flight

    views = ((at, None) for at, _ in sightings())
    assert len(list(score_approach(views, 0, METHODS, replace(BENCH, start=start)))) == FRAMES
    calls = {name: len(detector.calls) for name, detector in detectors.items()}
    shared = {f"classical, {seen}, ours": 0 for seen in ("hazy", "dehazed")}  # of the paper's estimator's rows
    assert calls == dict.fromkeys(detectors, FRAMES) | shared


def test_tracked_rows_fly_a_searching_detector():
    methods = methods_of(replace(OPTIONS, detector="hybrid").run_config(), ("classical",))
    bench = load(methods)
    tracked = [bench.start(method) for method in methods if method.tracked]
    assert len(tracked) == 3 and all(isinstance(flight.detector, SearchingDetector) for flight in tracked)


def test_every_detector_flies_without_and_with_dehazing_and_nothing_else_differs():
    rivals = ("ufld.onnx", "runs/resa/detect.onnx")
    rows = {method.name: method for method in methods_of(replace(OPTIONS, detector="hybrid").run_config(), rivals)}
    first = next(iter(rows.values()))
    assert (first.name, first.config.models) == ("ufld, hazy, paper's", Models("none", "ufld.onnx", "hazy"))
    assert not first.tracked and first.localizer is not localize
    pairs = [(row, rows[name.replace("hazy", "dehazed")]) for name, row in rows.items() if "hazy" in name]
    assert len(pairs) == 6 and len(rows) == 13
    for hazy, dehazed in pairs:
        models = replace(dehazed.config.models, dehazer="none", detect_in="hazy")
        assert dehazed.config.models.detect_in == "dehazed"
        assert hazy == replace(dehazed, name=hazy.name, config=replace(dehazed.config, models=models))
    assert rows["as shipped, tracked"].config.models == RunConfig().models
    with pytest.raises(ValueError, match=r"rival.*sad.*other/sad\.onnx"):
        methods_of(RunConfig(), ("sad.onnx", "other/sad.onnx"))


def test_an_exact_pose_takes_the_units_error_away_in_its_rows_alone():
    hazy, exact = "classical, hazy, paper's", "classical, hazy, paper's, exact pose"
    aside = RigidTransform.from_translation([0.0, 1.5, 0.0])
    off = {hazy: [], exact: []}
    views = [
        (
            replace(
                at,
                world_from_body=aside * at.world_from_body,
                truth=replace(at.truth, world_from_body=at.world_from_body),
            ),
            detection,
        )
        for at, detection in ((at, chain(at).detection) for at, _ in sightings())
    ]
    for scores in score_approach(iter(views), 0, METHODS, BENCH):
        for score in scores:
            if score.method in off:
                off[score.method].append(score.figures["lateral_error_m.left"])
    assert max(off[exact]) < 0.1 and min(off[hazy]) > 1.0


def test_rows_share_their_models_and_have_their_own_estimator():
    own = [method for method in METHODS if method.name != SHIPPED]
    bench = load(own)
    flights = [bench.start(method) for method in own]
    assert len({id(flight.detector) for flight in flights}) == len({id(flight.dehazer) for flight in flights}) == 1
    assert [flight.tracker is not None for flight in flights] == [method.tracked for method in own]
    assert isinstance(bench, LocalizationBench) and set(bench.settings) == {method.name for method in own}
    with pytest.raises(ValueError, match="nobody"):
        load(methods_of(RunConfig(), ("nobody",)))
