"""Train the line detector: the recipe, the training, figures on held-out views, and the ONNX file."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from rich.console import Console
from torch import Tensor

from deckline.detect.anchors import DecodeConfig, network_output
from deckline.detect.coarse_to_fine import DetectConfig, NetworkOutput
from deckline.detect.search import detect_lines
from deckline.haze import add_haze
from deckline.types import SIDES, Detection, LinePoints
from deckline_lab.train import loop
from deckline_lab.train.airlight import random_airlight
from deckline_lab.train.detect_losses import DetectTargets, LossWeights
from deckline_lab.train.detect_samples import DetectAugmentation, make_batch
from deckline_lab.train.export import count_parameters, export_onnx, network_cost
from deckline_lab.train.line_networks import Hybrid, LineNetwork, PyramidConfig, Ufld
from deckline_lab.train.line_views import LineView, open_line_views
from deckline_lab.train.loop import Recipe
from deckline_lab.train.start import recalibrate_batch_norm, start_detector
from deckline_lab.train.view_sets import Views, make_ahead, open_pictures

START_VIEWS = 24  # whose statistics the batch norms of another training's weights are given
VALIDATION_VIEWS = 120  # at most, spread over the held-out ones
DEPTHS = {"clear": (0.0, 0.0), "light_haze": (0.0, 1.0), "thick_haze": (1.0, 2.5)}  # optical depth up to the ramp
BACKDROP_PX = 1000  # of a photograph behind a view, long side
LEAST_SHARE = 0.1  # of both lines in the image; views with less are no clear case


@dataclass(frozen=True)
class DetectTrainConfig(Recipe):
    """Recipe; its defaults are made for an hour of two CPU cores."""

    network: str = "hybrid"  # a shipped one, or one to compare it with
    # of ours; compared ones take the size of its view, and their backbone's first weights and what of it is trained
    shape: PyramidConfig = field(default_factory=PyramidConfig)
    backbone_lr: float = 0.3  # relative to the heads'
    augment: DetectAugmentation = field(default_factory=DetectAugmentation)
    losses: LossWeights = field(default_factory=LossWeights)
    minutes: float | None = 60.0  # stop after so much training time; the schedule follows whichever ends first
    lr: float = 1.5e-3  # of the heads
    warm_up: float = 0.03  # of the run
    clip_norm: float = 5.0  # of the gradient
    ema_decay: float = 0.995  # of the averaged weights, which are the ones exported

    def identity(self) -> dict[str, Any]:
        """As of every recipe, but the batch may change."""
        return {name: value for name, value in super().identity().items() if name != "batch"}


NETWORKS: dict[str, Callable[[DetectTrainConfig], LineNetwork]] = {
    "hybrid": lambda config: Hybrid(config.shape),
    "ufld": lambda config: Ufld(config.shape),
}


def train_detect(
    config: DetectTrainConfig,
    recordings: list[Path],
    out: Path,
    start_from: Path | None = None,
    networks: Mapping[str, Callable[[DetectTrainConfig], LineNetwork]] = NETWORKS,
    photographs: Path | None = None,
) -> dict[str, float]:
    """Train until the budget is used, then validate and export `out`/detect.onnx; returns the measured figures.

    Args:
        config: recipe; a checkpoint in `out` must have been made with the same one, budget, batch and machine apart.
        recordings: clear recordings with full depth and true lines, or pictures with labels.json.
        out: folder of checkpoint.safetensors, losses.csv, losses.png and detect.onnx.
        start_from: folder of an earlier training, or its .onnx file: its averaged weights are this one's first.
        networks: what can be trained, by name.
        photographs: folder of pictures that take the place of the sky; without a runway in them.
    """
    console = Console()
    device = loop.select_device(config)
    model: LineNetwork = loop.build_network(networks, config)
    views, held_out = (open_line_views(recordings, config.held_out, part) for part in (True, False))
    grid = model.kind.target_grid
    backdrops = [] if photographs is None else load_backdrops(photographs)
    if start_from is not None:
        start_detector(model, start_from)
        recalibrate_batch_norm(model, make_batch(views, START_VIEWS, grid, config.augment, [config.seed])[0])
    model.to(device)
    model.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # torch's stubs lack this form
    run = loop.open_run(config, model, make_optimizer(config, model), out)
    console.print(f"{count_parameters(model)} parameters, {len(views)} views, {device}, from step {run.step}")

    def make(step: int, views: Views[LineView] = views) -> tuple[Tensor, DetectTargets]:
        return make_batch(views, config.batch, grid, config.augment, [config.seed, step], backdrops)

    def loss(batch: tuple[Tensor, DetectTargets], fraction: float) -> loop.Loss:
        image = batch[0].to(device, memory_format=torch.channels_last)
        targets = DetectTargets(*(tensor.to(device) for tensor in batch[1])).first(model.kind.lines)
        model.train()
        with loop.autocast(config, device):
            output = model(image)
        return model.loss(output, targets, config.losses, fraction)

    measured = [make(k, held_out) for k in range(loop.HELD_OUT_BATCHES)]
    loop.train(config, run, make_ahead(make, run.step, config.steps), loss, console, measured)
    model.load_state_dict(run.ema)
    path = export_detect(model, out / "detect.onnx", run.recipe, run.step)
    figures = validate(model, held_out, config.augment, config.seed)
    figures |= {"steps": run.step, "minutes": run.seconds / 60}
    loop.print_figures(console, figures, views.skipped | held_out.skipped)
    console.print(str(path))
    return figures


def load_backdrops(folder: Path) -> list[NDArray[np.uint8]]:
    """The pictures (H, W, 3) of a folder, long sides at most `BACKDROP_PX`."""
    count, load = open_pictures(folder, BACKDROP_PX)
    return [load(index) for index in range(count)]


def make_optimizer(config: DetectTrainConfig, model: LineNetwork) -> torch.optim.Optimizer:
    """AdamW; what has a rate of its own is a group of its own, the rest comes last."""
    rates = {"backbone.": config.backbone_lr, **model.rates}
    groups: dict[str, list[Tensor]] = {prefix: [] for prefix in (*rates, "")}
    for name, parameter in model.named_parameters():
        if parameter.requires_grad:
            groups[next(prefix for prefix in groups if name.startswith(prefix))].append(parameter)
    given = [{"params": some, loop.RATE: rates.get(prefix, 1.0)} for prefix, some in groups.items() if some]
    return torch.optim.AdamW(given, config.lr, weight_decay=config.weight_decay, fused=True)


def validate(model: LineNetwork, views: Views[LineView], augment: DetectAugmentation, seed: int) -> dict[str, float]:
    """Found rates and errors on whole held-out views through the runtime's own search: clear, light and thick haze.

    Haze depends on `seed` and the view alone, so that runs can be compared.
    """
    was_training = model.training
    model.eval()
    infer, config = torch_infer(model), model.kind.search
    chosen = views.spread(VALIDATION_VIEWS)
    figures: dict[str, float] = {"views": float(len(chosen))}
    for name, depths in DEPTHS.items():
        detections = []
        for index in chosen:
            rng = np.random.default_rng([seed, index])
            view = views.get_usable(index)
            if view is not None and _is_clear_case(view):
                image = _add_haze(view, rng.uniform(*depths), augment, rng)
                detections.append((detect_lines(image, infer, config), view.lines_px))
        figures |= {f"{key}.{name}": value for key, value in summarise(detections).items()}
    model.train(was_training)
    return figures


def summarise(detections: list[tuple[Detection, NDArray[np.float64] | None]]) -> dict[str, float]:
    """Figures of detections with the true lines (3, N, 2) px, of which left and right count; None: no runway.

    An image's error is the median distance of its points from their lines, px; what does not exist is 0 or infinite.
    """
    found = [[len(getattr(detection, side)) > 0 for side in SIDES] for detection, _ in detections]
    runway = [lines is not None for _, lines in detections]
    errors, ratios = [], [np.zeros(0)]
    for detection, lines in detections:
        if lines is not None and any(len(getattr(detection, side)) for side in SIDES):
            pairs = [line_errors(getattr(detection, side), line) for side, line in zip(SIDES, lines, strict=False)]
            errors.append(float(np.median(np.concatenate([distance for distance, _ in pairs]))))
            ratios += [ratio for _, ratio in pairs]
    both = [all(sides) for sides, there in zip(found, runway, strict=True) if there]
    false = [any(sides) for sides, there in zip(found, runway, strict=True) if not there]
    over_sigma = np.abs(np.concatenate(ratios))
    return {
        "both_found": float(np.mean(both)) if both else 0.0,
        "error_px.median": float(np.median(errors)) if errors else float("inf"),
        "error_px.p90": float(np.quantile(errors, 0.9)) if errors else float("inf"),
        "error_over_sigma.median": float(np.median(over_sigma)) if len(over_sigma) else float("inf"),
        "false_alarms": float(np.mean(false)) if false else 0.0,
    }


def line_errors(points: LinePoints, line_px: NDArray[np.float64]) -> tuple[NDArray, NDArray]:
    """Of every point (N,): distance from a straight line through (M, 2) px, and error along u over its sigma."""
    start, end = line_px[0], line_px[-1]
    direction = (end - start) / np.linalg.norm(end - start)
    offset = points.points_px - start
    normal = offset[:, 0] * direction[1] - offset[:, 1] * direction[0]
    along_u = normal / max(abs(direction[1]), 1e-6)
    return np.abs(normal), along_u / points.sigma_px


def _is_clear_case(view: LineView) -> bool:
    """Whether there is no runway, or a good part of both lines is in the image; what lies between is no clear case."""
    if view.lines_px is None:
        return True
    height, width = view.image_rgb.shape[:2]
    edges = view.lines_px[: len(SIDES)]
    inside = np.all((edges >= 0) & (edges <= [width - 1, height - 1]), axis=2)
    return bool((inside.mean(axis=1) > LEAST_SHARE).all())


def _add_haze(view: LineView, depth: float, augment: DetectAugmentation, rng: np.random.Generator) -> NDArray[np.uint8]:
    if view.clear is None or depth == 0.0:
        return view.image_rgb
    ramp_m = 300.0 if view.ranges_m is None else max(float(view.ranges_m.min()), 20.0)
    airlight = random_airlight(view.clear.horizon_rgb, augment.horizon_share, rng)
    return add_haze(view.clear.clear_rgb, view.clear.range_m, depth / ramp_m, airlight)


def torch_infer(model: LineNetwork) -> Callable[[NDArray[np.float32]], NetworkOutput]:
    """The network as the runtime's search calls it."""
    device = next(model.parameters()).device

    @torch.no_grad()
    def infer(view: NDArray[np.float32]) -> NetworkOutput:
        tensors = zip(model.kind.output_names, model(torch.from_numpy(view)[None].to(device)), strict=False)
        return network_output({name: value[0].float().cpu().numpy() for name, value in tensors}, model.kind.grid)

    return infer


