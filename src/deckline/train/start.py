"""First weights from an earlier training: a folder's checkpoint, or an exported file."""

from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from torch import Tensor, nn

from deckline.runtime import load_session
from deckline.train.checkpoint import CHECKPOINT_FILE


def start_with(model: nn.Module, source: Path) -> None:
    """Give a model an earlier one's averaged weights.

    A convolution that takes more channels than it did starts with zeros for the new ones, so that the model does at
    first what the earlier one did. A file keeps equal tensors once, so it must be that of a trained model.

    Args:
        model: changed in place.
        source: folder with a checkpoint, or an .onnx file made by `deckline train`.

    Raises:
        ValueError: no weights there, or those of another network.
    """
    stored = _from_onnx(source) if source.is_file() else _from_checkpoint(source / CHECKPOINT_FILE)
    own = model.state_dict()
    missing = sorted(own.keys() - stored.keys())
    if missing:
        raise ValueError(f"{source} holds the weights of another network: it has no {missing[0]}")
    model.load_state_dict({name: _fitted(stored[name], own[name], f"{source}: {name}") for name in own})


def _from_onnx(path: Path) -> dict[str, Tensor]:
    import onnx

    load_session(path, threads=1)  # refuses what is no network of deckline
    graph = onnx.load(str(path)).graph
    return {item.name: torch.from_numpy(onnx.numpy_helper.to_array(item).copy()) for item in graph.initializer}


def _from_checkpoint(path: Path) -> dict[str, Tensor]:
    if not path.is_file():
        raise ValueError(f"{path.parent} holds no checkpoint to start from")
    try:
        with safe_open(path, framework="pt") as file:
            names = list(file.keys())
            group = "ema." if any(name.startswith("ema.") for name in names) else "model."
            return {name[len(group) :]: file.get_tensor(name) for name in names if name.startswith(group)}
    except SafetensorError as error:
        raise ValueError(f"{path} is not a deckline checkpoint: {error}") from error


def _fitted(stored: Tensor, own: Tensor, where: str) -> Tensor:
    if stored.shape == own.shape:
        return stored
    if stored.ndim == 4 and own.ndim == 4 and stored.shape[1] < own.shape[1]:
        grown = torch.zeros_like(own, device="cpu")
        if grown[:, : stored.shape[1]].shape == stored.shape:
            grown[:, : stored.shape[1]] = stored
            return grown
    raise ValueError(f"{where} has shape {tuple(stored.shape)}, expected {tuple(own.shape)}")
