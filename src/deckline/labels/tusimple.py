"""TuSimple: a JSON object a line, {"raw_file", "h_samples": rows v, "lanes": [[u of every row, -2: none], ...]}.

Lanes are not named. Two entries of which one is all -2 are left and right in this order; of two lines in the image the
one further left is the left one.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from deckline.atomic import write_atomic
from deckline.labels.lines import (
    LabelledImage,
    LabelSet,
    Line,
    at_rows,
    finite,
    left_and_right,
    parsed,
    read_text,
    sized,
)

ABSENT = -2  # u of a row that a lane does not reach
DECIMALS = 2  # of u, px
USUAL_NAME = "label_data*.json"  # in a data set's folder


def write_tusimple(path: Path, images: Sequence[LabelledImage], row_step_px: int = 1) -> None:
    """Write labels; a line is kept where it crosses rows 0, row_step_px, ... of the image.

    Raises:
        ValueError: an image of unknown size.
        OSError: the disk refuses.
    """
    text = "".join(json.dumps(_entry(image, row_step_px)) + "\n" for image in images)
    write_atomic(path, text.encode())


def _entry(image: LabelledImage, row_step_px: int) -> dict[str, Any]:
    width, height = sized(image)
    rows = np.arange(0, height, row_step_px)
    lanes = []
    for line in image.lines.values():
        u = np.full(len(rows), np.nan) if line is None else at_rows(line, rows)
        kept = (u >= 0) & (u <= width - 1)
        if kept.sum() < 2:
            kept[:] = False
        lanes.append([round(float(value), DECIMALS) if keep else ABSENT for value, keep in zip(u, kept, strict=True)])
    return {"lanes": lanes, "h_samples": rows.tolist(), "raw_file": image.file}


def read_tusimple(path: Path) -> LabelSet:
    """Read a label file, or every label_data*.json of a folder.

    Raises:
        ValueError: no labels, or a line that is none; one line that names file, line and what is wrong.
    """
    files = sorted(path.glob(USUAL_NAME)) if path.is_dir() else [path]
    if not files:
        raise ValueError(f"{path}: no {USUAL_NAME} in this folder; name the label file itself")
    images = []
    for file in files:
        for number, text in enumerate(read_text(file).splitlines(), 1):
            if text.strip():
                images.append(_image(text, f"{file}: line {number}"))
    if not images:
        raise ValueError(f"{files[0]}: no labels in it; expected one JSON object a line")
    return LabelSet(files[0].parent, tuple(images))


def _image(text: str, where: str) -> LabelledImage:
    values = parsed(text, where)
    if not isinstance(values, dict) or not isinstance(values.get("raw_file"), str):
        raise ValueError(f'{where}: expected {{"raw_file", "h_samples", "lanes"}}, the first a file name')
    rows, lanes = values.get("h_samples"), values.get("lanes")
    if not isinstance(lanes, list) or not isinstance(rows, list):
        raise ValueError(f"{where}: h_samples and lanes must be lists")
    lines = [_line(lane, rows, f"{where}: lanes[{index}]") for index, lane in enumerate(lanes)]
    present = [line for line in lines if line is not None]
    if len(lines) == 2 and len(present) < 2:
        return LabelledImage(values["raw_file"], lines[0], lines[1])
    return LabelledImage(values["raw_file"], *left_and_right(present, where))


def _line(lane: Any, rows: list[Any], where: str) -> Line | None:
    if not isinstance(lane, list) or len(lane) != len(rows):
        raise ValueError(f"{where} must hold one u for each of the {len(rows)} h_samples")
    try:
        line = np.array([lane, rows], dtype=np.float64).T
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{where} and h_samples must be numbers") from None
    if not finite(line):
        raise ValueError(f"{where} and h_samples must be finite numbers")
    line = line.reshape(-1, 2)[line.reshape(-1, 2)[:, 0] >= 0]
    if len(line) == 1:
        raise ValueError(f"{where} has one point; a line needs two (or -2 everywhere for none)")
    return line if len(line) else None
