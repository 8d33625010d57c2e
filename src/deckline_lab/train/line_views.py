"""Views with lines that detectors are trained on: recordings with true lines, and labelled pictures.

Labelled pictures have no depth and stay in the haze that they were taken in.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deckline.recording import FrameError
from deckline.recording.images import read_image
from deckline.recording.source import is_inside
from deckline.types import SIDES, EdgeKind, Frame, Segment
from deckline_lab.labels.lines import LABELS_FILE, read_labels, resample
from deckline_lab.train.clear_views import ClearView, make_clear_view
from deckline_lab.train.view_sets import Part, Views, open_views
from deckline_sim.visible_line import LINE_POINTS, project_line


@dataclass(frozen=True, eq=False)
class LineView:
    """A picture and where its lines are in it."""

    file: str
    image_rgb: NDArray[np.uint8]  # (H, W, 3); without haze where there is a clear view
    lines_px: NDArray[np.float64] | None  # (3, N, 2) left, right, centre in order along each, NaN one that is not there
    clear: ClearView | None = None  # None: labelled by people
    ranges_m: NDArray[np.float64] | None = None  # (3, N) of the lines from the camera
    centre_painted: bool | None = None  # None: not known
    edge: EdgeKind | None = None  # what the edge lines are; None: not known


def make_line_view(frame: Frame) -> LineView:
    """What training needs of a frame; the lines need its true pose."""
    clear = make_clear_view(frame)
    without_lines = LineView(frame.file, clear.clear_rgb, None, clear)
    truth = frame.truth
    if truth is None or truth.left is None or truth.right is None:
        return without_lines
    if frame.true_world_from_camera is None:
        raise ValueError(f"{frame.file}: no pose; true lines cannot be brought into the image")
    ends = [(a + b) / 2 for a, b in ((truth.left.p0_m, truth.right.p0_m), (truth.left.p1_m, truth.right.p1_m))]
    lines = [project_line(frame, segment) for segment in (truth.left, truth.right, Segment(*ends))]
    if any(line is None for line in lines):
        return without_lines  # a line wholly behind the camera
    points, ranges = (np.stack(parts) for parts in zip(*(line for line in lines if line is not None), strict=True))
    edge = EdgeKind(truth.conditions.get("edge", EdgeKind.PAINT))
    return LineView(frame.file, clear.clear_rgb, points, clear, ranges, truth.centre_painted, edge)


def open_line_views(recordings: list[Path], held_out: float, train: bool = True) -> Views[LineView]:
    """Views with lines; see `Views`. Pictures that labels.json does not name are left out."""
    return open_views(recordings, _open_labelled, make_line_view, held_out, train)


def _open_labelled(folder: Path) -> Part[LineView]:
    labels = read_labels(folder / LABELS_FILE)
    for file in labels:
        if not is_inside(file) or not (folder / file).is_file():
            raise ValueError(f"{folder / LABELS_FILE}: there is no image {file} in {folder}")
    files = list(labels)

    def load(index: int) -> LineView:
        file = files[index]
        try:
            image = read_image(folder / file)
        except ValueError as error:
            raise FrameError(str(folder / file), str(error)) from None
        lines = np.full((len(SIDES) + 1, LINE_POINTS, 2), np.nan)  # nobody labels the centre line
        for k, side in enumerate(SIDES):
            line = labels[file][side]
            if line is not None:
                lines[k] = resample(line, LINE_POINTS)
        return LineView(file, image, None if np.isnan(lines).all() else lines)

    return len(files), load
