"""Inference sessions whose errors are one clear line."""

import json
import re
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deckline.config import CPU, Engine
from deckline.files import parse_plain, print_line, read_regular
from deckline.runtime.engines import (
    PROVIDERS,
    Compute,
    check_engine,
    compile_openvino,
    compute_onnxruntime,
    get_line,
    lacks_vnni,
    open_onnxruntime,
)

# A node's op_type is field 4 of its message: tag, length, text, whose tag and length may be padded varints.
LOOP = re.compile(rb"(?:\x22|\xa2\x80*\x00)(?:\x04|\x84\x80*\x00)Loop")
EIGHT_BITS = b"QuantizeLinear"  # op_type of the nodes around 8-bit integers
METADATA_KEY = "deckline"  # metadata_props key under which an exported model carries its config as JSON


@dataclass(frozen=True, eq=False)
class ModelSession:
    """A loaded model. Several threads may call it at a time."""

    path: Path
    """Of the model's file."""
    config: dict[str, Any]
    """The configuration that made the model; {} for a file that deckline did not export."""
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]
    compute: Compute
    """Arrays by input name -> arrays in the order of `output_names`."""

    def __call__(self, **inputs: NDArray[np.float32]) -> tuple[NDArray, ...]:
        """Run the model on arrays given by input name; outputs in the model's order.

        Raises:
            ValueError: other input names than the model has, or arrays it cannot take.
        """
        from onnxruntime.capi.onnxruntime_pybind11_state import Fail, InvalidArgument, RuntimeException

        if set(inputs) != set(self.input_names):
            raise ValueError(f"{self.path.name} takes inputs {self.input_names}, got {tuple(inputs)}")
        try:
            return tuple(self.compute(inputs))
        except (Fail, InvalidArgument, RuntimeException, RuntimeError) as error:
            shapes = {name: array.shape for name, array in inputs.items()}
            raise ValueError(f"{self.path.name} cannot run on inputs {shapes}: {get_line(error)}") from error


def load_session(path: Path | str, engine: Engine = CPU) -> ModelSession:
    """Open an ONNX file for inference.

    Args:
        path: a file exported by `deckline train`, or any other ONNX model.

    Raises:
        ValueError: no such file, a file that is no ONNX model, or an engine that this machine has not.
        ImportError: OpenVINO is not installed.
    """
    path = Path(path)
    if not path.is_file():
        raise ValueError(f"model file {path} does not exist")
    model = read_regular(path)
    if LOOP.search(model):
        raise ValueError(f"{path}: a model with loops, which need not end, is not run; export it unrolled")
    check_engine(engine)
    if EIGHT_BITS in model and engine.device not in PROVIDERS and lacks_vnni():
        print_line(f"note: {path.name} has 8-bit integers, for which this processor lacks VNNI; take --detector hybrid")
    elsewhere = engine.device == "openvino"  # ONNX Runtime then only reads names and metadata
    session = open_onnxruntime(path, CPU if elsewhere else engine, optimised=not elsewhere)
    output_names = tuple(value.name for value in session.get_outputs())
    return ModelSession(
        path=path,
        config=_read_config(path, session.get_modelmeta().custom_metadata_map),
        input_names=tuple(value.name for value in session.get_inputs()),
        output_names=output_names,
        compute=compile_openvino(path, engine, output_names) if elsewhere else partial(compute_onnxruntime, session),
    )


def _read_config(path: Path, metadata: dict[str, str]) -> dict[str, Any]:
    text = metadata.get(METADATA_KEY, "{}")
    try:
        config = parse_plain(json.loads, text)
    except ValueError as error:
        raise ValueError(f"{path}: metadata {METADATA_KEY!r} is not JSON: {error}") from error
    if not isinstance(config, dict):
        raise ValueError(f"{path}: metadata {METADATA_KEY!r} must be a JSON object, got {type(config).__name__}")
    return config
