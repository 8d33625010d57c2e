"""COCO keypoint files: one "runway" an image, its keypoints named left_1, left_2, ..., right_1, ... along each line."""

import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

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
    make_keypoints,
    name_keypoints,
    parse_object,
    split_keypoints,
)

CATEGORY = "runway"
USUAL_NAMES = ("annotations.json", "annotations/*.json", "*.json")  # in a data set's folder


def write_coco(path: Path, images: Sequence[LabelledImage], line_points: int = 9) -> None:
    """Write labels, `line_points` keypoints (at least 2) evenly spaced along each line, its ends among them."""
    if line_points < 2:
        raise ValueError(f"a line needs at least 2 keypoints, got {line_points}")
    names = name_keypoints(line_points)
    chains = [[s + k, s + k + 1] for s in (1, 1 + line_points) for k in range(line_points - 1)]
    numbered = list(enumerate(images, 1))
    sizes = {number: dict(zip(("width", "height"), image.size, strict=True)) for number, image in numbered}
    values = {
        "info": {"description": "runway lines, left and right in the direction of landing"},
        "images": [{"id": number, "file_name": image.file, **sizes[number]} for number, image in numbered],
        "annotations": [
            _make_annotation(number, image, line_points)
            for number, image in numbered
            if any(line is not None for line in image.lines.values())
        ],
        "categories": [{"id": 1, "name": CATEGORY, "supercategory": "", "keypoints": names, "skeleton": chains}],
    }
    write_atomic(path, (json.dumps(values, allow_nan=False) + "\n").encode())


def _make_annotation(number: int, image: LabelledImage, line_points: int) -> dict[str, Any]:
    keypoints = make_keypoints(list(image.lines.values()), line_points).round(DECIMALS)
    labelled = keypoints[keypoints[:, :, 2] > 0][:, :2]
    low, size = labelled.min(axis=0), np.ptp(labelled, axis=0)
    return {
        "id": number,
        "image_id": number,
        "category_id": 1,
        "iscrowd": 0,
        "bbox": [*low.tolist(), *size.tolist()],
        "area": float(size.prod()),
        "num_keypoints": len(labelled),
        "keypoints": [value for u, v, seen in keypoints.reshape(-1, 3).tolist() for value in (u, v, int(seen))],
    }


def read_coco(path: Path) -> LabelSet:
    """Read a keypoint file, or the one of a folder: annotations.json, annotations/*.json or *.json.

    Keypoints with the word left or right in their names are taken, in the order of the category's list.

    Raises:
        ValueError: no labels, or an entry that is none; one line that names file, entry and what is wrong.
    """
    file = _find_file(path)
    values = parse_object(read_text(file), str(file), "images", "annotations", "categories")
    names: dict[int | str, list[str]] = {}  # of keypoints, by category
    for where, entry in iterate_objects(values["categories"], f"{file}: categories"):
        keypoints = entry.get("keypoints", [])
        if not isinstance(keypoints, list) or not all(isinstance(name, str) for name in keypoints):
            raise ValueError(f"{where}: keypoints must be a list of names")
        if any(find_side(name, where) for name in keypoints):
            names[_get_id(entry, "id", where)] = keypoints
    if not names:
        raise ValueError(f"{file}: no category has keypoints named left_1, left_2, ..., right_1, ...")
    found: dict[int | str, Labels] = {}
    for where, entry in iterate_objects(values["annotations"], f"{file}: annotations"):
        category = _get_id(entry, "category_id", where)
        if category in names:
            image = _get_id(entry, "image_id", where)
            if image in found:
                raise ValueError(f"{where}: a second runway in image {image}; remove one")
            found[image] = _parse_lines(entry.get("keypoints"), names[category], where)
    entries = list(iterate_objects(values["images"], f"{file}: images"))
    if not entries:
        raise ValueError(f"{file}: it names no images")
    _check_ids([_get_id(entry, "id", where) for where, entry in entries], found, str(file))
    return file.parent, [_parse_image(entry, found, where) for where, entry in entries]


def _check_ids(ids: list[int | str], found: dict[int | str, Labels], where: str) -> None:
    """Raise ValueError for an id of several images, and for lines of no image, which would be one without a runway."""
    (most_frequent, count), *_ = Counter(ids).most_common(1)
    if count > 1:
        raise ValueError(f"{where}: images: {count} have the id {most_frequent!r}; give each an id of its own")
    if lost := found.keys() - set(ids):
        raise ValueError(f"{where}: annotations: a runway of image_id {next(iter(lost))!r}, which no image has as id")


def _find_file(path: Path) -> Path:
    if not path.is_dir():
        return path
    for pattern in USUAL_NAMES:
        files = sorted(path.glob(pattern))
        if len(files) == 1:
            return files[0]
        if files:
            raise ValueError(f"{path}: {len(files)} files {pattern}; name the one to read")
    raise ValueError(f"{path}: no {USUAL_NAMES[0]} in this folder; name the label file itself")


def _get_id(entry: dict[str, Any], name: str, where: str) -> int | str:
    value = entry.get(name)
    if isinstance(value, bool) or not isinstance(value, int | str):
        raise ValueError(f"{where}: {name} must be a number or a name")
    return value


def _parse_lines(keypoints: Any, names: list[str], where: str) -> Labels:
    if not isinstance(keypoints, list) or len(keypoints) != 3 * len(names):
        raise ValueError(f"{where}: keypoints must be 3 numbers for each of the {len(names)} names")
    triples = [keypoints[k : k + 3] for k in range(0, len(keypoints), 3)]
    labelled = [(triple[:2], name) for triple, name in zip(triples, names, strict=True) if triple[2]]
    return split_keypoints([point for point, _ in labelled], [name for _, name in labelled], where)


def _parse_image(entry: dict[str, Any], found: dict[int | str, Labels], where: str) -> LabelledImage:
    file, width, height = get_text(entry, "file_name", where), entry.get("width"), entry.get("height")
    size = (width, height) if isinstance(width, int) and isinstance(height, int) else None
    lines = found.get(_get_id(entry, "id", where), dict.fromkeys(SIDES))
    return LabelledImage(file, lines["left"], lines["right"], size)
