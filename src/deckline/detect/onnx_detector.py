"""An exported line network through ONNX Runtime."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deckline.detect.looks import Box, DetectConfig, NetworkOutput, detect_lines
from deckline.detect.outputs import KNOWN_OUTPUTS, ROW_OUTPUTS, network_output
from deckline.detect.row_anchors import DecodeConfig, RowGrid
from deckline.runtime.session import load_session
from deckline.types import Detection

# Networks of row anchors alone are taught with a focal loss: what they say of a row is no probability. With these
# thresholds `ufld` gives a point in 0.45 % of 888 views without a runway, and both lines on 74 % of 174 decks.
ROWS_ALONE = DetectConfig(min_confidence=0.4, min_probability=0.6, min_lone_probability=0.9)


class OnnxDetector:
    """Finds the two runway lines with an exported row-anchor, row-and-column-anchor or line-map network.

    Args:
        path: the .onnx file; its metadata hold the network's row grid, and how it is decoded if not as published.
        config: thresholds and looks, those of the kind of network by default. Its grid, and its decoding where the
            file has its own, are replaced by the file's.

    Raises:
        ValueError: a file that is no such network.
    """

    def __init__(self, path: Path, config: DetectConfig | None = None) -> None:
        self.name = path.stem
        self.session = load_session(path)
        if all(set(self.session.output_names) != set(names) for names in KNOWN_OUTPUTS):
            raise ValueError(
                f"{path}: no row-anchor detector (its outputs are {', '.join(self.session.output_names)}, "
                f"expected {', '.join(ROW_OUTPUTS)})"
            )
        if config is None:
            config = DetectConfig() if "column_logits" in self.session.output_names else ROWS_ALONE
        self.config = replace(
            config, grid=_grid(self.session.config, path), decode=_decode(self.session.config, config.decode, path)
        )

    def __call__(self, image_rgb: NDArray[np.uint8], look_at: Box | None = None) -> Detection:
        return detect_lines(image_rgb, self.infer, self.config, look_at)

    def infer(self, view: NDArray[np.float32]) -> NetworkOutput:
        """One normalised view (3, height, width) through the network."""
        outputs = zip(self.session.output_names, self.session(image=view[None]), strict=True)
        return network_output({name: value[0] for name, value in outputs}, self.config.grid)


def _grid(config: dict[str, Any], path: Path) -> RowGrid:
    try:
        return RowGrid(**config["grid"])
    except (KeyError, TypeError) as error:
        raise ValueError(f"{path}: no row-anchor detector (its metadata have no usable grid: {error})") from error


def _decode(config: dict[str, Any], without: DecodeConfig, path: Path) -> DecodeConfig:
    try:
        return DecodeConfig(**config["decode"]) if "decode" in config else without
    except TypeError as error:
        raise ValueError(f"{path}: its metadata have no usable decoding: {error}") from error
