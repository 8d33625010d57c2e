"""Label files of other tools: TuSimple, CULane, COCO keypoints.

TuSimple and CULane do not name their lanes: of two lines in the image the one further left is the left one.

TuSimple: a JSON object a line, {"raw_file", "h_samples": rows v, "lanes": [[u of every row, -2: none], ...]}. Two
entries of which one is all -2 are left and right in this order.

CULane: beside every image a .lines.txt, one line a row as "u v u v ..."; list files name the images. A row of a list
file is the image, optionally its mask, optionally flags of the lines that exist, here left and right:
"/images/a.png /laneseg_label/images/a.png 1 0".

COCO: one "runway" an image, its keypoints named left_1, left_2, ..., right_1, ... along each line.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from deckline.atomic import write_atomic
from deckline.files import is_there
from deckline.recording.source import parse_json, read_text
from deckline.types import SIDES
from deckline_lab.labels.lines import (
    DECIMALS,
    LabelledImage,
    Labels,
    LabelSet,
    Line,
    assign_sides,
    find_image,
    get_text,
    iterate_objects,
    parse_points,
    resample,
    sample_rows,
)

ABSENT = -2  # u of a row that a TuSimple lane does not reach
TUSIMPLE_DECIMALS = 2  # of u, px
TUSIMPLE_NAMES = "label_data*.json"  # in a data set's folder
LINES_SUFFIX = ".lines.txt"
LIST_FOLDER, NAMES_FILE, FLAGS_FILE = "list", "train.txt", "train_gt.txt"
MASK_FOLDER = "laneseg_label"
CULANE_DECIMALS = 3  # of u, px
CATEGORY = "runway"
VISIBLE = 2  # COCO's flag of a keypoint that is labelled and seen; 0 is not labelled
USUAL_NAMES = ("annotations.json", "annotations/*.json", "*.json")  # in a data set's folder


def write_tusimple(path: Path, images: Sequence[LabelledImage], row_step_px: int = 1) -> None:
    """Write labels; a line is kept where it crosses rows 0, row_step_px, ... of the image."""
    rows = []
    for image in images:
        v = np.arange(0, image.size[1], row_step_px)
        lanes = []
        for u in sample_rows(image, v):
            u = np.full(len(v), np.nan) if u is None else u
            lanes.append([round(x, TUSIMPLE_DECIMALS) if np.isfinite(x) else ABSENT for x in u.tolist()])
        rows.append(json.dumps({"lanes": lanes, "h_samples": v.tolist(), "raw_file": image.file}) + "\n")
    write_atomic(path, "".join(rows).encode())


def read_tusimple(path: Path) -> LabelSet:
    """Read a label file, or every label_data*.json of a folder; a ValueError names file, line and what is wrong."""
    files = sorted(path.glob(TUSIMPLE_NAMES)) if path.is_dir() else [path]
    if not files:
        raise ValueError(f"{path}: no {TUSIMPLE_NAMES} in this folder; name the label file itself")
    images = []
    for file in files:
        images += [_parse_tusimple_image(text, f"{file}: line {number}") for number, text in _read_lines(file)]
    if not images:
        raise ValueError(f"{files[0]}: no labels in it; expected one JSON object a line")
    return files[0].parent, images


def _parse_tusimple_image(text: str, where: str) -> LabelledImage:
    values = parse_json(text, where)
    if not isinstance(values, dict):
        raise ValueError(f"{where} must be an object with raw_file, h_samples and lanes")
    file, rows, lanes = get_text(values, "raw_file", where), values.get("h_samples"), values.get("lanes")
    if not isinstance(lanes, list) or not isinstance(rows, list):
        raise ValueError(f"{where}: h_samples and lanes must be lists")
    lines = [_parse_tusimple_line(lane, rows, f"{where}: lanes[{index}]") for index, lane in enumerate(lanes)]
    present = [line for line in lines if line is not None]
    if len(lines) == 2 and len(present) < 2:
        return LabelledImage(file, lines[0], lines[1])
    return LabelledImage(file, *assign_sides(present, where))


def _parse_tusimple_line(lane: Any, rows: list[Any], where: str) -> Line | None:
    if not isinstance(lane, list) or len(lane) != len(rows):
        raise ValueError(f"{where} must hold one u for each of the {len(rows)} h_samples")
    try:
        line = np.array([lane, rows], dtype=np.float64).T.reshape(-1, 2)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{where} and h_samples must be numbers") from None
    line = line[~(line[:, 0] < 0)]
    return parse_points(line, f"{where}, without rows of {ABSENT},") if len(line) else None


def write_culane(out: Path, images: Sequence[LabelledImage], row_step_px: int = 1) -> None:
    """Write .lines.txt files and list/train.txt and list/train_gt.txt below `out`, near end of every line first.

    The masks that list/train_gt.txt names are pictures: whoever writes the images writes them (`get_mask_name`).
    A ValueError for an image of unknown size, or a file name with spaces, which list files cannot hold.
    """
    flags = []
    for image in images:
        if image.file.split() != [image.file]:
            raise ValueError(f"{image.file!r}: a CULane list cannot hold a file name with spaces")
        rows = np.arange(image.size[1] - 1, -1, -row_step_px)
        lines = sample_rows(image, rows)
        pairs = [[(x, v) for x, v in zip(u, rows, strict=True) if np.isfinite(x)] for u in lines if u is not None]
        text = "".join(" ".join(f"{x:.{CULANE_DECIMALS}f} {v}" for x, v in line) + "\n" for line in pairs)
        write_atomic(out / _get_lines_name(image.file), text.encode())
        flags.append(f"/{image.file} /{get_mask_name(image.file)} {' '.join(str(int(u is not None)) for u in lines)}\n")
    (out / LIST_FOLDER).mkdir(exist_ok=True)
    write_atomic(out / LIST_FOLDER / NAMES_FILE, "".join(f"/{image.file}\n" for image in images).encode())
    write_atomic(out / LIST_FOLDER / FLAGS_FILE, "".join(flags).encode())


def get_mask_name(image: str) -> str:
    """Name of the picture in which an image's lines are drawn, left 1 and right 2."""
    return f"{MASK_FOLDER}/{image.rpartition('.')[0]}.png"


