"""The recipe on a few tiny frames: it runs, resumes and exports."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from line_scene import LINES_PX, line_frame, two_lines

from deckline.detect import OnnxDetector
from deckline.detect.anchors import RowGrid
from deckline.recording import RecordingWriter
from deckline.types import Detection, LinePoints
from deckline_lab.labels import LabelledImage, write_labels
from deckline_lab.train.backbone import CHANNELS, DepthwiseConv2d, Lite0Backbone
from deckline_lab.train.detect import DetectTrainConfig, load_backdrops, summarise, train_detect
from deckline_lab.train.detect_samples import DetectAugmentation
from deckline_lab.train.export import count_parameters
from deckline_lab.train.line_networks import PyramidConfig, Ufld

TINY = DetectTrainConfig(
    network="ufld", steps=2, minutes=None, batch=1, held_out=0.34, threads=1, shape=PyramidConfig(channels=16)
)


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    """Six frames, one without a runway; the last one is damaged."""
    folder = tmp_path_factory.mktemp("recording")
    with RecordingWriter(folder, "ppm", {"preset": "drawn"}) as writer:
        for index in range(6):
            writer.add(line_frame(index, runway=index != 3))
    last = max((folder / "images").glob("*.ppm"))
    last.write_bytes(last.read_bytes()[:100])
    return folder


def test_backbone_taps_and_frozen_parts():
    backbone = Lite0Backbone(pretrained=False).train()
    taps = backbone(torch.zeros(1, 3, 64, 96))
    sizes = [(16, 24), (8, 12), (4, 6), (2, 3)]
    assert [tuple(tap.shape[1:]) for tap in taps] == [(n, *size) for n, size in zip(CHANNELS, sizes, strict=True)]
    assert not any(p.requires_grad for p in backbone.stem.parameters())
    assert all(p.requires_grad for p in backbone.blocks[2].parameters())
    assert not any(m.training for m in backbone.modules() if isinstance(m, torch.nn.BatchNorm2d))
    with pytest.raises(ValueError, match=r"frozen_blocks.*16"):
        Lite0Backbone(pretrained=False, frozen_blocks=16)


def test_frozen_blocks_hand_on_their_taps_without_a_gradient():
    backbone, image = Lite0Backbone(pretrained=False, frozen_blocks=0).train(), torch.rand(1, 3, 64, 96)
    free = backbone(image)
    backbone.frozen_blocks = 5
    taps = backbone(image)
    assert [tap.requires_grad for tap in taps] == [False, False, True, True]
    for one, other in zip(free, taps, strict=True):
        torch.testing.assert_close(one, other)


@pytest.mark.parametrize(("kernel", "dtype"), [(3, torch.bfloat16), (5, torch.float32)])
def test_wide_depthwise_convolutions_stay_exact_under_autocast(kernel, dtype):
    layer = DepthwiseConv2d(4, kernel)
    image = torch.rand(1, 4, 16, 24)
    with torch.autocast("cpu", torch.bfloat16):
        half = layer(image)
    assert half.dtype == dtype
    plain = torch.nn.functional.conv2d(image, layer.weight, padding=kernel // 2, groups=4)
    torch.testing.assert_close(layer(image), plain)
    torch.testing.assert_close(half.float(), plain, rtol=0.0, atol=0.0 if kernel == 5 else 0.02)


def test_network_is_small_and_its_cells_lie_on_the_pyramid():
    assert count_parameters(Ufld(PyramidConfig(pretrained=False))) < 3e6
    for grid in (RowGrid(cells=64), RowGrid(width=500)):
        with pytest.raises(ValueError, match=r"grid.*(64|500)"):
            PyramidConfig(grid)


@pytest.mark.parametrize("network", ["ufld", "hybrid"])
def test_training_resumes_exports_and_names_a_frame_that_cannot_be_used(network, recording, tmp_path, no_tiles, capsys):
    config = replace(TINY, network=network)
    figures = train_detect(config, [recording], tmp_path)
    assert (figures["steps"], figures["views"]) == (2, 2)
    assert f"skipped {max((recording / 'images').glob('*.ppm')).name}" in capsys.readouterr().out.replace("\n", "")
    assert 0 <= figures["both_found.clear"] <= 1
    longer = replace(config, steps=3, batch=2)
    assert train_detect(longer, [recording], tmp_path)["steps"] == 3
    with pytest.raises(ValueError, match=r"\(lr"):
        train_detect(replace(longer, lr=1.0), [recording], tmp_path)
    assert OnnxDetector(tmp_path / "detect.onnx").config.grid == RowGrid()


def test_training_on_labelled_pictures_alone_exports_a_detector(tmp_path, no_tiles):
    for k in range(8):
        cv2.imwrite(str(tmp_path / f"{k}.png"), two_lines())
    sides = [LINES_PX] * 6 + [(LINES_PX[0], None), (None, None)]
    write_labels(tmp_path / "labels.json", [LabelledImage(f"{k}.png", *lines) for k, lines in enumerate(sides)])
    figures = train_detect(replace(TINY, steps=1, batch=2, held_out=0.25), [tmp_path], tmp_path / "out")
    assert figures["views"] == 2.0  # the last two: one line alone, which is no clear case, and none
    for name in ("both_found", "false_alarms"):  # measured as they are: no haze is added
        assert figures[f"{name}.clear"] == figures[f"{name}.thick_haze"]
    assert OnnxDetector(tmp_path / "out" / "detect.onnx").config.grid == RowGrid()


def test_photographs_are_read_in_order_and_only_shrunk(recording, tmp_path, no_tiles):
    with pytest.raises(ValueError, match=str(tmp_path)):
        load_backdrops(tmp_path)
    for name, shape in (("b.png", (3, 2)), ("c.png", (2000, 1500)), ("a.png", (20, 30))):
        cv2.imwrite(str(tmp_path / name), np.zeros((*shape, 3), np.uint8))
    assert [picture.shape for picture in load_backdrops(tmp_path)] == [(20, 30, 3), (3, 2, 3), (1000, 750, 3)]
    config = replace(TINY, steps=1, augment=DetectAugmentation(backdrop_share=1.0))
    assert train_detect(config, [recording], tmp_path / "out", photographs=tmp_path)["steps"] == 1


def test_an_images_error_is_the_distance_from_the_true_line():
    line = np.stack([[[100.0, 200.0], [140.0, 100.0]], [[300.0, 200.0], [260.0, 100.0]]])
    v = np.linspace(110, 190, 9)
    left = np.stack([100 + (200 - v) * 0.4 + 2.0, v], axis=1)
    points = LinePoints(left, np.ones(9), np.full(9, 0.5))
    one, none = Detection(points, LinePoints.empty()), Detection(LinePoints.empty(), LinePoints.empty())
    figures = summarise([(one, line), (none, line), (one, None), (none, None)])
    assert (figures["both_found"], figures["false_alarms"]) == (0.0, 0.5)
    assert figures["error_px.median"] == figures["error_px.p90"] == pytest.approx(2.0 * np.cos(np.arctan(0.4)))
    assert figures["error_over_sigma.median"] == pytest.approx(4.0)
    assert summarise([(Detection(points, points), None)])["error_px.median"] == np.inf
