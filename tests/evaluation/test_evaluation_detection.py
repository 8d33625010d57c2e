import json
from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest

from approach_scene import CAMERA, chain, frame
from deckline.cli.main import main
from deckline.detect import ClassicalDetector
from deckline.evaluation.detection_frames import Recorded, named, open_recorded
from deckline.evaluation.detection_measure import Scene
from deckline.evaluation.detection_scores import SCORES_FILE, Method, ScoreBook, evaluate, open_book
from deckline.evaluation.detection_tables import detection_tables, flat_figures
from deckline.evaluation.detection_worst import figures_line, worst_of, write_worst
from deckline.labels import LabelledImage, write_labels
from deckline.labels.truth import label_frame
from deckline.pipeline import FrameResult
from deckline.recording import RecordingWriter
from deckline.recording.camera_file import camera_text
from deckline.types import Detection, Frame, LinePoints


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


def by(run: Callable[[Frame], FrameResult], book: ScoreBook) -> Method:
    return Method(lambda at: run(at).detection, book)


NONE = LinePoints.empty()


def error_of(capsys, *args) -> str:
    assert main(["eval", "detection", *map(str, args)]) == 2
    *_, line = capsys.readouterr().err.strip().splitlines()
    return line


def test_figures_of_a_recording(recording):
    book = open_book(None, {})
    evaluate([Recorded(recording)], [by(half_blind, book)])
    figures = flat_figures(list(book.scores.values()))
    assert figures["found_rate"] == figures["placed_rate"] == pytest.approx(2 / 3)
    assert figures["false_rate"] == 1.0
    assert figures["error_px.p95"] < 1e-3
    assert figures["range to the ramp.100 to 200 m.found_rate"] == 0.5
    assert figures["range to the ramp.0 to 100 m.found_rate"] == 1.0
    assert figures["ship.cvn.decks"] == 3
    assert figures["visibility.2000 m and more.frames"] == 3
    assert figures["culane.f1"] == pytest.approx(2 * 5 / (2 * 5 + 1))
    assert sum(value for name, value in figures.items() if name.endswith(".points")) == 5 * 20 + 20


def test_tables_say_the_same_on_the_screen_and_in_markdown(recording):
    book = open_book(None, {})
    evaluate([Recorded(recording)], [by(half_blind, book)])
    tables = detection_tables(list(book.scores.values()))
    first = tables[0]
    cells = dict(zip(first.columns, first.rows[0], strict=True))
    assert (cells["frames"], cells["decks"], cells["empty"]) == ("4", "3", "1")
    assert (cells["found %"], cells["false %"], cells["F1 %"]) == ("66.7", "100.0", "90.9")
    markdown = first.markdown().splitlines()
    assert markdown[2].startswith("|  | frames | decks | empty | found % |")
    assert markdown[4].startswith("| all | 4 | 3 | 1 | 66.7 | 66.7 |")
    assert first.rich().row_count == 1
    by_ship = next(table for table in tables if table.title == "by ship")
    assert [row[0] for row in by_ship.rows] == ["cvn"]


def test_a_stopped_evaluation_goes_on_where_it_was(recording, tmp_path):
    seen = []

    def counted(at):
        seen.append(at.file)
        if len(seen) == 3:
            raise KeyboardInterrupt
        return half_blind(at)

    sets, settings = [Recorded(recording)], {"detector": "exact"}
    with pytest.raises(KeyboardInterrupt):
        evaluate(sets, [by(counted, open_book(tmp_path, settings))])
    path = tmp_path / SCORES_FILE
    path.write_text(path.read_text() + '{"score": {"source"')  # a killed writer's half line
    again = open_book(tmp_path, settings)
    assert len(again.scores) == 2
    evaluate(sets, [by(counted, again)])
    assert len(seen) == 5
    whole = open_book(None, {})
    evaluate(sets, [by(half_blind, whole)])
    kept = open_book(tmp_path, settings)
    assert detection_tables(list(kept.scores.values())) == detection_tables(list(whole.scores.values()))
    with pytest.raises(ValueError, match='holds an evaluation with detector "exact", not "other": choose another'):
        open_book(tmp_path, {"detector": "other"})


def test_frames_that_cannot_be_used_are_named_once(recording, tmp_path):
    damaged = tmp_path / "damaged"
    with RecordingWriter(damaged) as writer:
        for index in range(2):
            writer.add(frame(index))
    image = sorted((damaged / "images").iterdir())[0]
    image.write_bytes(image.read_bytes()[:100])
    book = open_book(tmp_path / "out", {})
    evaluate([Recorded(damaged)], [by(chain, book)])
    assert len(book.scores) == 1
    (reason,) = book.skipped.values()
    assert "cut short" in reason
    assert open_book(tmp_path / "out", {}).skipped == book.skipped


