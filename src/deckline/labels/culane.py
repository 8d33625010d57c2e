"""CULane: beside every image a .lines.txt, one line a row as "u v u v ..."; list files name the images.

A row of a list file is the image, optionally its mask, optionally flags of the lines that exist, here left and right:
"/images/a.png /laneseg_label/images/a.png 1 0". Without flags, of two lines the one further left is the left one.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from deckline.atomic import write_atomic
from deckline.labels.lines import (
    LabelledImage,
    LabelSet,
    Line,
    at_rows,
    left_and_right,
    points,
    read_text,
    sized,
)
from deckline.recording.images import IMAGE_SUFFIXES

LINES_SUFFIX = ".lines.txt"
LIST_FOLDER = "list"
NAMES_FILE, FLAGS_FILE = "train.txt", "train_gt.txt"
MASK_FOLDER = "laneseg_label"
DECIMALS = 3  # of u, px


def write_culane(out: Path, images: Sequence[LabelledImage], row_step_px: int = 1) -> None:
    """Write .lines.txt files and list/train.txt and list/train_gt.txt below `out`, near end of every line first.

    The masks that list/train_gt.txt names are pictures: whoever writes the images writes them (`mask_name`).

    Raises:
        ValueError: an image of unknown size, or a file name with spaces, which list files cannot hold.
        OSError: the disk refuses.
    """
    flags = []
    for image in images:
        if image.file.split() != [image.file]:
            raise ValueError(f"{image.file!r}: a CULane list cannot hold a file name with spaces")
        lines = [_sampled(line, sized(image), row_step_px) for line in image.lines.values()]
        text = "".join(_row(line) + "\n" for line in lines if line is not None)
        write_atomic(out / lines_name(image.file), text.encode())
        flags.append(f"/{image.file} /{mask_name(image.file)} {' '.join(str(int(x is not None)) for x in lines)}\n")
    (out / LIST_FOLDER).mkdir(exist_ok=True)
    write_atomic(out / LIST_FOLDER / NAMES_FILE, "".join(f"/{image.file}\n" for image in images).encode())
    write_atomic(out / LIST_FOLDER / FLAGS_FILE, "".join(flags).encode())


def lines_name(image: str) -> str:
    """Name of the file with an image's lines."""
    return image.rpartition(".")[0] + LINES_SUFFIX


def mask_name(image: str) -> str:
    """Name of the picture in which an image's lines are drawn, left 1 and right 2."""
    return f"{MASK_FOLDER}/{image.rpartition('.')[0]}.png"


def _sampled(line: Line | None, size: tuple[int, int], row_step_px: int) -> Line | None:
    if line is None:
        return None
    rows = np.arange(size[1] - 1, -1, -row_step_px)
    u = at_rows(line, rows)
    kept = (u >= 0) & (u <= size[0] - 1)
    return np.stack([u[kept], rows[kept]], axis=1) if kept.sum() >= 2 else None


def _row(line: Line) -> str:
    return " ".join(f"{u:.{DECIMALS}f} {v:g}" for u, v in line)


def read_culane(path: Path) -> LabelSet:
    """Read the images that a list file names, or every image of a folder that has a .lines.txt beside it.

    Raises:
        ValueError: no labels, or a row that is none; one line that names file, row and what is wrong.
    """
    if path.is_dir() and (path / LIST_FOLDER / FLAGS_FILE).exists():
        path = path / LIST_FOLDER / FLAGS_FILE
    if path.is_dir():
        images = [_from_folder(path, file) for file in sorted(path.rglob(f"*{LINES_SUFFIX}"))]
        root = path
    else:
        root = path.parent.parent if path.parent.name == LIST_FOLDER else path.parent
        rows = enumerate(read_text(path).splitlines(), 1)
        images = [_from_list(root, text.split(), f"{path}: line {number}") for number, text in rows if text.strip()]
    if not images:
        raise ValueError(f"{path}: no labels: neither a list of images nor a folder with {LINES_SUFFIX} files")
    return LabelSet(root, tuple(images))


def _from_folder(root: Path, lines_file: Path) -> LabelledImage:
    stem = lines_file.name.removesuffix(LINES_SUFFIX)
    for suffix in IMAGE_SUFFIXES:
        image = lines_file.with_name(stem + suffix)
        if image.exists():
            lines = left_and_right(_lines(lines_file), str(lines_file))
            return LabelledImage(image.relative_to(root).as_posix(), *lines)
    raise ValueError(f"{lines_file}: no image {stem}.* beside it")


def _from_list(root: Path, words: list[str], where: str) -> LabelledImage:
    name = words[0].lstrip("/")
    flags = [word for word in words[1:] if word in ("0", "1")]
    lines_file = root / lines_name(name)
    lines = _lines(lines_file)
    if not flags:
        return LabelledImage(name, *left_and_right(lines, str(lines_file)))
    if len(flags) != 2:
        raise ValueError(f"{where}: {len(flags)} flags; a runway has two lines: left and right")
    if flags.count("1") != len(lines):
        raise ValueError(f"{where}: flags {' '.join(flags)}, but {lines_file} holds {len(lines)} lines")
    if len(lines) == 2:
        return LabelledImage(name, *left_and_right(lines, str(lines_file)))
    one = lines[0] if lines else None
    return LabelledImage(name, one if flags[0] == "1" else None, one if flags[1] == "1" else None)


def _lines(path: Path) -> list[Line]:
    lines = []
    for number, text in enumerate(read_text(path).splitlines(), 1):
        words = text.split()
        if words:
            pairs = [words[k : k + 2] for k in range(0, len(words), 2)]
            lines.append(points(pairs, f"{path}: line {number}"))
    return lines