def _get_lines_name(image: str) -> str:
    return image.rpartition(".")[0] + LINES_SUFFIX


def read_culane(path: Path) -> LabelSet:
    """Read the images of a list file, or those of a folder with a .lines.txt beside them; errors as `read_tusimple`."""
    if path.is_dir() and is_there(path / LIST_FOLDER / FLAGS_FILE):
        path = path / LIST_FOLDER / FLAGS_FILE
    if path.is_dir():
        images = [_read_culane_beside(path, file) for file in sorted(path.rglob(f"*{LINES_SUFFIX}"))]
        root = path
    else:
        root = path.parent.parent if path.parent.name == LIST_FOLDER else path.parent
        images = [_read_culane_listed(root, text, f"{path}: line {number}") for number, text in _read_lines(path)]
    if not images:
        raise ValueError(f"{path}: no labels: neither a list of images nor a folder with {LINES_SUFFIX} files")
    return root, images


def _read_culane_beside(root: Path, lines_file: Path) -> LabelledImage:
    stem = lines_file.name.removesuffix(LINES_SUFFIX)
    image = find_image(lines_file.parent, stem)
    if image is None:
        raise ValueError(f"{lines_file}: no image {stem}.* beside it")
    lines = assign_sides(_read_culane_lines(lines_file), str(lines_file))
    return LabelledImage(image.relative_to(root).as_posix(), *lines)


