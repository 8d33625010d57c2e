"""The recipe on a few tiny frames: it runs, resumes, exports, and the export says what torch says."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import RigidTransform

from deckline.detect import OnnxDetector
from deckline.detect.anchors import RowGrid
from deckline.geometry import Camera, attitude
from deckline.recording import RecordingWriter
from deckline.train.backbone import CHANNELS, DepthwiseConv2d, Lite0Backbone
from deckline.train.checkpoint import CHECKPOINT_FILE
from deckline.train.detect import DetectTrainConfig, train_detect
from deckline.train.detect_validation import export_detect, summarise, torch_infer
from deckline.train.detect_views import make_line_view, open_line_views
from deckline.train.export import count_parameters
from deckline.train.line_networks import PyramidConfig, Ufld
from deckline.types import Detection, Frame, LinePoints, Segment, Truth

CAMERA = Camera.from_fov(320, 180, np.deg2rad(60))
LEFT = Segment(np.array([0.0, -12.0, -20.0]), np.array([220.0, -12.0, -20.0]))
RIGHT = Segment(np.array([0.0, 12.0, -20.0]), np.array([220.0, 12.0, -20.0]))


def frame(index: int, runway: bool = True) -> Frame:
    """Looking along two lines on a plane from 120 m before them, 20 m above; distance is that plane's or 2 km."""
    position = np.array([-120.0, 2.0 * index, -40.0])
    world_from_body = RigidTransform.from_components(position, attitude(0.02 * index, -0.12, 0.0))
    bare = Frame(f"img_{index}.ppm", float(index), np.zeros((180, 320, 3), np.uint8), CAMERA)
    world_from_camera = world_from_body * bare.body_from_camera
    v, u = np.mgrid[0:180, 0:320]
    pixels = np.stack([u.ravel(), v.ravel()], axis=1).astype(float)
    rays = world_from_camera.rotation.apply(CAMERA.rays(pixels))
    with np.errstate(divide="ignore"):
        depth = np.where(rays[:, 2] > 0.01, 20.0 / rays[:, 2], np.nan).reshape(180, 320)
    ground = position + rays * np.nan_to_num(depth.ravel(), nan=2000.0)[:, None]
    on_line = (np.abs(np.abs(ground[:, 1]) - 12) < 1.0) & (ground[:, 0] > 0) & (ground[:, 0] < 220)
    level = np.where(on_line.reshape(180, 320) & runway, 220, np.where(np.isnan(depth), 160, 60))
    image = np.repeat(level[..., None], 3, axis=2).astype(np.uint8)
    truth = Truth(LEFT if runway else None, RIGHT if runway else None, float("inf"), (160.0, 160.0, 160.0))
    return Frame(
        f"img_{index}.ppm",
        float(index),
        image,
        CAMERA,
        depth_m=depth.astype(np.float32),
        world_from_body=world_from_body,
        deck_z_m=-20.0,
        truth=truth,
    )


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("recording")
    with RecordingWriter(folder, "ppm", {"preset": "drawn"}) as writer:
        for index in range(6):
            writer.add(frame(index, runway=index != 3))
    return folder


def test_true_lines_are_projected_onto_the_paint():
    view = make_line_view(frame(1))
    assert view.lines_px is not None and view.ranges_m is not None
    for points, ranges in zip(view.lines_px[:2], view.ranges_m[:2], strict=True):
        inside = np.all((points > 1) & (points < [318, 178]), axis=1)
        u, v = np.rint(points[inside]).astype(int).T
        assert (view.clear.clear_rgb[v, u, 0] == 220).mean() > 0.9
        np.testing.assert_allclose(view.clear.range_m[v, u], ranges[inside], rtol=0.05)
    left, right, centre = view.lines_px
    assert left[:, 0].mean() < right[:, 0].mean()
    np.testing.assert_allclose(centre[0, 0], (left[0, 0] + right[0, 0]) / 2, atol=1.0)  # seen from straight behind
    assert view.centre_painted is None  # this recording does not say


def test_a_frame_without_runway_has_no_lines():
    assert make_line_view(frame(3, runway=False)).lines_px is None


