"""Labels from a frame's truth."""

import numpy as np
from numpy.typing import NDArray

from deckline.types import Frame
from deckline_lab.labels.lines import LabelledImage
from deckline_sim.visible_line import find_visible_line

SHORTEST_PX = 2.0  # a line that is shorter in the image is not labelled


def label_frame(frame: Frame, file: str) -> LabelledImage:
    """The true lines in the image, up to the visibility; a ValueError for lines without a pose, or no truth."""
    truth = frame.truth
    if truth is None:
        raise ValueError(f"{frame.file}: no truth to label it from (a recording's scene.json holds it)")
    lines: list[NDArray[np.float64] | None] = []
    for segment in (truth.left, truth.right):
        if segment is not None and frame.true_world_from_camera is None:
            raise ValueError(f"{frame.file}: no pose; true lines cannot be brought into the image")
        seen = None if segment is None else find_visible_line(frame, segment)
        lines.append(None if seen is None or seen.length_px < SHORTEST_PX else seen.points_px)
    left, right = lines
    return LabelledImage(file, left, right, (frame.camera.width, frame.camera.height))