def _read_culane_listed(root: Path, text: str, where: str) -> LabelledImage:
    words = text.split()
    name = words[0].lstrip("/")
    flags = [word for word in words[1:] if word in ("0", "1")]
    lines_file = root / _get_lines_name(name)
    lines = _read_culane_lines(lines_file)
    if flags and len(flags) != 2:
        raise ValueError(f"{where}: {len(flags)} flags; a runway has two lines: left and right")
    if flags and flags.count("1") != len(lines):
        raise ValueError(f"{where}: flags {' '.join(flags)}, but {lines_file} holds {len(lines)} lines")
    if flags and len(lines) == 1:
        return LabelledImage(name, *((lines[0], None) if flags[0] == "1" else (None, lines[0])))
    return LabelledImage(name, *assign_sides(lines, str(lines_file)))


def _read_culane_lines(path: Path) -> list[Line]:
    lines = []
    for number, text in _read_lines(path):
        words = text.split()
        pairs = [words[k : k + 2] for k in range(0, len(words), 2)]
        lines.append(parse_points(pairs, f"{path}: line {number}"))
    return lines


def _read_lines(path: Path) -> list[tuple[int, str]]:
    """The lines of a text that are not blank, with their numbers."""
    return [(number, text) for number, text in enumerate(read_text(path).splitlines(), 1) if text.strip()]


def write_coco(path: Path, images: Sequence[LabelledImage], line_points: int = 9) -> None:
    """Write labels, `line_points` keypoints (at least 2) evenly spaced along each line, its ends among them."""
    if line_points < 2:
        raise ValueError(f"a line needs at least 2 keypoints, got {line_points}")
    names = [f"{side}_{k}" for side in SIDES for k in range(1, line_points + 1)]
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
    keypoints = np.zeros((len(SIDES), line_points, 3))
    for side, line in enumerate(image.lines.values()):
        if line is not None:
            keypoints[side, :, :2] = np.round(resample(line, line_points), DECIMALS)
            keypoints[side, :, 2] = VISIBLE
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

    Keypoints that are named left... and right... are taken, in the order of the category's list.

    Raises:
        ValueError: no labels, or an entry that is none; one line that names file, entry and what is wrong.
    """
    file = _find_file(path)
    values = parse_json(read_text(file), str(file))
    if not isinstance(values, dict):
        raise ValueError(f"{file}: no COCO file: it must hold the lists images, annotations, categories")
    names: dict[int | str, list[str]] = {}  # of keypoints, by category
    for where, entry in iterate_objects(values.get("categories"), f"{file}: categories"):
        keypoints = entry.get("keypoints", [])
        if not isinstance(keypoints, list) or not all(isinstance(name, str) for name in keypoints):
            raise ValueError(f"{where}: keypoints must be a list of names")
        if any(name.lower().startswith(SIDES) for name in keypoints):
            names[_get_id(entry, "id", where)] = keypoints
    if not names:
        raise ValueError(f"{file}: no category has keypoints named left_1, left_2, ..., right_1, ...")
    found: dict[int | str, Labels] = {}
    for where, entry in iterate_objects(values.get("annotations"), f"{file}: annotations"):
        category = _get_id(entry, "category_id", where)
        if category in names:
            image = _get_id(entry, "image_id", where)
            if image in found:
                raise ValueError(f"{where}: a second runway in image {image}; remove one")
            found[image] = _parse_lines(entry.get("keypoints"), names[category], where)
    entries = iterate_objects(values.get("images"), f"{file}: images")
    images = [_parse_image(entry, found, where) for where, entry in entries]
    if not images:
        raise ValueError(f"{file}: it names no images")
    return file.parent, images


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
    lines: Labels = {}
    for side in SIDES:
        labelled = zip(names, triples, strict=True)
        pairs = [triple[:2] for name, triple in labelled if name.lower().startswith(side) and triple[2]]
        lines[side] = parse_points(pairs, f"{where}: {side}") if pairs else None
    return lines


def _parse_image(entry: dict[str, Any], found: dict[int | str, Labels], where: str) -> LabelledImage:
    file, width, height = get_text(entry, "file_name", where), entry.get("width"), entry.get("height")
    size = (width, height) if isinstance(width, int) and isinstance(height, int) else None
    lines = found.get(_get_id(entry, "id", where), dict.fromkeys(SIDES))
    return LabelledImage(file, lines["left"], lines["right"], size)