def test_the_worst_frames_become_pictures_with_their_truth_and_a_line_of_figures(recording, tmp_path):
    book, item = open_book(None, {}), Recorded(recording)
    evaluate([item], [by(half_blind, book)])
    chosen = worst_of(list(book.scores.values()), 10)
    assert [score.index for score in chosen[:2]] == [1, 3]
    page = write_worst(tmp_path, {item.name: item}, chosen[:1], half_blind)
    text = page.read_text()
    assert "100 m to the ramp; clear air" in text
    assert "left: 0.0 px median" in text and "right: not found" in text
    picture = cv2.imread(str(tmp_path / "worst" / "001.png"))[:, :, ::-1]
    assert picture.shape == (648, 1280, 3)
    label = label_frame(item.load(1).frame, "x")
    u, v = label.left_px.mean(axis=0) * 2  # the left panel shows the 320 px wide image twice as large, 40 px down
    around = picture[int(v) + 30 : int(v) + 50, int(u) - 10 : int(u) + 10].reshape(-1, 3)
    assert (around.min(axis=1) > 220).any() and (around.max(axis=1) < 40).any()  # white dashes on a dark halo
    assert "20 false points, confidence 0.75" in figures_line(chosen[1])


def labelled_folder(folder):
    folder.mkdir()
    for name in ("a.png", "b.png", "c.png"):
        cv2.imwrite(str(folder / name), np.full((CAMERA.height, CAMERA.width, 3), 90, np.uint8))
    (folder / "camera.toml").write_text(camera_text(CAMERA, frame().body_from_camera))
    both = label_frame(frame(), "a.png")
    write_labels(folder / "labels.json", [both, LabelledImage("b.png", None, None)])
    return folder


def test_labelled_images_are_a_source_and_unlabelled_ones_are_not(tmp_path):
    folder = labelled_folder(tmp_path / "mine")
    (item,) = open_recorded((folder,))
    assert item.load(0).expected.scene is Scene.DECK
    assert item.load(1).expected.scene is Scene.EMPTY
    assert item.load(2) is None
    assert item.load(0).ship == "labelled"


def test_a_datasets_folder_stands_for_its_recordings(recording):
    (item,) = open_recorded((recording.parent,))
    assert item.name == str(recording)
    assert len(item) == 4


def test_the_command_measures_the_shipped_detector_and_writes_what_it_is_asked_for(tmp_path, capsys):
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
    assert "choose another folder" in error_of(capsys, folder, "--dehazer", "dark-channel", "--out", out)


def test_the_chain_is_told_where_the_runway_is_when_asked_to(recording, capsys, monkeypatch):
    boxes = []
    nothing = Detection(NONE, NONE)
    monkeypatch.setattr(
        ClassicalDetector, "__call__", lambda self, image, prior_box=None: boxes.append(prior_box) or nothing
    )
    words = ["eval", "detection", str(recording), "--detector", "classical", "--dehazer", "none"]
    assert main(words) == 0
    assert boxes == [None] * 4
    assert main([*words, "--told-within-m", "2"]) == 0
    assert "told where the runway is within 2 m" in " ".join(capsys.readouterr().out.split())
    assert all(box is not None for box in boxes[4:]) and len(boxes) == 8
    pixels = chain(frame(0, 150.0)).detection.left.points_px
    assert boxes[4][0] <= pixels[:, 0].min() and boxes[4][3] >= pixels[:, 1].max()


def test_bad_input_is_one_line(recording, tmp_path, capsys):
    assert "--worst needs --out FOLDER" in error_of(capsys, recording, "--worst", "3")
    assert "--deckless must not be negative" in error_of(capsys, recording, "--deckless", "-1")
    assert "--told-within-m must be a number of metres" in error_of(capsys, recording, "--told-within-m", "-1")
    assert "preset must be one of" in error_of(capsys, "--frames", "1", "--preset", "titanic")
    assert "given twice" in error_of(capsys, recording, recording)
    plain = tmp_path / "plain"
    with RecordingWriter(plain) as writer:
        writer.add(frame())
    (plain / "scene.json").unlink()
    assert "neither truth (scene.json) nor labels.json" in error_of(capsys, plain)


def test_many_sources_are_named_by_the_first_and_the_last(tmp_path):
    paths = [tmp_path / str(k) for k in range(9)]
    for path in paths:
        with RecordingWriter(path) as writer:
            writer.add(frame())
    sets = open_recorded(paths)
    assert named(sets[:2]) == f"{paths[0]}, {paths[1]}"
    assert named(sets) == f"9 sources, {paths[0]} to {paths[8]}"
