"""The row-anchor network through ONNX Runtime."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deckline.detect.looks import DetectConfig, NetworkOutput, detect_lines
from deckline.detect.row_anchors import RowGrid
from deckline.runtime.session import load_session
from deckline.types import Detection

OUTPUT_NAMES = ("row_logits", "region_logits", "region_box")


class OnnxDetector:
    """Finds the two runway lines with an exported row-anchor network.

    Args:
        path: the .onnx file; its metadata hold the network's row grid.
        config: thresholds and looks; its grid is replaced by the file's.

    Raises:
        ValueError: a file that is no such network.
    """

    def __init__(self, path: Path, config: DetectConfig | None = None) -> None:
        self.name = path.stem
        self._session = load_session(path)
        if set(self._session.output_names) != set(OUTPUT_NAMES):
            raise ValueError(
                f"{path}: no row-anchor detector (its outputs are {', '.join(self._session.output_names)}, "
                f"expected {', '.join(OUTPUT_NAMES)})"
            )
        self.config = replace(config or DetectConfig(), grid=_grid(self._session.config, path))

    def __call__(self, image_rgb: NDArray[np.uint8]) -> Detection:
        return detect_lines(image_rgb, self.infer, self.config)

    def infer(self, view: NDArray[np.float32]) -> NetworkOutput:
        """One normalised view (3, height, width) through the network."""
        outputs = dict(zip(self._session.output_names, self._session(image=view[None]), strict=True))
        rows, region, box = (outputs[name][0] for name in OUTPUT_NAMES)
        return NetworkOutput(rows, region, box)


def _grid(config: dict[str, Any], path: Path) -> RowGrid:
    try:
        return RowGrid(**config["grid"])
    except (KeyError, TypeError) as error:
        raise ValueError(f"{path}: no row-anchor detector (its metadata have no usable grid: {error})") from error
