"""Pairs of recordings, and of a labelled folder: a frame of the shipped sample, and the same in more haze."""

import json
import shutil
import zipfile
from pathlib import Path

import cv2
import numpy as np
import pytest
from hazy_recording import measured, write_recording
from refused import refuse
from skimage.metrics import peak_signal_noise_ratio

import deckline
from deckline.recording import open_recording
from deckline_lab.evaluation.dehazing_pairs import open_pairs
from deckline_lab.evaluation.no_reference import visible_range_m


@pytest.fixture(scope="module")
def pair_folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("pairs")
    sample = folder / "sample"
    with zipfile.ZipFile(Path(deckline.__file__).parent / "sample" / "approach.zip") as file:
        file.extractall(sample)
    source = open_recording(sample)
    frame = source.load(len(source) - 1)
    hazy = np.clip(0.7 * frame.image_rgb + 0.3 * 190.0, 0, 255).astype(np.uint8)
    for name, image in (("a_clear.png", frame.image_rgb), ("a_vis900.png", hazy)):
        cv2.imwrite(str(folder / name), cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    camera = frame.camera
    keys = ("width", "height", "fx", "fy", "cx", "cy")
    (folder / "camera.toml").write_text("".join(f"{key} = {getattr(camera, key)}\n" for key in keys))
    position, rotation = frame.world_from_body.as_components()
    numbers = [*position, *rotation.as_quat(scalar_first=True)]
    rows = [",".join([name, "0", *map(repr, map(float, numbers))]) for name in ("a_clear.png", "a_vis900.png")]
    (folder / "poses.csv").write_text("\n".join(["file,time_s,x_m,y_m,z_m,qw,qx,qy,qz", *rows]) + "\n")
    optical = frame.world_from_camera.inv()
    lines = {}
    for side in ("left", "right"):
        line = getattr(frame.truth, side)
        lines[f"{side}_px"] = camera.project(optical.apply(np.stack([line.p0_m, line.p1_m]))).tolist()
    frames = [
        {"file": "a_clear.png", "pair_of": None, "visibility_m": 20000, **lines},
        {"file": "a_vis900.png", "pair_of": "a_clear.png", "visibility_m": 900, **lines},
    ]
    (folder / "labels.json").write_text(json.dumps({"frames": frames}))
    (folder / "deck_z").write_text(repr(frame.deck_z_m))
    return folder


def test_pairs_of_a_labelled_folder_and_their_lines_with_the_shipped_detector(pair_folder, tmp_path, capsys):
    deck_z_m = float((pair_folder / "deck_z").read_text())
    found = measured(tmp_path / "f.json", pair_folder, "--dehazer", "none", f"--deck-z-m={deck_z_m}")
    (band,) = set(found["visibility"]) - {"all"}
    summary = found["visibility"]["500-1000 m"]["none"]
    assert band == "500-1000 m" and summary["images"] == summary["asked"] == 1
    clear, hazy = (cv2.imread(str(pair_folder / name)) for name in ("a_clear.png", "a_vis900.png"))
    assert summary["means"]["psnr_db"] == pytest.approx(peak_signal_noise_ratio(clear, hazy), abs=1e-9)
    assert "psnr_db_surface" not in summary["means"]  # sea and ship are unknown
    assert summary["lines"]["found_rate"] == 1.0
    assert summary["lines"]["point_error_px.median"] < 1.5
    text = capsys.readouterr().out
    assert "Lines by visibility" in text and "below horizon" not in text.split("\n\n")[0].split("PSNR and SSIM")[0]


def test_bad_labels_and_pairs_are_named(pair_folder, tmp_path, capsys):
    labels = json.loads((pair_folder / "labels.json").read_text())
    folder = Path(shutil.copytree(pair_folder, tmp_path / "copy", ignore=shutil.ignore_patterns("sample")))
    hazy = labels["frames"][1]
    for change, *named in (
        ({"pair_of": "../x.png"}, "a_vis900.png: pair_of must", "../x.png"),
        ({"pair_of": "a_vis900.png"}, "a_vis900.png: pair_of must"),
        ({"visibility_m": "thick"}, "visibility_m", "'thick'"),
        ({"visibility_m": True}, "visibility_m", "True"),
        ({"file": "b.png"}, "b.png"),
        ({"pair_of": "gone.png"}, "gone.png"),
    ):
        (folder / "labels.json").write_text(json.dumps({"frames": [labels["frames"][0], hazy | change]}))
        error = refuse(capsys, "dehazing", folder, "--detector", "none", "--dehazer", "none")
        assert all(name in error for name in named)
    (folder / "labels.json").write_text(json.dumps({"frames": [*labels["frames"], hazy]}))
    assert "a_vis900.png" in refuse(capsys, "dehazing", folder, "--detector", "none", "--dehazer", "none")
    (folder / "labels.json").write_text(json.dumps(labels))
    cv2.imwrite(str(folder / "a_clear.png"), np.zeros((360, 640, 3), np.uint8))
    assert "640x360 px" in refuse(capsys, "dehazing", folder, "--detector", "none", "--dehazer", "none")


def test_a_folder_that_names_no_pair_gives_its_pictures_and_their_lines(pair_folder, tmp_path):
    folder = Path(shutil.copytree(pair_folder, tmp_path / "copy", ignore=shutil.ignore_patterns("sample")))
    labels = json.loads((folder / "labels.json").read_text())
    (folder / "labels.json").write_text(json.dumps({"frames": labels["frames"][:1]}))
    source = open_pairs(folder)
    assert source.keys == ("a_clear.png", "a_vis900.png")
    named, other = map(source.load, source.keys)
    assert named.clear_rgb is None and set(named.lines or {}) == {"left", "right"}
    assert other.clear_rgb is None and other.lines is None


def test_true_lines_are_measured_where_the_recording_holds_them(pair_folder, tmp_path):
    source = open_pairs(pair_folder / "sample", every=1000)
    pair = source.load(source.keys[0])
    found = measured(
        tmp_path / "f.json", pair_folder / "sample", "--every", 1000, "--detector", "none", "--dehazer", "none"
    )
    image = pair.frame.image_rgb
    assert found["visibility"]["all"]["none"]["means"]["visible_range_m"] == visible_range_m(image, image, pair.in_view)
    assert len(pair.in_view) == 2
    assert open_pairs(pair_folder).load("a_vis900.png").in_view == ()  # labelled in the image: no ranges


def test_a_pair_has_no_truth_the_given_heights_depth_where_asked_for_and_its_rain(tmp_path):
    recording = write_recording(tmp_path / "recording")
    pair = open_pairs(recording).load("0")
    assert (pair.frame.truth, pair.frame.depth_m, pair.frame.deck_z_m, pair.film) == (None, None, -20.0, None)
    frame = open_pairs(recording, deck_z_m=-18.5, sea_z_m=2.5, with_depth=True).load("0").frame
    assert (frame.truth, frame.deck_z_m, frame.sea_z_m) == (None, -18.5, 2.5) and frame.depth_m is not None
    scene = json.loads((recording / "scene.json").read_text())
    for index, entry in enumerate(scene["frames"].values()):
        exposure = {"rain_mm_h": 2.0 * index, "lens_drops": 0, "exposure_s": 0.0}
        entry["truth"]["conditions"] = {"exposure": exposure}
    (recording / "scene.json").write_text(json.dumps(scene))
    pairs = open_pairs(recording)
    assert [pairs.load(key).film for key in pairs.keys] == ["dry and sharp", "rain", "rain", "rain"]
