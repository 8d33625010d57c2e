"""What follows training: figures on held-out views, and the ONNX file."""

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from deckline.detect.anchors import DecodeConfig, network_output
from deckline.detect.coarse_to_fine import DetectConfig, NetworkOutput, detect_lines
from deckline.haze import add_haze
from deckline.train.dehaze_haze import random_airlight
from deckline.train.detect_augment import DetectAugmentation
from deckline.train.detect_data import LineViews
from deckline.train.detect_labels import LabelledView
from deckline.train.detect_views import LineView
from deckline.train.export import export_onnx
from deckline.train.line_network import LineNetwork
from deckline.train.network_cost import network_cost
from deckline.types import Detection, LinePoints

VALIDATION_VIEWS = 120  # at most, spread over the held-out ones
LIGHT_HAZE, THICK_HAZE = (0.0, 1.0), (1.0, 2.5)  # optical depth up to the ramp


class Score(NamedTuple):
    """How one image went."""

    has_runway: bool
    both_found: bool
    any_found: bool
    errors_px: NDArray[np.float64]  # (N,) distance of every point from its true line, image px
    sigma_ratio: NDArray[np.float64]  # (N,) signed error along u over the claimed sigma


def torch_infer(model: LineNetwork) -> Callable[[NDArray[np.float32]], NetworkOutput]:
    """The network as the runtime's looks call it."""
    device = next(model.parameters()).device

    @torch.no_grad()
    def infer(view: NDArray[np.float32]) -> NetworkOutput:
        tensors = zip(model.kind.output_names, model(torch.from_numpy(view)[None].to(device)), strict=False)
        return network_output({name: value[0].float().cpu().numpy() for name, value in tensors}, model.kind.grid)

    return infer


def line_errors(points: LinePoints, line_px: NDArray[np.float64]) -> tuple[NDArray, NDArray]:
    """Of every point (N,): distance from a straight line through (M, 2) px, and error along u over its sigma."""
    start, end = line_px[0], line_px[-1]
    direction = (end - start) / np.linalg.norm(end - start)
    offset = points.points_px - start
    normal = offset[:, 0] * direction[1] - offset[:, 1] * direction[0]
    along_u = normal / max(abs(direction[1]), 1e-6)
    return np.abs(normal), along_u / points.sigma_px


def score(detection: Detection, lines_px: NDArray[np.float64] | None) -> Score:
    """Compare with true lines (3, N, 2) px, of which left and right count; None: no runway."""
    sides = (detection.left, detection.right)
    found = [len(points) > 0 for points in sides]
    empty = np.zeros(0)
    if lines_px is None:
        return Score(False, all(found), any(found), empty, empty)
    pairs = [line_errors(points, line) for points, line in zip(sides, lines_px[: len(sides)], strict=True)]
    errors, ratios = (np.concatenate(column) for column in zip(*pairs, strict=True))
    return Score(True, all(found), any(found), errors, ratios)


def validate(model: LineNetwork, views: LineViews, augment: DetectAugmentation, seed: int) -> dict[str, float]:
    """Found rates and errors on whole held-out views through the runtime's own looks: clear, light and thick haze.

    Haze depends on `seed` and the view alone, so that runs can be compared.
    """
    was_training = model.training
    model.eval()
    infer, config = torch_infer(model), DetectConfig(grid=model.kind.grid, decode=model.kind.decode)
    chosen = np.linspace(0, len(views) - 1, min(len(views), VALIDATION_VIEWS)).round().astype(int)
    figures: dict[str, float] = {"views": float(len(chosen))}
    for name, depths in (("clear", (0.0, 0.0)), ("light_haze", LIGHT_HAZE), ("thick_haze", THICK_HAZE)):
        scores = []
        for index in chosen:
            rng = np.random.default_rng([seed, int(index)])
            view = views.usable(int(index))
            if view is not None and _can_be_scored(view):
                image = _hazed(view, rng.uniform(*depths), augment, rng)
                scores.append(score(detect_lines(image, infer, config), view.lines_px))
        figures |= {f"{key}.{name}": value for key, value in _summary(scores).items()}
    model.train(was_training)
    return figures


def _summary(scores: list[Score]) -> dict[str, float]:
    runway = [s for s in scores if s.has_runway]
    empty = [s for s in scores if not s.has_runway]
    errors = np.array([np.median(s.errors_px) for s in runway if len(s.errors_px)])
    ratios = np.concatenate([s.sigma_ratio for s in runway]) if runway else np.zeros(0)
    return {
        "both_found": float(np.mean([s.both_found for s in runway])) if runway else 0.0,
        "error_px.median": float(np.median(errors)) if len(errors) else float("inf"),
        "error_px.p90": float(np.quantile(errors, 0.9)) if len(errors) else float("inf"),
        "error_over_sigma.median": float(np.median(np.abs(ratios))) if len(ratios) else float("inf"),
        "false_alarms": float(np.mean([s.any_found for s in empty])) if empty else 0.0,
    }


def _can_be_scored(view: LineView | LabelledView) -> bool:
    """Whether there is no runway, or a good part of both lines is in the image; what lies between is no clear case."""
    if view.lines_px is None:
        return True
    height, width = view.image_rgb.shape[:2]
    edges = view.lines_px[:2]
    inside = np.all((edges >= 0) & (edges <= [width - 1, height - 1]), axis=2)
    return bool((inside.mean(axis=1) > 0.1).all())


def _hazed(
    view: LineView | LabelledView, depth: float, augment: DetectAugmentation, rng: np.random.Generator
) -> NDArray[np.uint8]:
    if isinstance(view, LabelledView) or depth == 0.0:
        return view.image_rgb
    ramp_m = 300.0 if view.ranges_m is None else max(float(view.ranges_m.min()), 20.0)
    airlight = random_airlight(view.clear.horizon_rgb, augment.horizon_share, rng)
    return add_haze(view.clear.clear_rgb, view.clear.range_m, depth / ramp_m, airlight)


class _Exported(torch.nn.Module):
    """What runs in flight: without the training-only branch."""

    def __init__(self, model: LineNetwork) -> None:
        super().__init__()
        self.model = model
        self.outputs = model.kind.output_names

    def forward(self, image: torch.Tensor) -> tuple[torch.Tensor, ...]:
        return tuple(self.model(image)[: len(self.outputs)])


def export_detect(model: LineNetwork, path: Path, recipe: dict[str, Any], step: int) -> Path:
    """Write the network as ONNX for one view at a time; recipe, grid, decoding and cost go into the metadata."""
    grid, decode = model.kind.grid, model.kind.decode
    exported = _Exported(model)
    metadata = {
        "kind": "detect",
        "grid": asdict(grid),
        "parameters": runtime_parameters(model),
        "macs": network_cost(exported, (grid.height, grid.width)).macs,  # of one view
        "recipe": recipe,
        "step": step,
    }
    if decode != DecodeConfig():
        metadata["decode"] = asdict(decode)
    args = (torch.zeros(1, 3, grid.height, grid.width, device=next(model.parameters()).device),)
    exported.train(model.training)
    return export_onnx(exported, args, path, ["image"], list(model.kind.output_names), None, metadata)


def runtime_parameters(model: LineNetwork) -> int:
    """Parameters without the training-only branch, which is called `segmentation` in every network that has one."""
    return sum(value.numel() for name, value in model.named_parameters() if not name.startswith("segmentation."))
