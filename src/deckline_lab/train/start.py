"""First weights from an earlier training: a folder's checkpoint, or an exported file, a shipped one too.

A detector's file has its batch norms folded into the convolutions before them; they are unfolded here.
"""

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from deckline.config import Engine
from deckline.runtime import load_session
from deckline_lab.train.checkpoint import read_tensors
from deckline_lab.train.line_networks import LineNetwork, PyramidNetwork

BACKBONE = "/model/backbone/"
NORM_OF = {"_expand_conv": "_bn0", "_depthwise_conv": "_bn1", "_project_conv": "_bn2", "0": "1"}  # by last name
SAME = 2e-3  # of the outputs' largest value; what torch and ONNX Runtime may differ by


def start_with(model: nn.Module, source: Path) -> None:
    """Give a model an earlier one's averaged weights.

    A convolution that takes more channels than it did starts with zeros for the new ones, so that the model does at
    first what the earlier one did. A file holds equal tensors once, so it must be that of a trained model.

    Args:
        model: changed in place.
        source: folder with a checkpoint, or an .onnx file made by `deckline train`.
    """
    stored = _read_onnx(source)[1] if source.is_file() else read_tensors(source, "ema")
    own = model.state_dict()
    missing = sorted(own.keys() - stored.keys())
    if missing:
        raise ValueError(f"{source} holds the weights of another network: it has no {missing[0]}")
    model.load_state_dict({name: _fit_shape(stored[name], own[name], f"{source}: {name}") for name in own})


def _fit_shape(stored: Tensor, own: Tensor, where: str) -> Tensor:
    if stored.shape == own.shape:
        return stored
    if stored.ndim == 4 and own.ndim == 4 and stored.shape[1] < own.shape[1]:
        grown = torch.zeros_like(own, device="cpu")
        if grown[:, : stored.shape[1]].shape == stored.shape:
            grown[:, : stored.shape[1]] = stored
            return grown
    raise ValueError(f"{where} has shape {tuple(stored.shape)}, expected {tuple(own.shape)}")


def _read_onnx(path: Path) -> tuple[Any, dict[str, Tensor]]:
    """Graph of a file that deckline can run, and its tensors by name."""
    load_session(path, Engine(threads=1))  # refuses what is no usable network
    graph = onnx.load(str(path)).graph
    return graph, {item.name: torch.from_numpy(onnx.numpy_helper.to_array(item).copy()) for item in graph.initializer}


def start_detector(model: LineNetwork, source: Path) -> None:
    """Give a detector an earlier one's weights.

    Args:
        model: changed in place.
        source: folder with a checkpoint, or an .onnx file of the same network.
    """
    if not source.is_file():
        start_with(model, source)
    elif isinstance(model, PyramidNetwork):
        start_with_file(model, source)
    else:
        raise ValueError(
            f"{source}: only networks hybrid and ufld start from an .onnx file; give a training's folder instead"
        )


def start_with_file(model: PyramidNetwork, path: Path) -> None:
    """Give a detector the weights of an exported one.

    Parts that the file lacks retain their own weights: the training-only branch, in earlier files the kind of edge.

    A folded convolution's weights become the convolution's, its bias that of a batch norm which does nothing else: the
    model then computes what the file does, which is checked.
    """
    graph, stored = _read_onnx(path)
    own = model.state_dict()
    found: dict[str, Tensor] = {}
    for node, prefix in _convolutions(graph, model):
        weight, bias = (stored.get(name) for name in node.input[1:3])
        if weight is None or bias is None:
            raise ValueError(f"{path} holds another network: {node.name} has no weights of its own")
        found |= _unfold_norm(prefix, weight, bias, model)
    found |= {name.removeprefix("model."): value for name, value in stored.items() if name.startswith("model.")}
    retained = {
        name for name in own if name.startswith(("segmentation.", "edge.")) or name.endswith("num_batches_tracked")
    }
    wrong = [name for name, value in found.items() if name not in own or own[name].shape != value.shape]
    wrong += [name for name in own if name not in found.keys() | retained]
    if wrong:
        raise ValueError(f"{path} holds another network: {wrong[0]} does not fit")
    model.load_state_dict({**own, **found})
    _check_same(model, path)


