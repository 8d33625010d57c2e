import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from level_deck import deck
from refused import refuse

from approach_scene import CAMERA, chain, frame
from deckline.cli.main import main
from deckline.detect import DETECTORS
from deckline.recording import RecordingWriter
from deckline.types import Detection, LinePoints
from deckline_lab.evaluation.chain import single_frames_with
from deckline_lab.evaluation.dehazers import detector_label
from deckline_lab.evaluation.detection import (
    SCORES_FILE,
    Finder,
    comparison_tables,
    detection_tables,
    flat_figures,
    score_detections,
)
from deckline_lab.evaluation.detection_cost import cost_table, measure_costs
from deckline_lab.evaluation.detection_flown import FlightPerSet, approach_figures
from deckline_lab.evaluation.detection_score import DetectionScore
from deckline_lab.evaluation.detection_truth import SceneKind
from deckline_lab.evaluation.frames import Recorded, name_sets, open_recorded
from deckline_lab.evaluation.lane_scores import TuSimple
from deckline_lab.evaluation.pictures import figures_line, write_worst
from deckline_lab.labels import LabelledImage, write_labels
from deckline_lab.labels.of_frame import label_frame
from deckline_lab.rivals.catalog import flight_from_config
from deckline_lab.rivals.classical import ClassicalDetector
from golden import check_golden

