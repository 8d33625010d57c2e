"""Quantize a shipped or trained line detector to 8-bit integers, for processors without bf16.

    python scripts/quantize.py hybrid.onnx RECORDING... --out hybrid-int8.onnx

The ranges of the activations are measured on views that the search itself makes in hazy recordings. The first
convolution and what follows the backbone stay in single precision: quantizing these gains no time, and the first
costs as much precision as all others together.
"""

import argparse
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import onnx
from numpy.typing import NDArray
from onnxruntime.quantization import CalibrationDataReader, QuantFormat, QuantType, quantize_static
from onnxruntime.quantization.shape_inference import quant_pre_process

from deckline.detect import OnnxDetector
from deckline.detect.crop import normalise, sample_crop
from deckline.recording import open_recording

QUANTIZED = ["Conv", "Add", "Relu", "Clip"]
VIEWS = 3  # of each frame


class Views(CalibrationDataReader):
    """Gives the views (3, height, width) to the calibration, one at a time."""

    def __init__(self, views: Iterator[NDArray[np.float32]]) -> None:
        self._views = views

    def get_next(self) -> dict[str, NDArray[np.float32]] | None:
        view = next(self._views, None)
        return None if view is None else {"image": view[None]}


def draw_views(detector: OnnxDetector, recordings: list[Path], frames: int) -> Iterator[NDArray[np.float32]]:
    """Some views (3, height, width) of the search in frames drawn from all recordings."""
    rng = np.random.default_rng(0)
    places = [(one, index) for one in map(open_recording, recordings) for index in range(len(one))]
    for recording, index in rng.permutation(np.array(places, dtype=object))[:frames]:
        search = detector.start_search(recording.load(index).image_rgb)
        for _ in search.steps():
            pass
        for crop in rng.permutation(np.array(search.crops, dtype=object))[:VIEWS]:
            yield normalise(sample_crop(search.image_rgb, crop, detector.config.grid.size))


def main() -> None:
    parser = argparse.ArgumentParser(description="Quantize a line detector to 8-bit integers.")
    parser.add_argument("model", type=Path, help="the .onnx file of a network hybrid")
    parser.add_argument("recordings", type=Path, nargs="+", help="in which its views are taken, haze included")
    parser.add_argument("--frames", type=int, default=150, help="drawn from all recordings, three views of each")
    parser.add_argument("--out", type=Path, required=True, help="the file to write")
    given = parser.parse_args()
    views = draw_views(OnnxDetector(given.model), given.recordings, given.frames)
    with tempfile.TemporaryDirectory() as folder:
        prepared = Path(folder) / "prepared.onnx"
        quant_pre_process(given.model, prepared, skip_symbolic_shape=True)
        nodes = onnx.load(prepared).graph.node
        if not any("/backbone/" in node.name for node in nodes):
            parser.error(f"{given.model} has no backbone by that name: only networks hybrid are quantized")
        kept = [node.name for node in nodes if "/backbone/" not in node.name]
        quantize_static(
            prepared,
            given.out,
            Views(views),
            quant_format=QuantFormat.QDQ,
            per_channel=True,
            activation_type=QuantType.QUInt8,
            weight_type=QuantType.QInt8,
            op_types_to_quantize=QUANTIZED,
            nodes_to_exclude=[*kept, next(node.name for node in nodes if node.op_type == "Conv")],
        )
    quantized = onnx.load(given.out)
    quantized.metadata_props.extend(onnx.load(given.model).metadata_props)
    onnx.save(quantized, given.out)
    print(f"{given.out}: {given.out.stat().st_size} bytes")


if __name__ == "__main__":
    main()
