"""ONNX Runtime sessions whose errors are one clear line."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

METADATA_KEY = "deckline"  # metadata_props key under which an exported model carries its config as JSON


@dataclass(frozen=True, eq=False)
class Session:
    """A loaded model."""

    path: Path
    config: dict[str, Any]  # what made the model; {} for a file that deckline did not export
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]
    session: Any  # onnxruntime.InferenceSession

    def __call__(self, **inputs: NDArray[np.float32]) -> tuple[NDArray, ...]:
        """Run the model on arrays given by input name; outputs in the model's order.

        Raises:
            ValueError: other input names than the model has, or arrays it cannot take.
        """
        from onnxruntime.capi.onnxruntime_pybind11_state import InvalidArgument, RuntimeException

        if set(inputs) != set(self.input_names):
            raise ValueError(f"{self.path.name} takes inputs {self.input_names}, got {tuple(inputs)}")
        try:
            return tuple(self.session.run(None, inputs))
        except (InvalidArgument, RuntimeException) as error:
            shapes = {name: array.shape for name, array in inputs.items()}
            raise ValueError(f"{self.path.name} cannot run on inputs {shapes}: {get_first_line(error)}") from error


def load_session(path: Path | str, threads: int | None = None) -> Session:
    """Open an ONNX file for inference on the CPU.

    Args:
        path: a file exported by `deckline train`, or any other ONNX model.
        threads: of ONNX Runtime; None lets it take every core.

    Raises:
        ValueError: no such file, a file that is no ONNX model, or fewer than one thread.
    """
    import onnxruntime
    from onnxruntime.capi import onnxruntime_pybind11_state as errors

    path = Path(path)
    if not path.is_file():
        raise ValueError(f"model file {path} does not exist")
    if threads is not None and threads < 1:
        raise ValueError(f"threads must be at least 1, got {threads}")
    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3
    if threads is not None:
        options.intra_op_num_threads = threads
    refused = (errors.Fail, errors.InvalidArgument, errors.InvalidGraph, errors.InvalidProtobuf)
    unsupported = (errors.NotImplemented, errors.RuntimeException)
    try:
        session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except (*refused, *unsupported) as error:
        raise ValueError(f"{path} is not a usable ONNX model: {get_first_line(error)}") from error
    return Session(
        path=path,
        config=_read_config(path, session.get_modelmeta().custom_metadata_map),
        input_names=tuple(value.name for value in session.get_inputs()),
        output_names=tuple(value.name for value in session.get_outputs()),
        session=session,
    )


def get_first_line(error: Exception) -> str:
    """The first line of an error's text: ONNX Runtime appends stacks of nodes."""
    return (str(error).splitlines() or [type(error).__name__])[0]


def _read_config(path: Path, metadata: dict[str, str]) -> dict[str, Any]:
    text = metadata.get(METADATA_KEY, "{}")
    try:
        config = json.loads(text)
    except json.JSONDecodeError as error:
        raise ValueError(f"{path}: metadata {METADATA_KEY!r} is not JSON: {error}") from error
    if not isinstance(config, dict):
        raise ValueError(f"{path}: metadata {METADATA_KEY!r} must be a JSON object, got {type(config).__name__}")
    return config
