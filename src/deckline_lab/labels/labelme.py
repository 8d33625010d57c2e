"""labelme's label files: beside every image a .json with its shapes.

A line is a shape of type line or linestrip whose label begins with left or right; shapes of other labels are left
alone. A file without shapes is an image without a runway. Points count from the image's outer corner.
Source: labelme's own files, {"shapes": [{"label", "points": [[u, v], ...], "shape_type"}], "imagePath", "imageWidth",
"imageHeight", "imageData"}, https://github.com/wkentaro/labelme
"""

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from deckline.atomic import write_atomic
from deckline.recording.source import parse_json, read_text
from deckline.types import SIDES
from deckline_lab.labels.lines import (
    DECIMALS,
    LabelledImage,
    Labels,
    LabelSet,
    get_text,
    iterate_objects,
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
    values = parse_json(read_text(file), where)
    if not isinstance(values, dict) or "shapes" not in values:
        raise ValueError(f"{where}: no labelme file: it must hold shapes and imagePath")
    name = file.parent.relative_to(root) / get_text(values, "imagePath", where).replace("\\", "/")
    lines: Labels = dict.fromkeys(SIDES)
    others = []
    for place, shape in iterate_objects(values["shapes"], f"{where}: shapes"):
        label = get_text(shape, "label", place)
        side = next((side for side in SIDES if label.lower().startswith(side)), None)
        if side is None:
            others.append(label)
            continue
        if lines[side] is not None:
            raise ValueError(f"{place}: a second {side} line; remove one")
        if shape.get("shape_type") not in LINE_TYPES:
            raise ValueError(f"{place}: {label} must be a {' or '.join(LINE_TYPES)}, got {shape.get('shape_type')!r}")
        lines[side] = parse_points(shape.get("points"), f"{place}: {label}") - 0.5
    if others and not any(line is not None for line in lines.values()):
        raise ValueError(
            f"{where}: no shape is labelled left or right, but {', '.join(others)}; without shapes no runway"
        )
    return LabelledImage(Path(os.path.normpath(name)).as_posix(), lines["left"], lines["right"])


def write_labelme(out: Path, images: Sequence[LabelledImage], line_points: int = 9) -> None:
    """Write a .json beside each image below `out`, `line_points` points evenly spaced along each line."""
    for image in images:
        file, (width, height) = out / image.file, image.size
        values: dict[str, Any] = {
            "version": VERSION,
            "flags": {},
            "shapes": [
                _make_shape(side, (resample(line, line_points) + 0.5).round(DECIMALS).tolist())
                for side, line in image.lines.items()
                if line is not None
            ],
            "imagePath": file.name,
            "imageData": None,
            "imageHeight": height,
            "imageWidth": width,
        }
        write_atomic(file.with_suffix(".json"), (json.dumps(values, indent=1) + "\n").encode())


def _make_shape(label: str, points: list[Any]) -> dict[str, Any]:
    return {"label": label, "points": points, "group_id": None, "shape_type": "linestrip", "flags": {}}
