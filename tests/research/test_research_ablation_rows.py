"""The rows of Table 5: what differs between them, and that they are trained once each, by one recipe."""

import json
import shutil
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from clear_scene import QUICK, clear_recording, hazy_recording, interrupting
from deckline.dehaze import OnnxDehazer
from deckline.research import ablation_rows as ablation
from deckline.research.ablation_rows import ROWS, WEIGHTS_FILE, check_pairs, is_finished, row_recipe, train_rows
from deckline.train import loop
from deckline.train.checkpoint import read_progress
from deckline.train.dehaze import build_ours
from deckline.train.dehaze_samples import make_batch
from deckline.train.dehaze_views import open_clear_views
from deckline.train.export import network_cost

TINY = replace(QUICK, steps=2)
ENDS = (ROWS[0], ROWS[-1])  # `deckline eval ablation`'s own test trains them all


@pytest.fixture(scope="module")
def pairs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return hazy_recording(tmp_path_factory.mktemp("pairs"), frames=6)


@pytest.fixture(autouse=True, scope="module")
def _two_rows() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ablation, "ROWS", ENDS)
        yield


@pytest.fixture(scope="module")
def folder(pairs: Path, tmp_path_factory: pytest.TempPathFactory, _two_rows: None) -> Path:
    """Two rows, trained."""
    out = tmp_path_factory.mktemp("rows")
    train_rows(TINY, pairs, out)
    return out


def test_every_row_adds_one_part() -> None:
    parts = [(row.attention, row.transformer, row.augmented) for row in ROWS]
    assert parts[0] == ("depthwise", "plain", False)
    assert parts[-1] == ("mix", "mobilevit", True)
    for above, below in pairwise(parts):
        assert sum(a != b for a, b in zip(above, below, strict=True)) == 1


def test_rows_without_augmentation_see_each_pair_as_it_was_recorded(pairs: Path) -> None:
    recipe = row_recipe(ROWS[2], replace(TINY, crop_height=64, crop_width=96))  # crops as large as the pictures
    views = open_clear_views([pairs], 640, 0.0)
    recorded = {(views[k].clear_rgb.tobytes(), np.asarray(views[k].hazy_rgb).tobytes()) for k in range(len(views))}
    for step in range(4):
        hazy, clear, *_ = make_batch(views, 2, (64, 96), recipe.haze, [0, step])
        for images in zip(clear, hazy, strict=True):
            drawn = tuple((255 * x).round().byte().permute(1, 2, 0).numpy().tobytes() for x in images)
            assert drawn in recorded


def test_the_augmented_row_does_not(pairs: Path) -> None:
    recipe = row_recipe(ROWS[3], TINY)
    assert recipe.haze == TINY.haze
    views = open_clear_views([pairs], 640, 0.0)
    recorded = {np.asarray(views[k].hazy_rgb).tobytes() for k in range(len(views))}
    hazy, *_ = make_batch(views, 4, (64, 96), recipe.haze, [0, 0])
    drawn = {(255 * x).round().byte().permute(1, 2, 0).numpy().tobytes() for x in hazy}
    assert not drawn & recorded


def test_rows_are_trained_once_each(pairs: Path, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    written = {path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()}
    rows = train_rows(replace(TINY, threads=2), pairs, folder)  # the machine may differ
    assert capsys.readouterr().out.count("finished before") == 2
    assert written == {path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()}
    assert list(rows) == ["baseline", "augmentation"]
    for trained, row in zip(rows.values(), ENDS, strict=True):
        assert trained["steps"] == 2
        assert trained["minutes"] > 0
        cost = network_cost(build_ours(row_recipe(row, TINY)))
        assert (trained["parameters"], trained["macs_256"]) == (cost.parameters, cost.macs)
        stored = OnnxDehazer(folder / row.key / WEIGHTS_FILE, threads=1).session.config
        assert (stored["network"]["attention"], stored["network"]["transformer"]) == (row.attention, row.transformer)
        assert stored["recipe"]["haze"]["recorded_share"] == (0.0 if row.augmented else 1.0)


def test_an_interrupted_row_goes_on(pairs: Path, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out, last = tmp_path / "rows", ROWS[-1].key
    shutil.copytree(folder, out, ignore=shutil.ignore_patterns(last))
    monkeypatch.setattr(loop, "_step", interrupting(loop._step, at=1))
    with pytest.raises(KeyboardInterrupt):
        train_rows(TINY, pairs, out)
    monkeypatch.undo()
    progress = read_progress(out / last)
    assert progress is not None
    assert progress["step"] == 1
    assert not is_finished(row_recipe(ROWS[-1], TINY), out / last)
    rows = train_rows(TINY, pairs, out)
    assert [row["steps"] for row in rows.values()] == [2, 2]


def test_a_folder_of_another_recipe_is_refused(pairs: Path, folder: Path, tmp_path: Path) -> None:
    assert json.loads((folder / "recipe.json").read_text())["recording"] == str(pairs.resolve())
    with pytest.raises(ValueError, match="holds an ablation with another batch, steps: use another folder"):
        train_rows(replace(TINY, steps=3, batch=1), pairs, folder)
    (tmp_path / "recipe.json").write_text("{")
    with pytest.raises(ValueError, match=r"recipe\.json is damaged"):
        train_rows(TINY, pairs, tmp_path)


def test_pictures_without_haze_are_no_pairs(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="is no pair of a hazy and a clear picture"):
        check_pairs(clear_recording(tmp_path / "clear", frames=2), 0.5)
    image = next((hazy_recording(tmp_path / "bad", frames=1) / "images").glob("*_0_*"))
    image.write_bytes(b"P6")
    with pytest.raises(ValueError, match="no frame can be read"):
        check_pairs(tmp_path / "bad", 1.0)
    with pytest.raises(ValueError, match="1 pairs are too few to keep 5 % out of training"):
        check_pairs(tmp_path / "bad", 0.05)
