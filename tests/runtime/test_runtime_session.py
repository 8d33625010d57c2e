"""Inference sessions: results, config in the metadata, and errors of one line."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
from onnx import TensorProto, helper

from deckline.config import Engine
from deckline.runtime import describe_engines, engines, shipped_weights
from deckline.runtime.session import METADATA_KEY, load_session


def save(graph: onnx.GraphProto, path: Path, metadata: dict[str, str] = {}) -> Path:  # noqa: B006 - only read
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    helper.set_model_props(model, metadata)
    path.write_bytes(model.SerializeToString())
    return path


def doubling_model(path: Path, metadata: str | None = None) -> Path:
    """y = x + x for x of shape (1, N)."""
    value = [helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, "n"]) for name in ("x", "y")]
    graph = helper.make_graph([helper.make_node("Add", ["x", "x"], ["y"])], "double", value[:1], value[1:])
    return save(graph, path, {} if metadata is None else {METADATA_KEY: metadata})


@contextmanager
def refused(*named: object, kind: type[Exception] = ValueError) -> Iterator[None]:
    """An error of one line that contains what is wrong: names and values."""
    with pytest.raises(kind) as caught:
        yield
    text = str(caught.value)
    assert "\n" not in text
    assert [each for each in map(str, named) if each not in text] == []


@pytest.fixture
def double(tmp_path: Path) -> Path:
    return doubling_model(tmp_path / "double.onnx")


def test_runs_and_reads_its_config(tmp_path: Path) -> None:
    path = doubling_model(tmp_path / "double.onnx", json.dumps({"kind": "double", "n": [1, 2]}))
    session = load_session(path, Engine(threads=1))
    (result,) = session(x=np.array([[1.5, -2.0]], dtype=np.float32))
    np.testing.assert_array_equal(result, [[3.0, -4.0]])
    assert session.config == {"kind": "double", "n": [1, 2]}
    assert (session.input_names, session.output_names) == (("x",), ("y",))


@pytest.mark.parametrize("content", [None, b"", b"GIF89a no network at all", b"\x08\x07\x12\x04"])
def test_no_onnx_file(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "other.onnx"
    if content is not None:
        path.write_bytes(content)
    with refused(path):
        load_session(path)


@pytest.mark.parametrize("metadata", ["[1]", "{", "1" * 400, "[" * 1000 + "]" * 1000])
def test_metadata_that_are_no_json_object_are_refused(tmp_path: Path, metadata: str) -> None:
    path = doubling_model(tmp_path / "double.onnx", metadata)
    with refused(path, METADATA_KEY):
        load_session(path)


def hostile_model(path: Path, kind: str) -> Path:
    """A model that never ends, that takes a terabyte, or whose weights lie outside of its folder."""
    value = [helper.make_tensor_value_info(name, TensorProto.FLOAT, None) for name in ("x", "y")]
    flag = helper.make_tensor_value_info("go", TensorProto.BOOL, [])
    count = helper.make_tensor_value_info("i", TensorProto.INT64, [])
    same = [helper.make_node("Identity", ["go"], ["on"])]
    body = helper.make_graph(same, "b", [count, flag], [helper.make_tensor_value_info("on", TensorProto.BOOL, [])])
    weights = helper.make_tensor("w", TensorProto.INT64, [1], [2**38])
    nodes = [helper.make_node("ConstantOfShape", ["w"], ["z"]), helper.make_node("Add", ["x", "z"], ["y"])]
    if kind == "loop":
        weights = helper.make_tensor("w", TensorProto.BOOL, [], [True])
        nodes = [helper.make_node("Loop", ["", "w"], [], body=body), helper.make_node("Add", ["x", "x"], ["y"])]
    if kind == "outside":
        weights = TensorProto(name="w", data_type=TensorProto.FLOAT, data_location=TensorProto.EXTERNAL, dims=[4])
        weights.external_data.add(key="location", value="../secret")
        nodes = [helper.make_node("Add", ["x", "w"], ["y"])]
    graph = helper.make_graph(nodes, kind, value[:1], value[1:], [weights])
    path.parent.mkdir()
    (path.parent.parent / "secret").write_bytes(bytes(16))
    return save(graph, path)


# By the word that distinguishes the cause; the last two are ONNX Runtime's.
@pytest.mark.parametrize(("kind", "cause"), [("loop", "loops"), ("outside", "External data"), ("memory", "memory")])
def test_hostile_models_are_one_line(tmp_path: Path, kind: str, cause: str) -> None:
    path = hostile_model(tmp_path / "m" / "m.onnx", kind)
    with refused(path.name, cause):
        load_session(path)(x=np.zeros(1, np.float32))


def big_model(path: Path, side: int, products: int) -> Path:
    """A small file that multiplies a matrix made of one number with itself, over and over."""
    size = helper.make_tensor("size", TensorProto.INT64, [2], [side, side])
    nodes = [helper.make_node("Expand", ["x", "size"], ["y0"])]
    nodes += [helper.make_node("MatMul", [f"y{k}", f"y{k}"], [f"y{k + 1}"]) for k in range(products)]
    nodes.append(helper.make_node("ReduceSum", [f"y{products}"], ["y"]))
    value = [helper.make_tensor_value_info(name, TensorProto.FLOAT, None) for name in ("x", "y")]
    return save(helper.make_graph(nodes, "big", value[:1], value[1:], [size]), path)


def test_a_model_that_takes_forever_is_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    session = load_session(big_model(tmp_path / "slow.onnx", 2000, 60), Engine(threads=1))
    monkeypatch.setattr(engines, "LONGEST_S", 0.3)
    with refused("slow.onnx", "0.3 s"):
        session(x=np.zeros(1, np.float32))


def test_a_model_gets_no_more_memory_than_there_may_be(tmp_path: Path) -> None:
    side = int((engines.MOST_BYTES / 4) ** 0.5) + 1000
    with refused("large.onnx", "memory"):
        load_session(big_model(tmp_path / "large.onnx", side, 0))(x=np.zeros(1, np.float32))


@pytest.mark.parametrize("device", ["cpu", "openvino"])
def test_wrong_inputs_are_named(double: Path, device: str) -> None:
    pytest.importorskip("onnxruntime" if device == "cpu" else device)
    session = load_session(double, Engine(device))
    assert session.config == {}
    with refused(double.name, ("x",), ("image",)):
        session(image=np.zeros((1, 2), dtype=np.float32))
    with refused(double.name, {"x": (3, 2, 1)}):
        session(x=np.zeros((3, 2, 1), dtype=np.float32))


def test_an_engine_that_is_not_there_is_refused(double: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: [engines.PROCESSOR])
    for device, provider in engines.PROVIDERS.items():
        with refused(device, provider, engines.PACKAGES[device]):
            load_session(double, Engine(device))
    monkeypatch.setitem(sys.modules, "openvino", None)
    monkeypatch.setattr(engines, "_openvino_core", engines._openvino_core.__wrapped__)
    with refused("deckline[openvino]", kind=ImportError):
        load_session(double, Engine("openvino"))
    assert describe_engines()["cpu"] == "f32" and "install" in describe_engines()["openvino"]


@pytest.mark.parametrize(
    ("model", "processor", "is_noted"),
    [
        ("hybrid-int8", "flags : sse2 avx2", True),
        ("hybrid-int8", "flags : sse2 avx2 avx_vnni", False),
        ("hybrid-int8", "Features : asimd", False),
        ("hybrid", "flags : sse2 avx2", False),
    ],
)
def test_8_bits_without_their_instructions_are_noted(model, processor, is_noted, tmp_path, monkeypatch, capsys):
    (tmp_path / "cpuinfo").write_text(processor)
    monkeypatch.setattr(engines, "CPUINFO", tmp_path / "cpuinfo")
    load_session(shipped_weights(model))
    assert ("VNNI" in capsys.readouterr().err) == is_noted


@pytest.mark.parametrize(
    ("values", "named"),
    [(("cpu", 0), ("threads", 0)), (("gpu",), ("device", "gpu")), (("cpu", 1, "bf16"), ("precision", "bf16", "cpu"))],
)
def test_an_engine_out_of_range_is_refused(values: tuple, named: tuple) -> None:
    with refused(*named):
        Engine(*values)


def test_openvino_gives_the_same_in_f32() -> None:
    pytest.importorskip("openvino")
    path, view = shipped_weights("hybrid"), np.random.default_rng(0).normal(size=(1, 3, 288, 512)).astype(np.float32)
    sessions = [load_session(path, engine) for engine in (Engine(threads=1), Engine("openvino", 1))]
    assert sessions[0].config == sessions[1].config != {}
    for expected, outputs in zip(*(session(image=view) for session in sessions), strict=True):
        np.testing.assert_allclose(outputs, expected, atol=1e-3 * np.abs(expected).max())


def test_openvino_refuses_a_precision_that_the_processor_has_not(monkeypatch: pytest.MonkeyPatch) -> None:
    openvino = pytest.importorskip("openvino")
    monkeypatch.setattr(openvino.Core, "get_property", lambda *_: ["FP32"])
    with refused("engine.precision", "bf16"):
        load_session(shipped_weights("hybrid"), Engine("openvino", 1, "bf16"))


def test_signals_are_heard_after_networks_of_openvino_are_gone() -> None:
    """Two Cores that go in the order in which they came leave the process a signal stack that is gone."""
    pytest.importorskip("openvino")
    code = """
