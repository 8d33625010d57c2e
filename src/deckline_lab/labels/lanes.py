"""Label files of lane data sets: TuSimple and CULane.

TuSimple and CULane do not name their lanes: of two lines in the image the one further left is the left one.

TuSimple: a JSON object a line, {"raw_file", "h_samples": rows v, "lanes": [[u of every row, -2: none], ...]}. Two
entries of which one is all -2 are left and right in this order.

CULane: beside every image a .lines.txt, one line a row as "u v u v ..."; list files name the images. A row of a list
file is the image, optionally its mask, optionally flags of the lines that exist, here left and right:
"/images/a.png /laneseg_label/images/a.png 1 0".
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from deckline.atomic import write_atomic
from deckline.files import is_there
from deckline_lab.labels.lines import (
    LabelledImage,
    LabelSet,
    Line,
    assign_sides,
    find_image,
    get_text,
    parse_object,
    parse_points,
    read_rows,
    sample_rows,
)

ABSENT = -2  # u of a row that a TuSimple lane does not reach
TUSIMPLE_DECIMALS = 2  # of u, px
TUSIMPLE_NAMES = "label_data*.json"  # in a data set's folder
LINES_SUFFIX = ".lines.txt"
LIST_FOLDER, NAMES_FILE, FLAGS_FILE = "list", "train.txt", "train_gt.txt"
MASK_FOLDER = "laneseg_label"
CULANE_DECIMALS = 3  # of u, px


def write_tusimple(path: Path, images: Sequence[LabelledImage], row_step_px: int = 1) -> None:
    """Write labels; a line has a point where it crosses rows 0, row_step_px, ... of the image."""
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
        images += [_parse_tusimple_image(text, f"{file}: line {number}") for number, text in read_rows(file)]
    if not images:
        raise ValueError(f"{files[0]}: no labels in it; expected one JSON object a line")
    return files[0].parent, images


def _parse_tusimple_image(text: str, where: str) -> LabelledImage:
    values = parse_object(text, where, "raw_file", "h_samples", "lanes")
    file, rows, lanes = get_text(values, "raw_file", where), values["h_samples"], values["lanes"]
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
        images = [_read_culane_listed(root, text, f"{path}: line {number}") for number, text in read_rows(path)]
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
    if not is_there(lines_file):
        raise ValueError(f"{where}: there is no {lines_file} with the lines of {name}")
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
    for number, text in read_rows(path):
        words = text.split()
        pairs = [words[k : k + 2] for k in range(0, len(words), 2)]
        lines.append(parse_points(pairs, f"{path}: line {number}"))
    return lines
