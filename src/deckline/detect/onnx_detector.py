"""An exported line network on images of any size."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deckline.config import CPU, Engine
from deckline.detect.anchors import KNOWN_OUTPUTS, ROW_OUTPUTS, DecodeConfig, NetworkOutput, RowGrid, network_output
from deckline.detect.coarse_to_fine import DetectConfig
from deckline.detect.crop import Box
from deckline.detect.scheduler import SearchingDetector
from deckline.detect.search import Search, detect_lines
from deckline.runtime.session import load_session
from deckline.types import Detection

# Networks of row anchors alone are trained with a focal loss, so that their confidences are no probabilities. With
# these thresholds `ufld` gives a point in 0.45 % of 888 views without a runway, and both lines on 74 % of 174 decks.
ROWS_ALONE = DetectConfig(
    min_confidence=0.4,
    min_probability=0.6,
    min_lone_probability=0.9,
    min_close_probability=1.1,
    min_ahead_probability=1.1,
    min_ahead_alone_probability=1.1,
    places=1,
    tilings=(),
)


class OnnxDetector(SearchingDetector):
    """Finds the two runway lines with an exported row-anchor, row-and-column-anchor or line-map network.

    Args:
        path: the .onnx file; its metadata hold the network's row grid and, unless they are the defaults, how its rows
            are decoded and how it searches. A file that does not say how it searches has the defaults of its kind.
        config: thresholds and crops in place of the file's; its grid and decoding are the file's.
        engine: what computes the network.
        compare: also take a network whose search refuses no line, as published ones do; no aircraft should follow it.

    Raises:
        ValueError: a file that is no such network, or an engine that is not there.
    """

    def __init__(
        self, path: Path, config: DetectConfig | None = None, engine: Engine = CPU, compare: bool = False
    ) -> None:
        self.name = path.stem
        self.session = load_session(path, engine)
        outputs, stored = self.session.output_names, self.session.config
        if all(set(outputs) != set(names) for names in KNOWN_OUTPUTS):
            expected = ", ".join(ROW_OUTPUTS)
            raise ValueError(f"{path}: no row-anchor detector (its outputs are {', '.join(outputs)}, not {expected})")
        try:
            grid, decode = RowGrid(**stored["grid"]), DecodeConfig(**stored.get("decode", {}))
            of_kind = DetectConfig() if "column_logits" in outputs else ROWS_ALONE
            search = config or (DetectConfig(**stored["search"]) if "search" in stored else of_kind)
            self.config = replace(search, grid=grid, decode=decode)
        except (KeyError, TypeError) as error:
            raise ValueError(f"{path}: its metadata have no usable grid, decoding or search: {error}") from error
        if self.config.min_probability <= 0 and not compare:
            raise ValueError(
                f"{path}: a network to compare with, which refuses no line: fly it in `deckline eval` alone"
            )

    def __call__(self, image_rgb: NDArray[np.uint8], prior_box: Box | None = None) -> Detection:
        return detect_lines(image_rgb, self.infer, self.config, prior_box)

    def start_search(self, image_rgb: NDArray[np.uint8]) -> Search:
        """A search of an image (H, W, 3), without an inference so far."""
        return Search(image_rgb, self.infer, self.config)

    def infer(self, view: NDArray[np.float32]) -> NetworkOutput:
        """One inference of a normalised crop (3, height, width)."""
        outputs = zip(self.session.output_names, self.session(image=view[None]), strict=True)
        return network_output({name: value[0] for name, value in outputs}, self.config.grid)
