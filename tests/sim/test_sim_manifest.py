import hashlib
import json

import pytest

from deckline.cli.main import main
from deckline.sim.manifest import check_dataset, count_files, file_hashes, write_manifest

NAMES = ["test/clear/b.png", "train/clear/a.png", "train/tiles/hazy/00000_0.png", "train/tiles/hazy/00000_1.png"]


@pytest.fixture
def folder(tmp_path):
    for name in (
        "train/clear/a.png",
        "train/tiles/hazy/00000_0.png",
        "train/tiles/hazy/00000_1.png",
        "test/clear/b.png",
    ):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(name.encode())
    write_manifest(tmp_path, {"seed": 4})
    return tmp_path


def test_hashes_are_sha256_by_relative_path(folder):
    hashes = file_hashes(folder, jobs=2)
    assert list(hashes) == NAMES
    assert hashes == {name: hashlib.sha256(name.encode()).hexdigest() for name in NAMES}


def test_counts_are_of_frames_and_tiles(folder):
    counts = count_files(file_hashes(folder))
    assert counts == {"train": {"frames": 1, "tiles": 2}, "test": {"frames": 1, "tiles": 0}}


def test_a_whole_dataset_passes(folder):
    assert check_dataset(folder) == 4
    manifest = json.loads((folder / "manifest.json").read_text())
    assert manifest["seed"] == 4
    assert {"python", "numpy", "moderngl", "opengl"} <= set(manifest["versions"])


def test_what_is_wrong_is_named_in_one_line(folder, capsys):
    (folder / "train/clear/a.png").unlink()
    (folder / "test/clear/b.png").write_bytes(b"other")
    (folder / "test/c.txt").write_bytes(b"")
    (folder / "test/d.txt").write_bytes(b"")
    assert main(["dataset", str(folder), "--check"]) == 2
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("deckline: error")]
    assert lines == [
        f"deckline: error: {folder}: train/clear/a.png is missing, test/clear/b.png has changed, "
        "test/c.txt is not in the manifest and 1 more; make the dataset again in another folder"
    ]


def test_a_folder_without_a_manifest_of_ours_is_named(tmp_path):
    with pytest.raises(ValueError, match=r"holds no manifest\.json: give the command"):
        check_dataset(tmp_path)
    (tmp_path / "manifest.json").write_text('{"format": "other"}')
    with pytest.raises(ValueError, match="not a deckline-dataset manifest of version 1"):
        check_dataset(tmp_path)


@pytest.mark.parametrize("text", ["{", '{"format": "deckline-dataset", "version": 1}', '{"\xe4": 1}'])
def test_a_damaged_manifest_is_named(text, tmp_path):
    (tmp_path / "manifest.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(ValueError, match=r"manifest\.json is damaged: .*; remove it and give the command"):
        check_dataset(tmp_path)
