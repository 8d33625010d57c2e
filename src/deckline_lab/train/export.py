"""ONNX export with the config that made the model inside the file; what a network costs."""

import copy
import json
import warnings
from pathlib import Path
from typing import Any, NamedTuple

import torch
from torch import nn
from torch.utils.flop_counter import FlopCounterMode

from deckline.runtime.session import METADATA_KEY
from deckline.runtime.weights import sha256_of

OPSET = 18
REFERENCE_PX = (256, 256)  # height and width at which dehazing papers publish MACs


def export_onnx(
    model: nn.Module,
    args: tuple[torch.Tensor, ...],
    path: Path,
    input_names: list[str],
    output_names: list[str],
    dynamic: dict[str, dict[int, str]] | None,
    metadata: dict[str, Any],
) -> Path:
    """Write `model` as ONNX; it is put into evaluation mode for that, and back afterwards.

    Args:
        args: example inputs; sizes that `dynamic` does not name are fixed to theirs.
        dynamic: free axes, {input or output name: {axis: name}}; None for a fixed size.
        metadata: stored as JSON; `load_session` returns it as `.config`.
    """
    import onnx

    was_training = model.training
    model.eval()
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(path.name + ".part")
    with torch.no_grad(), warnings.catch_warnings():
        # The tracing exporter warns that it is the older one and that it traces numbers; a test compares outputs.
        warnings.simplefilter("ignore")
        torch.onnx.export(
            model,
            args,
            str(partial),
            input_names=input_names,
            output_names=output_names,
            dynamic_axes=dynamic or {},
            opset_version=OPSET,
            dynamo=False,
        )
    model.train(was_training)
    proto = onnx.load(str(partial))
    for node in proto.graph.node:  # ONNX Runtime fuses no Pad with an empty last input, and loses a third of its time
        while node.input and not node.input[-1]:
            node.input.pop()
    proto.metadata_props.add(key=METADATA_KEY, value=json.dumps(metadata))
    onnx.checker.check_model(proto)
    onnx.save(proto, str(partial))
    partial.replace(path)
    return path


def manifest_entry(path: Path, **keys: Any) -> str:
    """A [[model]] block for weights/manifest.toml; keys are ShippedModel's, `figures` a flat dict."""
    figures = keys.pop("figures", {})
    values = {"file": path.name, "sha256": sha256_of(path)} | keys
    lines = ["[[model]]", *(f"{name} = {_toml(value)}" for name, value in values.items())]
    lines += ["[model.figures]", *(f"{_toml(name)} = {_toml(value)}" for name, value in figures.items())]
    return "\n".join(lines) + "\n"


def _toml(value: str | int | float) -> str:
    return json.dumps(value, ensure_ascii=False)  # JSON strings and finite numbers are valid TOML


class NetworkCost(NamedTuple):
    """Cost of one image."""

    parameters: int
    macs: int  # multiply-accumulates of convolutions, linear layers and matrix products


def count_parameters(model: nn.Module) -> int:
    return sum(value.numel() for value in model.parameters())


def network_cost(
    model: nn.Module, size_px: tuple[int, int] = REFERENCE_PX, channels: tuple[int, ...] = (3,)
) -> NetworkCost:
    """Parameters and MACs of a network that takes images (1, C, H, W) of one size.

    A multiplication with its addition is one MAC. Biases, norms, activations, pooling, softmax and interpolation are
    not counted, as in the papers; attention's two products are. A transposed convolution is charged its weights once an
    input pixel, which is what it computes; some published counts charge them once an output pixel, stride^2 times as
    much. Nothing is computed: the shapes alone go through a copy without data.

    Args:
        size_px: height and width of the images.
        channels: C of each of them.
    """
    shapes = copy.deepcopy(model).to("meta").eval()
    with torch.no_grad(), FlopCounterMode(display=False) as counter:
        shapes(*(torch.empty(1, count, *size_px, device="meta") for count in channels))
    return NetworkCost(count_parameters(model), counter.get_total_flops() // 2)
