"""YOLO-pose label files: beside every image, or in labels/ where images/ holds the images, a .txt of the same name.

Its row is "class cx cy w h x1 y1 [v1] x2 y2 [v2] ...", shares of the image's width and height counted from its outer
corner; v 0 or a point 0 0 is not labelled. An empty file is an image without a runway. Names of the keypoints, such as
left_1, are in data.yaml under kpt_names; without names the first half is left, the second right, in order along each.
Source: Ultralytics, "Pose Estimation Datasets Overview", https://docs.ultralytics.com/datasets/pose/
"""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from deckline.atomic import write_atomic
from deckline.files import is_there
from deckline.recording.source import read_text
from deckline.types import SIDES
from deckline_lab.labels.lines import (
    LabelledImage,
    Labels,
    LabelSet,
    Line,
    find_image,
    find_side,
    is_in_picture,
    make_keypoints,
    name_keypoints,
    read_rows,
    read_size,
    resample,
    split_keypoints,
)

IMAGES, LABELS, SETTINGS_FILE = "images", "labels", "data.yaml"  # folders and file of a data set
CLASSES_FILE = "classes.txt"  # that labelling tools leave among the labels
BOX = 5  # numbers of a row before its keypoints: class, box
DECIMALS = 7  # of written shares: 0.001 px of 10,000
VISIBILITIES = (0.0, 1.0, 2.0)


def read_yolo_pose(path: Path, names: Sequence[str] = ()) -> LabelSet:
    """Read a data set's folder, or the one of a data.yaml.

    Args:
        names: of the keypoints in their order; those with the word left or right are taken. Empty: data.yaml's.

    Raises:
        ValueError: no labels, a row that is none, two runways, or no image; one line that names the place.
    """
    root = path.parent if path.is_file() or path.name == LABELS else path
    settings = path if path.is_file() else root / SETTINGS_FILE
    names = names or (_parse_names(read_text(settings)) if is_there(settings) else ())
    if names and not any(find_side(name, str(path)) for name in names):
        raise ValueError(f"{path}: expected keypoints named left or right, got {', '.join(names)}; give --keypoints")
    inside = [file for file in sorted(root.rglob("*.txt")) if LABELS in file.relative_to(root).parts]
    files = [file for file in inside or sorted(root.glob("*.txt")) if file.name != CLASSES_FILE]
    if not files:
        raise ValueError(f"{path}: no labels: neither {LABELS}/*.txt nor .txt files beside images")
    return root, [_read_image_labels(root, file, names) for file in files]


def _parse_names(settings: str) -> list[str]:
    """The words under kpt_names, in brackets or one a line."""
    block = re.search(r"^kpt_names:(.*(?:\n[ \t-].*)*)", re.sub(r"#.*", "", settings), re.MULTILINE)
    return [] if block is None else re.findall(r"[A-Za-z][\w-]*", block[1])


def _read_image_labels(root: Path, file: Path, names: Sequence[str]) -> LabelledImage:
    folder = Path(*(IMAGES if part == LABELS else part for part in file.parent.relative_to(root).parts))
    image = find_image(root / folder, file.stem)
    if image is None:
        raise ValueError(f"{file}: no image {file.stem}.* in {root / folder}")
    rows = read_rows(file)
    if len(rows) > 1:
        raise ValueError(f"{file}: {len(rows)} runways; remove all but one")
    size = read_size(image)
    lines = _parse_row(rows[0][1], size, names, str(file)) if rows else dict.fromkeys(SIDES)
    return LabelledImage((folder / image.name).as_posix(), lines["left"], lines["right"], size)


def _parse_row(row: str, size: tuple[int, int], names: Sequence[str], where: str) -> Labels:
    try:
        numbers = np.array([float(word) for word in row.split()])[BOX:]
    except ValueError:
        raise ValueError(f"{where}: a row must hold numbers alone, got {row!r}") from None
    flagged = len(numbers) % 3 == 0 and np.isin(numbers[2::3], VISIBILITIES).all()
    columns = 3 if flagged else 2
    count = len(numbers) // columns
    if not count or len(numbers) % columns or (names and len(names) != count) or (not names and count % 2):
        expected = f"{len(names)} keypoints ({', '.join(names)})" if names else "as many keypoints left as right"
        raise ValueError(f"{where}: {len(numbers)} numbers after class and box; expected {expected}, or name them")
    points = numbers.reshape(count, columns)
    labelled = points[:, :2].any(axis=1) & (points[:, :2] >= 0).all(axis=1) & (points[:, -1] > 0 if flagged else True)
    names = names or [side for side in SIDES for _ in range(count // 2)]
    with np.errstate(over="ignore"):  # infinite points are refused
        points_px = points[:, :2] * size - 0.5
    return split_keypoints(list(points_px[labelled]), np.array(names)[labelled].tolist(), where)


def write_yolo_pose(out: Path, images: Sequence[LabelledImage], line_points: int = 9) -> None:
    """Write labels/*.txt and data.yaml for images/*, `line_points` keypoints evenly spaced along each line."""
    for image in images:
        file = out / LABELS / Path(image.file).relative_to(IMAGES).with_suffix(".txt")
        file.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(file, _format_row(image, line_points).encode())
    names = name_keypoints(line_points)
    flipped = [*range(line_points, 2 * line_points), *range(line_points)]
    rows = [
        f"path: .\ntrain: {IMAGES}\nval: {IMAGES}\nnames:\n  0: runway",
        f"kpt_shape: [{len(names)}, 3]\nflip_idx: {flipped}\nkpt_names:\n  0: [{', '.join(names)}]\n",
    ]
    write_atomic(out / SETTINGS_FILE, "\n".join(rows).encode())


def _format_row(image: LabelledImage, line_points: int) -> str:
    """The image's row; an empty text without lines."""
    parts = [None if line is None else _cut_to_picture(line, image.size) for line in image.lines.values()]
    keypoints = make_keypoints(parts, line_points)
    keypoints[..., :2] = np.where(keypoints[..., 2:] > 0, (keypoints[..., :2] + 0.5) / image.size, 0.0)
    seen = keypoints[keypoints[:, :, 2] > 0][:, :2]
    if not len(seen):
        return ""
    low, high = seen.min(axis=0), seen.max(axis=0)
    box = " ".join(f"{value:.{DECIMALS}f}" for value in (*(low + high) / 2, *(high - low)))
    points = " ".join(f"{u:.{DECIMALS}f} {v:.{DECIMALS}f} {int(flag)}" for u, v, flag in keypoints.reshape(-1, 3))
    return f"0 {box} {points}\n"


def _cut_to_picture(line: Line, size: tuple[int, int]) -> Line | None:
    """The part of a line in a picture (width, height), to a thousandth of its length; None where it is outside."""
    fine = line if is_in_picture(line, size).all() else resample(line, 1001)
    part = fine[is_in_picture(fine, size)]
    return part if len(part) > 1 else None