GOLDEN = Path(__file__).parent / "golden"


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Three frames with a runway, one of the sea."""
    folder = tmp_path_factory.mktemp("data") / "approach"
    with RecordingWriter(folder, scene={"preset": "cvn"}) as writer:
        for index, range_m in enumerate((150.0, 100.0, 60.0, 90.0)):
            writer.add(frame(index, range_m, runway=index != 3))
    return folder


def half_blind(at):
    """Sees both lines exactly in the first frame and the third, one in the second; a line of its own on the sea."""
    if at.truth.left is None:
        return replace(chain(at, ()), detection=Detection(chain(replace(at, truth=frame().truth)).detection.left, NONE))
    return chain(at, ("left",) if at.time_s == 0.25 else ("left", "right"))


half_blind.config, half_blind.dehazer = chain.config, chain.dehazer  # as a flight has them


def scores_of(folder, out=None, run=half_blind, settings=None) -> list[DetectionScore]:
    [scores] = score_detections(
        [Recorded(folder)], [Finder(out, settings or {}, lambda sample: run(sample.frame).detection)]
    )
    return scores


NONE = LinePoints.empty()


def test_figures_and_tables_of_a_recording(recording):
    scores = [replace(score, source="approach") for score in scores_of(recording)]
    figures = flat_figures(scores)
    assert figures["found_rate"] == figures["placed_rate"] == pytest.approx(2 / 3)
    assert figures["error_px.p95"] < 1e-3
    assert sum(value for name, value in figures.items() if name.endswith(".points")) == 5 * 20 + 20
    rounding = {name for name in figures if "error_px" in name or "worst_line" in name}  # errors are float32's
    exact = {name: value for name, value in figures.items() if name not in rounding}
    check_golden(GOLDEN / "detection.json", {"tables": detection_tables(scores), "figures": exact})


def test_a_stopped_evaluation_resumes(recording, tmp_path):
    seen = []

    def counted(at):
        seen.append(at.file)
        if len(seen) == 3:
            raise KeyboardInterrupt
        return half_blind(at)

    with pytest.raises(KeyboardInterrupt, match=SCORES_FILE):
        scores_of(recording, tmp_path, counted)
    resumed = scores_of(recording, tmp_path, counted)
    assert len(seen) == 5
    assert detection_tables(resumed) == detection_tables(scores_of(recording))
    with pytest.raises(ValueError, match="detector"):
        scores_of(recording, tmp_path, settings={"detector": "other"})


def test_frames_that_cannot_be_used_are_named(tmp_path, capsys):
    damaged = tmp_path / "damaged"
    with RecordingWriter(damaged) as writer:
        for index in range(2):
            writer.add(frame(index))
    image = sorted((damaged / "images").iterdir())[0]
    image.write_bytes(image.read_bytes()[:100])
    for _ in range(2):  # also when the command is given again
        assert len(scores_of(damaged, tmp_path / "out", chain)) == 1
        assert image.name in capsys.readouterr().err


def test_the_worst_frames_become_pictures_with_their_truth_and_a_line_of_figures(recording, tmp_path):
    item, scores = Recorded(recording), scores_of(recording)
    text = write_worst(tmp_path, {item.name: item}, scores, 1, half_blind).read_text()
    assert "100 m to the ramp; clear air" in text
    assert "left: 0.0 px median" in text and "right: not found" in text
    picture = cv2.imread(str(tmp_path / "worst" / "001.png"))[:, :, ::-1]
    assert picture.shape == (648, 1280, 3)
    label = label_frame(item.load(1).frame, "x")
    u, v = label.left_px.mean(axis=0) * 2  # the left panel shows the 320 px wide image twice as large, 40 px down
    around = picture[int(v) + 30 : int(v) + 50, int(u) - 10 : int(u) + 10].reshape(-1, 3)
    assert (around.min(axis=1) > 220).any() and (around.max(axis=1) < 40).any()  # white dashes on a dark halo
    assert "20 false points, confidence 0.75" in figures_line(scores[3])
    text = write_worst(tmp_path, {item.name: item}, scores, 10, half_blind).read_text()
    assert text.index(scores[1].file) < text.index(scores[3].file)


def labelled_folder(folder):
    folder.mkdir()
    for name, height in (("a.png", CAMERA.height), ("b.png", 90), ("c.png", 60)):
        cv2.imwrite(str(folder / name), np.full((height, CAMERA.width, 3), 90, np.uint8))
    both = label_frame(frame(), "a.png")
    write_labels(folder / "labels.json", [both, LabelledImage("b.png", None, None)])
    return folder


def test_a_datasets_folder_opens_its_recordings_and_many_are_named_by_the_first_and_the_last(tmp_path):
    paths = [tmp_path / str(k) for k in range(9)]
    for path in paths:
        with RecordingWriter(path) as writer:
            writer.add(frame())
    sets = open_recorded((tmp_path,))
    assert [(item.name, len(item)) for item in sets] == [(str(path), 1) for path in paths]
    assert name_sets(sets[:2]) == f"{paths[0]}, {paths[1]}"
    assert name_sets(sets) == f"9 sources, {paths[0]} to {paths[8]}"


def test_labelled_images_are_a_source_and_unlabelled_ones_are_not(tmp_path):
    folder = labelled_folder(tmp_path / "mine")
    (item,) = open_recorded((folder,))
    assert item.load(0).expected.scene is SceneKind.DECK
    assert item.load(1).expected.scene is SceneKind.EMPTY
    assert item.load(2) is None
    assert item.load(0).ship == "labelled"


def test_the_command_measures_the_shipped_detector_and_writes_what_it_is_asked_for(tmp_path, no_tiles, capsys):
    folder, out = labelled_folder(tmp_path / "mine"), tmp_path / "out"
    files = ("--json", tmp_path / "f.json", "--markdown", tmp_path / "t.md", "--out", out, "--worst", "2")
    assert main(["eval", "detection", str(folder), "--dehazer", "none", *map(str, files)]) == 0
    figures = json.loads((tmp_path / "f.json").read_text())
    assert figures["found_rate"] == 0.0 and figures["false_rate"] == 0.0  # there is nothing in grey images
    assert "| labelled | 2 | 1 | 1 | 0.0 |" in (tmp_path / "t.md").read_text()
    assert (out / "worst" / "001.png").exists() and not (out / "worst" / "002.png").exists()
    shown = capsys.readouterr()
    assert "by ship" in shown.out and "skipped" not in shown.err
    # the dehazer is another one
    assert SCORES_FILE in refuse(capsys, "detection", folder, "--dehazer", "dark-channel", "--out", out)


def test_the_chain_gets_a_runway_prior_when_asked_to(recording, capsys, monkeypatch):
    boxes = []
    nothing = Detection(NONE, NONE)
    monkeypatch.setattr(
        ClassicalDetector, "__call__", lambda self, image, prior_box=None: boxes.append(prior_box) or nothing
    )
    words = ["eval", "detection", str(recording), "--detector", "classical", "--dehazer", "none"]
    assert main(words) == 0
    assert boxes == [None] * 4
    assert main([*words, "--prior-sigma-m", "2"]) == 0
    assert "prior with 1-sigma of 2 m" in " ".join(capsys.readouterr().out.split())
    assert all(box is not None for box in boxes[4:]) and len(boxes) == 8
    pixels = chain(frame(0, 150.0)).detection.left.points_px
    assert boxes[4][0] <= pixels[:, 0].min() and boxes[4][3] >= pixels[:, 1].max()


def test_sources_that_cannot_be_evaluated_are_named(recording, tmp_path, capsys):
    assert str(recording) in refuse(capsys, "detection", recording, recording)
    plain = tmp_path / "plain"
    with RecordingWriter(plain) as writer:
        writer.add(frame())
    (plain / "scene.json").unlink()
    assert "scene.json" in refuse(capsys, "detection", plain)


def write_approach(folder, count: int = 20, rate_hz: float = 4.0):
    """From 250 m on at 40 m/s."""
    with RecordingWriter(folder, scene={"preset": "cvn"}) as writer:
        for index in range(count):
            writer.add(replace(frame(index, 250.0 - 40.0 * index / rate_hz), time_s=index / rate_hz))
    return folder


class Tracking:
    """Sees lines exactly from the fourth frame of a flight on."""

    config, dehazer = chain.config, chain.dehazer

    def __init__(self):
        self.source, self.frames, self.seen = "", 0, []

    def __call__(self, sample):
        self.frames = 1 if sample.source != self.source else self.frames + 1
        self.source = sample.source
        self.seen.append((sample.source, sample.index))
        return chain(sample.frame, ("left", "right") if self.frames > 3 else ()).detection


def test_a_flight_that_was_stopped_is_flown_again_from_its_first_frame(tmp_path):
    sets = [Recorded(write_approach(tmp_path / name, 6)) for name in "ab"]
    stopped, again = Tracking(), Tracking()

    def stop(sample):
        if len(stopped.seen) == 10:
            raise KeyboardInterrupt
        return stopped(sample)

    def scores(find):
        return score_detections(sets, [Finder(tmp_path / "out", {}, find, in_order=True)])[0]

    with pytest.raises(KeyboardInterrupt):
        scores(stop)
    flown = scores(again)
    assert again.seen == [(sets[1].name, index) for index in range(6)]
    assert [score.found for score in flown] == [0, 0, 0, 2, 2, 2] * 2


def test_lines_are_first_held_where_the_second_after_them_has_them_too(tmp_path):
    item = Recorded(write_approach(tmp_path / "approach"))
    [scores] = score_detections([item], [Finder(None, {}, Tracking())])
    figures = approach_figures(scores)
    assert figures["approaches"] == 1
    assert figures["first_held_m.90"] == pytest.approx(220.0, abs=0.1)  # its fourth frame
    assert figures["first_held_of_visibility.90"] == pytest.approx(220.0 / 250.0, abs=0.001)
    assert figures["wrong_rate"] == 0.0 and "far.found_rate" not in figures


def test_a_pair_of_lines_that_is_found_elsewhere_is_wrong():
    scores = [deck(left=(30.0,)), deck(), deck(left=()), deck(left=(8.0,), near_width_px=200.0, range_m=500.0)]
    figures = approach_figures(scores)
    assert figures["wrong_rate"] == 0.25  # 8 px is less than 5 % of 200 px
    assert (figures["found_rate"], figures["placed_rate"]) == (0.75, 0.25)
    assert (figures["far.found_rate"], figures["far.placed_rate"]) == (1.0, 0.0)


def test_recordings_are_flown_beside_single_pictures(tmp_path, capsys):
    folder = write_approach(tmp_path / "approach", 8)
    words = ["eval", "detection", str(folder), "--detector", "classical", "--flown", "--out", str(tmp_path / "out")]
    assert main([*words, "--json", str(tmp_path / "t.json")]) == 0
    saved = json.loads((tmp_path / "t.json").read_text())
    assert saved["single pictures.decks"] == saved["as flown.decks"] == 8
    assert saved["as flown.first_held_m.90"] == 0.0  # grey pictures
    assert [row[0] for row in saved["_tables"][1]["rows"]] == ["single pictures", "as flown"]
    rows = (tmp_path / "out" / "flown" / SCORES_FILE).read_text().splitlines()
    assert len(rows) == 1 + 8
    assert main([*words[:-1], str(tmp_path / "alone"), "--no-single", "--json", str(tmp_path / "alone.json")]) == 0
    alone = json.loads((tmp_path / "alone.json").read_text())
    assert [row[0] for row in alone["_tables"][1]["rows"]] == ["as flown"]
    assert {name: alone[name] for name in saved if name.startswith("as flown")} == {
        name: value for name, value in saved.items() if name.startswith("as flown")
    }
    assert "recordings" in refuse(capsys, "detection", "--flown")
    assert "--flown" in refuse(capsys, "detection", str(folder), "--no-single")
    assert "--flown" in refuse(capsys, "detection", str(folder), "--no-poses")


def test_recordings_are_flown_without_their_poses(tmp_path):
    folder = write_approach(tmp_path / "approach", 3)
    (flown,), models = open_recorded([folder]), flight_from_config(single_frames_with("none", "classical"))
    frames = {}
    for poses in (True, False):
        with models, FlightPerSet([flown], models, poses) as flights:
            frames[poses] = [flights(flown.load(index)).frame for index in range(3)]
    assert all(frame.world_from_body is not None and frame.deck_z_m is not None for frame in frames[True])
    assert all(frame.world_from_body is None and frame.deck_z_m is None for frame in frames[False])


def score_of(index: int, found: int, range_m: float = 150.0, scene: SceneKind = SceneKind.DECK) -> DetectionScore:
    errors = {"left": [1.0] * (found > 0), "right": [2.0] * (found > 1)}
    return deck(**errors, index=index, scene=scene, range_m=range_m, tusimple=TuSimple(1.0, 0.0, 0.0))


def test_differences_are_of_the_same_decks_and_bands_of_the_share_found():
    first = [score_of(k, 2 if k < 10 else 0) for k in range(20)] + [score_of(20, 1, scene=SceneKind.EMPTY)]
    other = [score_of(k, 2, 150.0 if k < 19 else 500.0) for k in range(20)] + [score_of(20, 0, scene=SceneKind.EMPTY)]
    tables = comparison_tables({("one", "none"): first, ("two", "none"): other})
    check_golden(GOLDEN / "detectors.json", tables)
    value, low, high = (float(part.strip("[],")) for part in tables[0].rows[1][-1].split())
    exact = 1.96 * 100 * np.sqrt(0.5 * 0.5 / 20)  # of a share of a half
    assert (value, high - value, value - low) == (50.0, pytest.approx(exact, abs=6), pytest.approx(exact, abs=6))


def test_a_file_is_called_by_its_own_name_or_its_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert detector_label("detect.onnx") == tmp_path.name
    assert detector_label("ufld") == "ufld"
    assert detector_label("runs/hybrid/detect.onnx") == "hybrid"
    assert detector_label("weights/mine.onnx") == "mine"


def test_detectors_and_dehazers_on_one_recording(tmp_path, capsys):
    with RecordingWriter(tmp_path / "approach", scene={"preset": "cvn"}) as writer:
        for index in range(2):
            writer.add(frame(index, 120.0))
    command = ["eval", "detectors", str(tmp_path / "approach"), "--detector", "classical"]
    command += ["--out", str(tmp_path / "out")]
    assert main([*command, "--dehazer", "none"]) == 0
    capsys.readouterr()
    assert main([*command, "--dehazer", "none", "dark-channel", "--markdown", str(tmp_path / "t.md")]) == 0
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["classical+dark-channel", "classical+none"]
    lines = (tmp_path / "t.md").read_text().splitlines()
    assert [line.split(" | ")[:2] for line in lines if line.startswith("| classical")][:2] == [
        ["| classical", "none"],
        ["| classical", "dark-channel"],
    ]


def test_costs_are_those_that_the_file_states_and_only_networks_have_any():
    costs = measure_costs({"hybrid": DETECTORS["hybrid"](), "classical": ClassicalDetector()})
    assert list(costs) == ["hybrid"]
    assert costs["hybrid"]["pass_ms"] > 0
    table = cost_table({"one": {"parameters": 2.5e6, "macs": 1.24e9, "pass_ms": 60.04}, "other": {"pass_ms": 1.0}})
    assert [tuple(row) for row in table.rows] == [("one", "2.50", "1.24", "60.0"), ("other", "-", "-", "1.0")]
