"""scripts/choose_thresholds.py rates the lines that the search returns."""

import runpy
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from test_detect_coarse_to_fine import BLACK, unsure_output

from deckline.detect.anchors import NetworkOutput
from deckline.detect.coarse_to_fine import DetectConfig
from deckline.detect.search import CropView, Search
from deckline.geometry import Camera
from deckline_lab.evaluation.detection_truth import ExpectedLines, SceneKind

SCRIPT = runpy.run_path(str(Path(__file__).parents[2] / "scripts" / "choose_thresholds.py"))
TRIED = {"BOTH": (0.3, 0.6, 1.1), "CLOSE": (0.5, 0.8, 1.1), "LONE": (0.6, 0.9, 1.1)}


def make_output(rng: np.random.Generator) -> NetworkOutput:
    """Of a network that is more or less sure of a runway, and of upright lines at random places."""
    return unsure_output(rng.uniform(0.4, 1.0), *rng.uniform(0.2, 0.99, 2), cells=rng.integers([10, 70], [50, 110]))


def make_search(rng: np.random.Generator) -> Search:
    """With three candidates, at times the whole picture among them."""
    search = Search(BLACK, lambda view: make_output(rng), DetectConfig(min_confidence=0.3))
    search.candidates = [CropView(make_output(rng), search.whole.crop, search.config) for _ in range(3)]
    if rng.random() < 0.5:
        search.candidates[0] = search.whole
    return search


@pytest.mark.parametrize("row", [0.3, 0.5])
def test_a_trial_counts_and_measures_what_the_search_chooses(row, monkeypatch):
    for name, values in TRIED.items():
        monkeypatch.setitem(SCRIPT["try_thresholds"].__globals__, name, values)
    rng = np.random.default_rng(0)
    searches = [make_search(rng) for _ in range(15)]
    left, right = (np.array([[u, 0.0], [u, 287.0]]) for u in (100.0, 340.0))
    deck = ExpectedLines(SceneKind.DECK, {"left": left, "right": right}, visibility_m=1000.0)
    camera = Camera.from_fov(512, 288, 1.0)
    views = [SCRIPT["ScoredView"](camera, deck, one.whole, one.candidates) for one in searches]
    empty = views[0]._replace(expected=ExpectedLines(SceneKind.EMPTY, {"left": None, "right": None}))
    tried = SCRIPT["try_thresholds"]([*views, empty], row)
    for trial, (both, close, lone) in zip(tried, product(*TRIED.values()), strict=True):
        names = {"min_probability": both, "min_close_probability": close, "min_lone_probability": lone}
        config = replace(DetectConfig(min_confidence=row), **names)
        chosen = [choose(one, config) for one in searches]
        pairs = [each for each in chosen if each is not None and each.count == 2]
        assert trial.found[2] == pytest.approx(len(pairs) / len(searches))
        assert trial.alone[0] == sum(each is not None and each.count == 1 for each in chosen)
        assert trial.false_share == (chosen[0] is not None)
        if pairs:
            errors = [np.abs(each.lines.left.points_px[:, 0] - 100) for each in pairs]
            errors += [np.abs(each.lines.right.points_px[:, 0] - 340) for each in pairs]
            assert trial.error_px[0] == pytest.approx(np.median(np.concatenate(errors)), abs=1e-6)


def choose(search: Search, config: DetectConfig) -> CropView | None:
    """What the search would choose with another configuration."""
    other = Search(BLACK, lambda view: search.whole.output, config)
    other.candidates = [
        other.whole if view is search.whole else replace(view, config=config) for view in search.candidates
    ]
    return other.choose()