class _Exported(torch.nn.Module):
    """What runs in flight: without the training-only branch."""

    def __init__(self, model: LineNetwork) -> None:
        super().__init__()
        self.model = model

    def forward(self, image: torch.Tensor) -> tuple[torch.Tensor, ...]:
        return tuple(self.model(image)[: len(self.model.kind.output_names)])


def export_detect(model: LineNetwork, path: Path, recipe: dict[str, Any], step: int) -> Path:
    """Write the network as ONNX for one view at a time; recipe, grid, search and cost go into the metadata."""
    grid, search = model.kind.grid, model.kind.search
    exported = _Exported(model).train(model.training)
    cost = {"parameters": runtime_parameters(model), "macs": network_cost(exported, (grid.height, grid.width)).macs}
    metadata = {"kind": "detect", "grid": asdict(grid), **cost, "recipe": recipe, "step": step}
    if search.decode != DecodeConfig():
        metadata["decode"] = asdict(search.decode)
    default = DetectConfig(grid, search.decode)
    metadata["search"] = {name: value for name, value in vars(search).items() if value != getattr(default, name)}
    args = (torch.zeros(1, 3, grid.height, grid.width, device=next(model.parameters()).device),)
    return export_onnx(exported, args, path, ["image"], list(model.kind.output_names), None, metadata)


def runtime_parameters(model: LineNetwork) -> int:
    """Parameters without the training-only branch, which is called `segmentation` in every network that has one."""
    return sum(value.numel() for name, value in model.named_parameters() if not name.startswith("segmentation."))