def recalibrate_batch_norm(model: LineNetwork, views: Tensor) -> None:
    """Give the batch norms that training uses the statistics of views (B, 3, H, W), and weights that undo the change.

    What the model computes stays the same. In a file batch norms are folded away; without this the first training step
    would scale every feature anew.
    """
    hooks = [
        part.register_forward_pre_hook(_settle)
        for name, part in model.named_modules()
        if isinstance(part, nn.BatchNorm2d) and not name.startswith("backbone.")
    ]
    _evaluate(model, views)
    for hook in hooks:
        hook.remove()


@torch.no_grad()
def _evaluate(model: LineNetwork, views: Tensor) -> list[NDArray[np.float32]]:
    """The exported outputs for views, in evaluation mode."""
    was_training = model.training
    model.eval()
    outputs = model(views.to(next(model.parameters()).device))[: len(model.kind.output_names)]
    model.train(was_training)
    return [output.cpu().numpy() for output in outputs]


def _settle(norm: nn.Module, inputs: tuple[Tensor, ...]) -> None:
    assert isinstance(norm, nn.BatchNorm2d) and norm.running_mean is not None and norm.running_var is not None
    variance, mean = torch.var_mean(inputs[0], dim=(0, 2, 3))
    scale = norm.weight / torch.sqrt(norm.running_var + norm.eps)
    norm.bias.copy_(norm.bias + scale * (mean - norm.running_mean))
    norm.weight.copy_(scale * torch.sqrt(variance + norm.eps))
    norm.running_mean.copy_(mean)
    norm.running_var.copy_(variance)


def _convolutions(graph: Any, model: PyramidNetwork) -> list[tuple[Any, str]]:
    """Every convolution that a batch norm was folded into, and its module's name; the backbone's are in order."""
    names = (f"backbone.{name}" for name, part in model.backbone.named_modules() if isinstance(part, nn.Conv2d))
    return [
        (node, next(names, "") if node.name.startswith(BACKBONE) else _module_name(node.name))
        for node in graph.node
        if node.op_type == "Conv" and not node.input[1].startswith("model.")
    ]


def _module_name(node_name: str) -> str:
    """/model/rows/blocks/blocks.0/blocks.0.0/Conv -> rows.blocks.0.0."""
    parts = node_name.split("/")[2:-1]
    return ".".join(part for part, below in pairwise([*parts, ""]) if not below.startswith(f"{part}."))


def _unfold_norm(name: str, weight: Tensor, bias: Tensor, model: LineNetwork) -> dict[str, Tensor]:
    """The convolution's weight, and statistics with which the batch norm after it adds the bias alone."""
    stem, _, last = name.rpartition(".")
    norm_name = f"{stem}.{NORM_OF.get(last, '')}"
    norm = dict(model.named_modules()).get(norm_name)
    if not isinstance(norm, nn.BatchNorm2d):
        return {f"{name}.weight": weight}
    ones = torch.ones_like(bias)
    values = {"weight": ones, "bias": bias, "running_mean": 0 * ones, "running_var": ones - norm.eps}
    return {f"{name}.weight": weight} | {f"{norm_name}.{part}": value for part, value in values.items()}


def _check_same(model: LineNetwork, path: Path) -> None:
    session = load_session(path, Engine(threads=1))
    grid = model.kind.grid
    view = np.random.default_rng(0).standard_normal((1, 3, grid.height, grid.width), dtype=np.float32)
    theirs = dict(zip(session.output_names, session(image=view), strict=True))
    for name, value in zip(model.kind.output_names, _evaluate(model, torch.from_numpy(view)), strict=True):
        if name in theirs and np.abs(value - theirs[name]).max() > SAME * max(float(np.abs(theirs[name]).max()), 1.0):
            raise ValueError(f"{path} holds another network: its {name} are not what this one computes")
