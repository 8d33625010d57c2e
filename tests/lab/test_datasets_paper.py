"""The paper's dataset and its manifest."""

import hashlib
import json

import numpy as np
import pytest

from deckline.cli.main import main
from deckline.recording import open_recording
from deckline.recording.images import read_image
from deckline_lab.datasets.paper import (
    DatasetConfig,
    check_dataset,
    dataset_items,
    split_frames,
    write_manifest,
)
from deckline_lab.datasets.tiles import tile_corners

SMALL = ["--frames", "12", "--test", "4", "--width", "160", "--height", "90", "--tile-px", "64"]


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    out = tmp_path_factory.mktemp("dataset") / "a"
    assert main(["dataset", str(out), *SMALL]) == 0
    return out


def test_the_papers_counts_are_the_defaults():
    config = DatasetConfig()
    members = split_frames(config)
    assert (len(members["train"]), len(members["test"])) == (421, 179)
    assert sorted(members["train"] + members["test"]) == list(range(600))
    assert split_frames(config) == members != split_frames(DatasetConfig(seed=1))


def test_tiles_overlap_and_cover_the_image():
    covered = np.zeros((720, 1280), dtype=int)
    for left, top in tile_corners(1280, 720, 512):
        covered[top : top + 512, left : left + 512] += 1
        assert 0 <= left <= 1280 - 512
        assert 0 <= top <= 720 - 512
    assert covered.min() == 1
    assert covered.max() == 4  # two columns and two rows overlap
    assert covered.sum() == 8 * 512 * 512


def test_frames_are_half_random_views_and_half_flights_of_their_own_seed():
    items = dataset_items(DatasetConfig(seed=3))
    assert len(items) == 600 and {config.weather.seed for config, _ in items} == {None}
    assert {item[0].weather.seed for item in dataset_items(DatasetConfig(seed=3, one_scene=True))} == {3}
    recordings = list({id(config): config for config, _ in items}.values())
    assert (recordings[0].trajectory, recordings[0].frames, recordings[0].seed) == ("random", 300, 300)
    assert [config.seed for config in recordings] == list(range(300, 313))
    assert {config.preset for config in recordings} == {"paper"}
    assert "approach" in {config.trajectory for config in recordings}
    many = dataset_items(DatasetConfig(frames=20000, test=10))
    assert len(many) == 20000
    assert max(config.seed for config, _ in many) < 100


def test_landings_are_the_papers_flight_again_and_again():
    items = dataset_items(DatasetConfig(views="landing"))
    recordings = list({id(config): config for config, _ in items}.values())
    assert len(items) == 600 and {config.trajectory for config in recordings} == {"landing"}
    assert [(config.seed, config.frames) for config in recordings] == [(k, 25) for k in range(1, 25)]
    with pytest.raises(ValueError, match="views"):
        DatasetConfig(views="random")


def test_what_is_written_is_as_the_manifest_counts(dataset):
    manifest = json.loads((dataset / "manifest.json").read_text())
    assert manifest["counts"] == {"train": {"frames": 8, "tiles": 64}, "test": {"frames": 4, "tiles": 32}}
    assert (manifest["dataset"]["depth_range_m"], manifest["dataset"]["seed"]) == ("inf", 0)
    assert {"python", "numpy", "moderngl", "opengl"} <= set(manifest["versions"])
    name, digest = next(iter(manifest["files"].items()))
    assert digest == hashlib.sha256((dataset / name).read_bytes()).hexdigest()
    for split, count in (("train", 8), ("test", 4)):
        for kind, suffix in (("hazy", "png"), ("clear", "png"), ("depth", "npy")):
            assert len(list((dataset / split / "tiles" / kind).glob(f"*.{suffix}"))) == 8 * count


def test_tiles_are_cut_from_their_frames(dataset):
    members = json.loads((dataset / "manifest.json").read_text())["frames"]
    frames = list(open_recording(dataset / "test"))
    times = [frame.time_s for frame in frames]
    assert times == sorted(times)
    for number, frame in zip(members["test"], frames, strict=True):
        assert 300 <= frame.truth.visibility_m <= 3000
        for k, (left, top) in enumerate(tile_corners(160, 90, 64)):
            part = np.s_[top : top + 64, left : left + 64]
            tiles = dataset / "test" / "tiles"
            for kind, image in (("hazy", frame.image_rgb), ("clear", frame.truth.clear_rgb)):
                np.testing.assert_array_equal(read_image(tiles / kind / f"{number:05d}_{k}.png"), image[part])
            depth = np.load(tiles / "depth" / f"{number:05d}_{k}.npy")
            assert depth.dtype == np.float16
            np.testing.assert_allclose(depth, frame.depth_m[part], rtol=2**-11)  # half precision rounds to this


def test_the_same_seed_gives_the_same_bytes_over_processes_and_after_a_stop(dataset, tmp_path):
    out = tmp_path / "b"
    assert main(["dataset", str(out), *SMALL]) == 0
    for name in ("train/airsim_rec.txt", "test/airsim_rec.txt"):  # as a kill leaves them: whole rows and a torn one
        path = out / name
        path.write_bytes(path.read_bytes()[:-40])
    assert main(["dataset", str(out), *SMALL, "--jobs", "2"]) == 0
    assert (out / "manifest.json").read_bytes() == (dataset / "manifest.json").read_bytes()
    assert main(["dataset", str(out), "--check"]) == 0


def test_a_complete_dataset_is_left_alone_and_other_settings_are_refused(dataset, capsys):
    before = (dataset / "manifest.json").stat().st_mtime_ns
    assert main(["dataset", str(dataset), *SMALL]) == 0
    assert (dataset / "manifest.json").stat().st_mtime_ns == before
    assert main(["dataset", str(dataset), *SMALL, "--seed", "1"]) == 2
    assert str(dataset) in capsys.readouterr().err


def test_without_tiles_there_are_recordings_alone(tmp_path):
    out = tmp_path / "a"
    assert main(["dataset", str(out), *SMALL[:-2], "--no-tiles"]) == 0
    assert {path.name for path in (out / "train").iterdir()} == {"airsim_rec.txt", "clear", "images", "scene.json"}
    assert main(["dataset", str(out), "--check"]) == 0


def test_what_is_wrong_is_named_in_one_line(tmp_path, capsys):
    for name in ("a.png", "b.png"):
        (tmp_path / name).write_bytes(b"1")
    write_manifest(tmp_path, {})
    assert check_dataset(tmp_path) == 2
    (tmp_path / "a.png").unlink()
    for name in ("b.png", "c.txt", "d.txt"):
        (tmp_path / name).write_bytes(b"2")
    assert main(["dataset", str(tmp_path), "--check"]) == 2
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("deckline: error")]
    for word in (str(tmp_path), "a.png is missing", "b.png has changed", "c.txt is not in the manifest", "1 more"):
        assert word in line
    assert "d.txt" not in line


@pytest.mark.parametrize(
    "text", [None, "{", '{"format": "other"}', '{"format": "deckline-dataset", "version": 1}', '{"\xe4": 1}']
)
def test_a_manifest_that_is_missing_damaged_or_not_ours_is_named(text, tmp_path):
    if text is not None:
        (tmp_path / "manifest.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(ValueError, match=f"{tmp_path}.*manifest"):
        check_dataset(tmp_path)
