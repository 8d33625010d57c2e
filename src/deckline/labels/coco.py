"""COCO keypoints: one "runway" an image, its keypoints named left_1, left_2, ..., right_1, ... along each line."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from deckline.atomic import write_atomic
from deckline.labels.lines import LabelledImage, LabelSet, Line, parsed, points, read_text, resampled, sized
from deckline.types import SIDES

CATEGORY = "runway"
VISIBLE = 2  # COCO's flag of a keypoint that is labelled and seen; 0 is not labelled
DECIMALS = 3  # of u and v, px
USUAL_NAMES = ("annotations.json", "annotations/*.json", "*.json")  # in a data set's folder


def write_coco(path: Path, images: Sequence[LabelledImage], line_points: int = 9) -> None:
    """Write labels, `line_points` keypoints evenly spaced along each line, its ends among them.

    Raises:
        ValueError: fewer than two points a line, or an image of unknown size.
        OSError: the disk refuses.
    """
    if line_points < 2:
        raise ValueError(f"a line needs at least 2 keypoints, got {line_points}")
    names = [f"{side}_{k}" for side in SIDES for k in range(1, line_points + 1)]
    chains = [[s + k, s + k + 1] for s in (1, 1 + line_points) for k in range(line_points - 1)]
    values = {
        "info": {"description": "runway lines, left and right in the direction of landing"},
        "images": [_image(number, image) for number, image in enumerate(images, 1)],
        "annotations": [
            _annotation(number, image, line_points)
            for number, image in enumerate(images, 1)
            if any(line is not None for line in image.lines.values())
        ],
        "categories": [{"id": 1, "name": CATEGORY, "supercategory": "", "keypoints": names, "skeleton": chains}],
    }
    write_atomic(path, (json.dumps(values, allow_nan=False) + "\n").encode())


def _image(number: int, image: LabelledImage) -> dict[str, Any]:
    width, height = sized(image)
    return {"id": number, "file_name": image.file, "width": width, "height": height}


def _annotation(number: int, image: LabelledImage, line_points: int) -> dict[str, Any]:
    keypoints, there = [], []
    for line in image.lines.values():
        if line is None:
            keypoints += [0.0, 0.0, 0] * line_points
            continue
        there.append(np.round(resampled(line, line_points), DECIMALS))
        keypoints += [value for u, v in there[-1].tolist() for value in (u, v, VISIBLE)]
    every = np.concatenate(there)
    low, size = every.min(axis=0), np.ptp(every, axis=0)
    return {
        "id": number,
        "image_id": number,
        "category_id": 1,
        "iscrowd": 0,
        "bbox": [*low.tolist(), *size.tolist()],
        "area": float(size.prod()),
        "num_keypoints": len(every),
        "keypoints": keypoints,
    }


def read_coco(path: Path) -> LabelSet:
    """Read a keypoint file, or the one of a folder: annotations.json, annotations/*.json or *.json.

    Keypoints that are named left... and right... are taken, in the order of the category's list.

    Raises:
        ValueError: no labels, or an entry that is none; one line that names file, entry and what is wrong.
    """
    file = _file(path)
    values = parsed(read_text(file), str(file))
    lists = ("images", "annotations", "categories")
    if not isinstance(values, dict) or any(not isinstance(values.get(name), list) for name in lists):
        raise ValueError(f"{file}: no COCO file: it must hold the lists {', '.join(lists)}")
    categories = _categories(values["categories"], file)
    found: dict[int | str, dict[str, Line | None]] = {}
    for index, entry in enumerate(values["annotations"]):
        where = f"{file}: annotations[{index}]"
        if not isinstance(entry, Mapping):
            raise ValueError(f"{where} must be an object")
        names = categories.get(_id(entry, "category_id", where))
        if names is None:
            continue
        image = _id(entry, "image_id", where)
        if image in found:
            raise ValueError(f"{where}: a second runway in image {image}; remove one")
        found[image] = _lines(entry.get("keypoints"), names, where)
    images = [_labelled(entry, found, f"{file}: images[{index}]") for index, entry in enumerate(values["images"])]
    if not images:
        raise ValueError(f"{file}: it names no images")
    return LabelSet(file.parent, tuple(images))


def _file(path: Path) -> Path:
    if not path.is_dir():
        return path
    for pattern in USUAL_NAMES:
        files = sorted(path.glob(pattern))
        if len(files) == 1:
            return files[0]
        if files:
            raise ValueError(f"{path}: {len(files)} files {pattern}; name the one to read")
    raise ValueError(f"{path}: no {USUAL_NAMES[0]} in this folder; name the label file itself")


def _categories(entries: list[Any], file: Path) -> dict[int | str, list[str]]:
    """Keypoint names by category, of those that have left or right ones."""
    categories = {}
    for index, entry in enumerate(entries):
        names = entry.get("keypoints", []) if isinstance(entry, Mapping) else None
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            raise ValueError(f"{file}: categories[{index}] must be an object with keypoints, a list of names")
        if any(name.lower().startswith(SIDES) for name in names):
            categories[_id(entry, "id", f"{file}: categories[{index}]")] = names
    if not categories:
        raise ValueError(f"{file}: no category has keypoints named left_1, left_2, ..., right_1, ...")
    return categories


def _id(entry: Mapping[str, Any], name: str, where: str) -> int | str:
    value = entry.get(name)
    if isinstance(value, bool) or not isinstance(value, int | str):
        raise ValueError(f"{where}: {name} must be a number or a name")
    return value


def _lines(keypoints: Any, names: list[str], where: str) -> dict[str, Line | None]:
    if not isinstance(keypoints, list) or len(keypoints) != 3 * len(names):
        raise ValueError(f"{where}: keypoints must be 3 numbers for each of the {len(names)} names")
    triples = [keypoints[k : k + 3] for k in range(0, len(keypoints), 3)]
    lines: dict[str, Line | None] = {}
    for side in SIDES:
        labelled = zip(names, triples, strict=True)
        pairs = [triple[:2] for name, triple in labelled if name.lower().startswith(side) and triple[2]]
        lines[side] = points(pairs, f"{where}: {side}") if pairs else None
    return lines


def _labelled(entry: Any, found: Mapping[int | str, dict[str, Line | None]], where: str) -> LabelledImage:
    if not isinstance(entry, Mapping) or not isinstance(entry.get("file_name"), str):
        raise ValueError(f"{where} must be an object with file_name")
    width, height = entry.get("width"), entry.get("height")
    size = (width, height) if isinstance(width, int) and isinstance(height, int) else None
    lines = found.get(_id(entry, "id", where), dict.fromkeys(SIDES))
    return LabelledImage(entry["file_name"], lines["left"], lines["right"], size)
