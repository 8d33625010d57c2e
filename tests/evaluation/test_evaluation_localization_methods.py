from pathlib import Path

import numpy as np
import pytest

from approach_scene import frame
from deckline.dehaze.base import Restored
from deckline.evaluation.localization_methods import SharedDehazer, SharedDetector, load, methods_of
from deckline.localize import LocalizeConfig
from deckline.types import Detection, LinePoints


class Counting:
    """Dehazer or detector that counts its calls."""

    name = "counting"

    def __init__(self) -> None:
        self.calls = []

    def restore(self, at):
        self.calls.append(at.file)
        return Restored(at.image_rgb + np.uint8(1))

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


def test_a_picture_is_looked_at_once_for_each_box():
    counting = Counting()
    shared = SharedDetector(counting)
    image, other = (np.zeros((4, 6, 3), np.uint8) for _ in range(2))
    box = (1.0, 1.0, 3.0, 3.0)
    assert shared(image) is shared(image)
    assert shared(image, box).region_px == box
    assert shared(image, box) is shared(image, box)
    shared(other)
    assert counting.calls == [None, box, None]
    shared.forget()
    shared(image)
    assert len(counting.calls) == 4


def test_the_first_row_is_what_improvements_refer_to():
    methods, notes = methods_of("coarse-t", "ufld", "clear.onnx", {"resa": Path("r.onnx"), "enet-sad": None})
    assert methods[0].detector == "clear.onnx"
    assert (methods[0].dehazer, methods[0].estimator, methods[0].tracked) == ("none", "paper", False)
    assert [method.name for method in methods if "resa" in method.name] == ["resa, hazy, paper's"]
    assert notes == ["no row for enet-sad: give its network with --enet-sad FILE.onnx"]
    assert len({method.name for method in methods}) == len(methods)


def test_rows_share_their_stages_and_keep_their_estimator():
    methods, _ = methods_of("none", "classical", "classical", {})
    bench = load(methods, LocalizeConfig())
    chains = list(bench.pipelines.values())
    assert len({id(chain.detect) for chain in chains}) == len({id(chain.dehaze) for chain in chains}) == 1
    assert [chain.config.localize.method for chain in chains] == ["paper", "paper", "joint", "joint", "joint"]
    assert bench.settings["dehazed, ours, tracked"]["tracked"] is True
    assert "method = joint" in bench.settings["dehazed, ours"]["localization"]
    with pytest.raises(ValueError, match="unknown detector"):
        load(methods_of("none", "nobody", "classical", {})[0], LocalizeConfig())
