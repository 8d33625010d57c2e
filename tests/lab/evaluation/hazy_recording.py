"""A tiny recording with clear pictures, a command to measure it with, and a network to dehaze it."""

import json
from pathlib import Path

import numpy as np
import onnx

from deckline.cli.main import main
from deckline.geometry import Camera, pose
from deckline.haze import add_haze, beta_from_visibility
from deckline.recording import RecordingWriter
from deckline.runtime.session import METADATA_KEY
from deckline.types import Frame, Truth

CAMERA = Camera.from_fov(64, 48, np.pi / 3)
VISIBILITY_M = (250.0, 250.0, 800.0, 5000.0)
HORIZON_ROW = 16


def pictures(index: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Clear and hazy picture, and depth: NaN in the sky, ever nearer below it."""
    clear = np.random.default_rng(index).integers(20, 150, (48, 64, 3)).astype(np.uint8)
    depth = np.full((48, 64), np.nan, np.float32)
    depth[HORIZON_ROW:] = (4000.0 / np.arange(1, 48 - HORIZON_ROW + 1))[:, None]
    hazy = add_haze(clear, depth, beta_from_visibility(VISIBILITY_M[index]), (200.0, 205.0, 210.0))
    return clear, hazy, depth


def write_recording(folder: Path, clear_too: bool = True) -> Path:
    with RecordingWriter(folder) as writer:
        for index, visibility_m in enumerate(VISIBILITY_M):
            clear, hazy, depth = pictures(index)
            truth = Truth(visibility_m=visibility_m, clear_rgb=clear if clear_too else None)
            at = pose([-500.0, 0.0, -40.0], [1, 0, 0, 0])
            writer.add(
                Frame(
                    "x.png", float(index), hazy, CAMERA, depth_m=depth, world_from_body=at, deck_z_m=-20.0, truth=truth
                )
            )
    return folder


def write_network(path: Path) -> Path:
    """A network without a coarse grid whose output is its input, with a working size of 32 px."""
    sizes = [1, 3, "height", "width"]
    values = [onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, sizes) for name in ("image", "clear")]
    graph = onnx.helper.make_graph(
        [onnx.helper.make_node("Identity", ["image"], ["clear"])], "g", values[:1], values[1:]
    )
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 18)], ir_version=8)
    config = {"kind": "dehaze", "network": {"unshuffle": 1}, "working_long_side_px": 32}
    entry = model.metadata_props.add()
    entry.key, entry.value = METADATA_KEY, json.dumps(config | {"parameters": 484_000, "macs_256": 2_600_000_000})
    path.parent.mkdir()
    onnx.save(model, path)
    return path


def run(*args: object) -> int:
    return main(["eval", "dehazing", *map(str, args)])


def measured(path: Path, *args: object) -> dict:
    assert run(*args, "--json", path) == 0
    return json.loads(path.read_text())
