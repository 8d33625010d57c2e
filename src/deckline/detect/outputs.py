"""What the networks' outputs are called and mean: one place for export, evaluation and runtime."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from deckline.detect.line_map import rows_from_map
from deckline.detect.looks import NetworkOutput
from deckline.detect.row_anchors import RowGrid

ROW_OUTPUTS = ("row_logits", "region_logits", "region_box")  # row anchors
HYBRID_OUTPUTS = ("row_logits", "column_logits", "region_logits", "region_box")  # row and column anchors
MAP_OUTPUTS = ("map_logits", "line_logits", "region_logits", "region_box")  # a class for every pixel
KNOWN_OUTPUTS = (ROW_OUTPUTS, HYBRID_OUTPUTS, MAP_OUTPUTS)


def network_output(outputs: Mapping[str, NDArray[np.float32]], grid: RowGrid) -> NetworkOutput:
    """A network's outputs for one view, by name and without the batch axis -> what the looks decode."""
    if "map_logits" in outputs:
        rows = rows_from_map(outputs["map_logits"], outputs["line_logits"], grid)
    else:
        rows = outputs["row_logits"]
    return NetworkOutput(rows, outputs["region_logits"], outputs["region_box"], outputs.get("column_logits"))
