"""Inference sessions: results, config in the metadata, and errors of one line."""

import json
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from deckline.runtime.session import METADATA_KEY, load_session


def doubling_model(path: Path, metadata: str | None = None) -> Path:
    """y = x + x for x of shape (1, N)."""
    value = [helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, "n"]) for name in ("x", "y")]
    graph = helper.make_graph([helper.make_node("Add", ["x", "x"], ["y"])], "double", value[:1], value[1:])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    if metadata is not None:
        entry = model.metadata_props.add()
        entry.key, entry.value = METADATA_KEY, metadata
    onnx.save(model, str(path))
    return path


def test_runs_and_reads_its_config(tmp_path: Path) -> None:
    session = load_session(doubling_model(tmp_path / "double.onnx", json.dumps({"kind": "double", "n": [1, 2]})), 1)
    (result,) = session(x=np.array([[1.5, -2.0]], dtype=np.float32))
    np.testing.assert_array_equal(result, [[3.0, -4.0]])
    assert session.config == {"kind": "double", "n": [1, 2]}
    assert (session.input_names, session.output_names) == (("x",), ("y",))


def test_foreign_model_has_no_config(tmp_path: Path) -> None:
    assert load_session(doubling_model(tmp_path / "double.onnx")).config == {}


@pytest.mark.parametrize("content", [b"", b"GIF89a no network at all", b"\x08\x07\x12\x04"])
def test_no_onnx_file(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "other.onnx"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"other\.onnx") as caught:
        load_session(path)
    assert "\n" not in str(caught.value)


def test_missing_file_and_bad_arguments(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="does not exist"):
        load_session(tmp_path / "none.onnx")
    path = doubling_model(tmp_path / "double.onnx", "[1]")
    with pytest.raises(ValueError, match=r"threads.*0"):
        load_session(path, threads=0)
    with pytest.raises(ValueError, match=r"deckline.*list"):
        load_session(path)
    with pytest.raises(ValueError, match="JSON"):
        load_session(doubling_model(tmp_path / "double.onnx", "{"))


def test_wrong_inputs_are_named(tmp_path: Path) -> None:
    session = load_session(doubling_model(tmp_path / "double.onnx"))
    with pytest.raises(ValueError, match=r"\('x',\).*\('image',\)"):
        session(image=np.zeros((1, 2), dtype=np.float32))
    with pytest.raises(ValueError, match=r"\{'x': \(3, 2, 1\)\}"):
        session(x=np.zeros((3, 2, 1), dtype=np.float32))