import os, signal
from deckline.config import Engine
from deckline.runtime import load_session, shipped_weights
first, second = (load_session(shipped_weights("hybrid"), Engine("openvino", 1)) for _ in range(2))
del first, second
signal.signal(signal.SIGUSR1, lambda *_: print("heard"))
os.kill(os.getpid(), signal.SIGUSR1)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "heard\n")


@pytest.mark.parametrize("device", ["cpu", "openvino"])
def test_no_engine_leaves_telemetry_in_the_home_folder(tmp_path: Path, double: Path, device: str) -> None:
    """Both write an identifier there before they send anything."""
    pytest.importorskip("onnxruntime" if device == "cpu" else device)
    home = tmp_path / "home"
    home.mkdir()
    code = "from deckline.config import Engine; from deckline.runtime import load_session as load\n"
    code += f"load({str(double)!r}, Engine({device!r}, 1))"
    off = ("ORT_DISABLE_TELEMETRY", "CI", "XDG_CACHE_HOME")  # what would hide it
    clean = {name: value for name, value in os.environ.items() if name not in off} | {"HOME": str(home)}
    subprocess.run([sys.executable, "-c", code], env=clean, check=True)
    assert not list(home.iterdir())


@pytest.mark.parametrize(("share", "cores"), [("max 100000", 8), ("150000 100000", 2), ("1000 100000", 1), ("9 1", 8)])
def test_usable_cores_are_those_of_affinity_and_control_group(tmp_path, monkeypatch, share, cores):
    path = tmp_path / "cpu.max"
    path.write_text(share + "\n")
    monkeypatch.setattr(engines, "CPU_SHARE", path)
    monkeypatch.setattr(engines.os, "sched_getaffinity", lambda pid: set(range(8)), raising=False)
    assert engines.usable_cores() == cores
    monkeypatch.setattr(engines, "CPU_SHARE", tmp_path / "none")
    assert engines.usable_cores() == 8