def test_backbone_taps_and_frozen_parts():
    backbone = Lite0Backbone(pretrained=False).train()
    taps = backbone(torch.zeros(1, 3, 64, 96))
    assert [tuple(tap.shape) for tap in taps] == [
        (1, channels, 64 // stride, 96 // stride) for channels, stride in zip(CHANNELS, (4, 8, 16, 32), strict=True)
    ]
    assert not any(p.requires_grad for p in backbone.stem.parameters())
    assert all(p.requires_grad for p in backbone.blocks[2].parameters())
    assert not any(m.training for m in backbone.modules() if isinstance(m, torch.nn.BatchNorm2d))
    with pytest.raises(ValueError, match=r"frozen_blocks must lie in 0\.\.2, got 3"):
        Lite0Backbone(pretrained=False, frozen_blocks=3)


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


def test_training_learns_resumes_and_exports(recording, tmp_path):
    config = DetectTrainConfig(
        steps=2, minutes=None, batch=1, held_out=0.17, threads=1, shape=PyramidConfig(channels=16)
    )
    figures = train_detect(config, [recording], tmp_path)
    assert figures["steps"] == 2
    assert 0 <= figures["both_found.clear"] <= 1
    assert (tmp_path / CHECKPOINT_FILE).exists()
    longer = DetectTrainConfig(**(vars(config) | {"steps": 3}))
    assert train_detect(longer, [recording], tmp_path)["steps"] == 3
    with pytest.raises(ValueError, match=r"checkpoint of another recipe \(lr differ\)"):
        train_detect(DetectTrainConfig(**(vars(longer) | {"lr": 1.0})), [recording], tmp_path)
    assert OnnxDetector(tmp_path / "detect.onnx").config.grid == RowGrid()


def test_a_frame_that_cannot_be_used_is_named_and_left_out(recording, tmp_path, capsys):
    folder = tmp_path / "damaged"
    shutil.copytree(recording, folder)
    last = sorted((folder / "images").glob("*.ppm"))[-1]
    last.write_bytes(last.read_bytes()[:100])
    config = DetectTrainConfig(
        steps=1, minutes=None, batch=1, held_out=0.34, threads=1, shape=PyramidConfig(channels=16)
    )
    figures = train_detect(config, [folder], tmp_path / "out")
    assert figures["views"] == 2  # asked for
    assert f"skipped {last.name}" in capsys.readouterr().out.replace("\n", "")


def test_another_network_trains_the_same_way(recording, tmp_path):
    config = DetectTrainConfig(network="hybrid", steps=1, minutes=None, batch=1, held_out=0.17, threads=1)
    assert train_detect(config, [recording], tmp_path)["steps"] == 1
    longer = DetectTrainConfig(**(vars(config) | {"steps": 2}))
    assert train_detect(longer, [recording], tmp_path)["steps"] == 2
    with pytest.raises(ValueError, match=r"checkpoint of another recipe \(network differ\)"):
        train_detect(DetectTrainConfig(**(vars(longer) | {"network": "ufld"})), [recording], tmp_path)
    detector = OnnxDetector(tmp_path / "detect.onnx")
    assert detector.infer(np.zeros((3, 288, 512), np.float32)).columns.shape == (3, 128, 73)


def test_onnx_says_what_torch_says(tmp_path):
    torch.manual_seed(0)
    model = Ufld().eval()
    path = export_detect(model, tmp_path / "detect.onnx", {}, 0)
    detector = OnnxDetector(path)
    view = np.random.default_rng(0).standard_normal((3, 288, 512), dtype=np.float32)
    for one, other in zip(torch_infer(model)(view)[:3], detector.infer(view)[:3], strict=True):
        np.testing.assert_allclose(one, other, atol=2e-3)
    assert path.stat().st_size < 12e6


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


def test_views_are_split_and_counted(recording):
    assert len(open_line_views([recording, recording], 0.5)) == 6
    assert len(open_line_views([recording, recording], 0.5, train=False)) == 3
    with pytest.raises(ValueError, match="no training views"):
        open_line_views([recording], 1.0)
