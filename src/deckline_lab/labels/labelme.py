"""labelme's label files: beside every image a .json with its shapes.

A line is a shape of type line or linestrip whose label holds the word left or right; shapes of other labels are left
out. A file without shapes is an image without a runway. Points count from the image's outer corner.
Source: labelme's own files, {"shapes": [{"label", "points": [[u, v], ...], "shape_type"}], "imagePath", "imageWidth",
"imageHeight", "imageData"}, https://github.com/wkentaro/labelme
"""

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from deckline.atomic import write_atomic
from deckline.recording.source import read_text
from deckline.types import SIDES
from deckline_lab.labels.lines import (
    DECIMALS,
    LabelledImage,
    Labels,
    LabelSet,
    find_side,
    get_text,
    iterate_objects,
    parse_object,
    parse_points,
    resample,
)

LINE_TYPES = ("line", "linestrip")
VERSION = "5.5.0"  # of labelme, whose form is written


def read_labelme(path: Path) -> LabelSet:
    """Read a file, or all of a folder and those below it; a ValueError names file, shape and what is wrong."""
    files = sorted(path.rglob("*.json")) if path.is_dir() else [path]
    if not files:
        raise ValueError(f"{path}: no .json files in this folder")
    root = path if path.is_dir() else path.parent
    return root, [_read_file(root, file) for file in files]


def _read_file(root: Path, file: Path) -> LabelledImage:
    where = str(file)
    values = parse_object(read_text(file), where, "shapes", "imagePath")
    name = file.parent.relative_to(root) / get_text(values, "imagePath", where).replace("\\", "/")
    lines: Labels = dict.fromkeys(SIDES)
    ignored = []
    for place, shape in iterate_objects(values["shapes"], f"{where}: shapes"):
        label = get_text(shape, "label", place)
        side = find_side(label, place)
        if side is None:
            ignored.append(label)
            continue
        if lines[side] is not None:
            raise ValueError(f"{place}: {label} is a second {side} line; remove one")
        if shape.get("shape_type") not in LINE_TYPES:
            raise ValueError(f"{place}: {label} must be a {' or '.join(LINE_TYPES)}, got {shape.get('shape_type')!r}")
        lines[side] = parse_points(shape.get("points"), f"{place}: {label}") - 0.5
    if ignored and not any(line is not None for line in lines.values()):
        raise ValueError(f"{where}: expected a label with {' or '.join(SIDES)}, got {', '.join(ignored)}")
    return LabelledImage(Path(os.path.normpath(name)).as_posix(), lines["left"], lines["right"], ignored=tuple(ignored))


def write_labelme(out: Path, images: Sequence[LabelledImage], line_points: int = 9) -> None:
    """Write a .json beside each image below `out`, `line_points` points evenly spaced along each line."""
    for image in images:
        file, (width, height) = out / image.file, image.size
        lines = {side: line for side, line in image.lines.items() if line is not None}
        shapes = {side: (resample(line, line_points) + 0.5).round(DECIMALS).tolist() for side, line in lines.items()}
        values: dict[str, Any] = {
            "version": VERSION,
            "flags": {},
            "shapes": [
                {"label": side, "points": points, "group_id": None, "shape_type": "linestrip", "flags": {}}
                for side, points in shapes.items()
            ],
            "imagePath": file.name,
            "imageData": None,
            "imageHeight": height,
            "imageWidth": width,
        }
        write_atomic(file.with_suffix(".json"), (json.dumps(values, indent=1) + "\n").encode())
