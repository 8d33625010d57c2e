import dataclasses
import json

import cv2
import numpy as np
import pytest

from approach_scene import CAMERA, frame
from deckline.cli.main import main
from deckline.geometry import Camera
from deckline.recording import RecordingWriter, open_recording
from deckline.recording.camera_file import format_camera
from deckline_lab.labels import read_labels
from deckline_lab.labels.exchange import READERS
from deckline_lab.labels.of_frame import label_frame


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Two approaches to a runway and one sea."""
    folder = tmp_path_factory.mktemp("approach")
    with RecordingWriter(folder) as writer:
        for index, range_m in enumerate((120.0, 60.0, 90.0)):
            writer.add(frame(index, range_m, runway=index != 2))
    return folder


def error_of(capsys, *args) -> str:
    assert main([str(arg) for arg in args]) == 2
    *_, line = capsys.readouterr().err.strip().splitlines()  # above it the progress bar
    assert line.startswith("deckline: error: ")
    return line


@pytest.mark.parametrize("form", READERS)
def test_truth_goes_out_and_comes_back_beside_its_images(recording, tmp_path, form, capsys):
    out, back = tmp_path / "out", tmp_path / "back"
    assert main(["labels", "export", str(recording), "--format", form, "--out", str(out)]) == 0
    assert main(["labels", "import", str(out), "--format", form, "--out", str(back)]) == 0
    assert "3 images: 2 with both lines, 0 with one, 1 with none" in capsys.readouterr().out
    labels = read_labels(back / "labels.json")
    source = open_recording(back)
    assert len(source) == len(labels) == 3
    for original, copy in zip(open_recording(recording), source, strict=True):
        np.testing.assert_array_equal(copy.image_rgb, original.image_rgb)
        assert (copy.camera.fx, copy.camera.cy) == (original.camera.fx, original.camera.cy)
        truth = label_frame(original, "x")
        for side, line in truth.lines.items():
            read = labels[copy.file][side]
            assert (read is None) == (line is None)
            if line is not None:  # straight lines: the same one, and its ends within a row
                start, end = line[0], line[-1]
                normal = np.array([start[1] - end[1], end[0] - start[0]]) / np.linalg.norm(end - start)
                assert np.abs((read - start) @ normal).max() < 0.01
                assert abs(np.ptp(read[:, 1]) - np.ptp(line[:, 1])) < 2.0


def test_culane_masks_show_left_as_1_and_right_as_2(recording, tmp_path):
    out = tmp_path / "out"
    assert main(["labels", "export", str(recording), "--format", "culane", "--out", str(out)]) == 0
    rows = (out / "list" / "train_gt.txt").read_text().splitlines()
    assert [row.split()[2:] for row in rows] == [["1", "1"], ["1", "1"], ["0", "0"]]
    mask = cv2.imread(str(out / rows[0].split()[1].lstrip("/")), cv2.IMREAD_GRAYSCALE)
    assert mask.shape == (CAMERA.height, CAMERA.width)
    columns = {value: np.nonzero(mask == value)[1].mean() for value in (1, 2)}
    assert columns[1] < columns[2]
    assert set(np.unique(mask)) == {0, 1, 2}


def test_own_labels_can_be_exported_and_images_named_elsewhere_imported(recording, tmp_path, capsys):
    first, own, again = (tmp_path / name for name in ("first", "own", "again"))
    for command in (
        ["export", recording, "--format", "coco", "--out", first],
        ["import", first, "--format", "coco", "--out", own],
        ["export", own, "--format", "tusimple", "--out", again, "--row-step-px", "3"],
    ):
        assert main(["labels", *map(str, command)]) == 0
    moved = tmp_path / "moved"
    (again / "clips").rename(moved)
    label_file = again / "label_data.json"
    label_file.write_text(label_file.read_text().replace("clips/", ""))
    capsys.readouterr()
    command = ["labels", "import", label_file, "--format", "tusimple", "--out", tmp_path / "x"]
    assert f"{again}; give --images" in error_of(capsys, *command) and not (tmp_path / "x" / "labels.json").exists()
    assert main([*map(str, command[:-1]), str(tmp_path / "y"), "--images", str(moved)]) == 0
    assert open_recording(tmp_path / "y").load(0).camera.fx == pytest.approx(CAMERA.fx)


def test_a_recording_of_several_cameras_is_exported_with_a_note(tmp_path, capsys):
    wide = Camera.from_fov(CAMERA.width, CAMERA.height, 1.4)
    with RecordingWriter(tmp_path / "a") as writer:
        writer.add(frame(0))
        writer.add(dataclasses.replace(frame(1), camera=wide))
    assert main(["labels", "export", str(tmp_path / "a"), "--format", "coco", "--out", str(tmp_path / "b")]) == 0
    assert "2 different cameras: no camera.toml" in capsys.readouterr().err


def test_a_labels_side_is_a_word_and_labels_without_one_are_noted(tmp_path, capsys):
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((30, 40, 3), np.uint8))
    labels = {"Runway right": 30, "runway-left": 10, "Centre line": 20}
    shapes = [{"label": k, "points": [[u, 25], [20, 5]], "shape_type": "line"} for k, u in labels.items()]
    (tmp_path / "a.json").write_text(json.dumps({"shapes": shapes, "imagePath": "a.png"}))
    assert main(["labels", "import", str(tmp_path), "--format", "labelme", "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr()
    assert "1 with both lines" in printed.out and "Centre line" in printed.err
    lines = read_labels(tmp_path / "out" / "labels.json")["a.png"]
    assert (lines["left"][0, 0], lines["right"][0, 0]) == (9.5, 29.5)


def test_bad_input_is_one_line(recording, tmp_path, capsys):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "a").write_text("")
    out, new = ("--format", "coco", "--out"), tmp_path / "o"
    for command, words in (
        (("export", recording, *out, tmp_path / "full"), ["full holds a"]),
        (("export", recording, *out, new, "--row-step-px", "0"), ["--row-step-px", "got 0"]),
        (("import", tmp_path, *out, new, "--keypoints", "left", "right"), ["--keypoints", "coco"]),
        (("import", tmp_path, *out, new), ["annotations.json"]),
    ):
        error = error_of(capsys, "labels", *command)
        assert [word for word in words if word not in error] == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"file_name": "../a.png"}, ["'../a.png'"]),
        ({"file_name": "labels.json"}, ["'labels.json'", ".png"]),
        ({"width": 41, "height": 30}, ["a.png", "40x30 px", "(41, 30)"]),
        ({"file_name": "b.png"}, ["b.png"]),
        ({"file_name": "cut.png"}, ["cut.png: damaged"]),
        ({"file_name": "small.png"}, ["small.png", "20x10 px", "40x30"]),
    ],
)
def test_images_that_cannot_be_used_are_named(tmp_path, capsys, change, words):
    picture = cv2.imencode(".png", np.zeros((30, 40, 3), np.uint8))[1].tobytes()
    (tmp_path / "a.png").write_bytes(picture)
    (tmp_path / "cut.png").write_bytes(picture[:-8])
    cv2.imwrite(str(tmp_path / "small.png"), np.zeros((10, 20, 3), np.uint8))
    (tmp_path / "camera.toml").write_text(format_camera(Camera.from_fov(40, 30, 1.0), frame(0).body_from_camera))
    (tmp_path / "x").mkdir()
    (tmp_path / "x" / "a.png").write_bytes(picture)
    values = {
        "images": [{"id": 0, "file_name": "x/a.png"}, {"id": 1, "file_name": "a.png"} | change],
        "annotations": [],
        "categories": [{"id": 1, "keypoints": ["left_1", "left_2"]}],
    }
    (tmp_path / "labels.json").write_text(json.dumps(values))
    command = ("labels", "import", tmp_path / "labels.json", "--format", "coco", "--out", tmp_path / "out")
    error = error_of(capsys, *command)
    assert [word for word in words if word not in error] == []


def test_lines_of_another_image_size_are_refused(tmp_path, capsys):
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((30, 40, 3), np.uint8))
    (tmp_path / "a.lines.txt").write_text("400 300 420 200\n600 300 620 200\n")
    command = ("labels", "import", tmp_path, "--format", "culane", "--out", tmp_path / "out")
    for _ in range(2):  # what a refused import leaves does not stop the next one
        assert "a.png: its left line lies outside of its 40x30" in error_of(capsys, *command)
    (tmp_path / "out" / "labels.json").write_text("")
    assert "out holds labels.json" in error_of(capsys, *command)
