"""Views to train line detectors on: clear recorded frames with their true lines, or pictures that people labelled.

Recorded frames have depth, so haze is added to them; labelled pictures stay in the haze that they were taken in.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deckline.labels.lines import LABELS_FILE, Labels, read_labels, resample
from deckline.labels.truth import LINE_POINTS, project_line
from deckline.recording import open_recording
from deckline.recording.airsim import RECORD_FILE
from deckline.recording.images import read_image
from deckline.recording.source import FrameError, is_inside
from deckline.train.dehaze_views import ClearView, make_clear_view
from deckline.train.views import Views
from deckline.types import SIDES, Frame, Segment


@dataclass(frozen=True, eq=False)
class LineView:
    """A picture and where its lines are in it."""

    file: str
    image_rgb: NDArray[np.uint8]  # (H, W, 3); without haze where there is a clear view
    lines_px: NDArray[np.float64] | None  # (3, N, 2) left, right, centre in order along each, NaN one that is not there
    clear: ClearView | None = None  # None: labelled by people
    ranges_m: NDArray[np.float64] | None = None  # (3, N) of the lines from the camera
    centre_painted: bool | None = None  # None: not known


def make_line_view(frame: Frame) -> LineView:
    """What training needs of a frame.

    Raises:
        ValueError: no depth, no clear image, or no truth and pose to know the lines from.
    """
    clear = make_clear_view(frame, long_side_px=max(frame.image_rgb.shape))  # at its own size
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
    return LineView(frame.file, clear.clear_rgb, points, clear, ranges, truth.centre_painted)


def load_labelled_view(folder: Path, file: str, labels: Labels) -> LineView:
    """A labelled picture.

    Args:
        folder: of the pictures.
        file: in the folder.
        labels: its lines.

    Raises:
        FrameError: a picture that cannot be read.
    """
    try:
        image = read_image(folder / file)
    except ValueError as error:
        raise FrameError(str(folder / file), str(error)) from None
    lines = np.full((len(SIDES) + 1, LINE_POINTS, 2), np.nan)  # nobody labels the centre line
    for k, side in enumerate(SIDES):
        line = labels[side]
        if line is not None:
            lines[k] = resample(line, LINE_POINTS)
    return LineView(file, image, None if np.isnan(lines).all() else lines)


def is_labelled_folder(path: Path) -> bool:
    """Whether a folder holds pictures with labels.json, and no recording."""
    return (path / LABELS_FILE).is_file() and not (path / RECORD_FILE).exists()


def open_line_views(recordings: list[Path], held_out: float, train: bool = True) -> Views[LineView]:
    """Views of recordings and labelled folders; see `Views`. Pictures that labels.json does not name are left out.

    Args:
        recordings: clear recordings with full depth and true lines, or pictures with labels.json.
        held_out: share of every recording, at its end, that training does not see.
        train: the training part.

    Raises:
        ValueError: no recordings, no views, labels that cannot be read, or a labelled picture that is not there.
    """
    labels = {path: read_labels(path / LABELS_FILE) for path in recordings if is_labelled_folder(path)}
    for path, named in labels.items():
        for file in named:
            if not is_inside(file) or not (path / file).is_file():
                raise ValueError(f"{path / LABELS_FILE}: there is no image {file} in {path}")
    files = {path: list(named) for path, named in labels.items()}
    sources = {path: open_recording(path) for path in recordings if path not in labels}

    def load(path: Path, index: int) -> LineView:
        if path in sources:
            return make_line_view(sources[path].load(index))
        return load_labelled_view(path, files[path][index], labels[path][files[path][index]])

    counts = {path: len(files[path] if path in labels else sources[path]) for path in recordings}
    return Views(counts, recordings, held_out, train, load)
