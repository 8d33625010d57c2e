"""labels.json beside images: {"frames": [{"file": "a.png", "left_px": [[u, v], ...], "right_px": [[u, v], ...]}]}.

At least two points a line, or null for a line that is not there; other keys are left alone.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from deckline.atomic import write_atomic
from deckline.labels.lines import LabelledImage, Line, parsed, points, read_text
from deckline.types import SIDES

LABELS_FILE = "labels.json"
DECIMALS = 3  # of u and v, px
Labels = dict[str, Line | None]  # side -> (N, 2) labelled px, None: no such line


def read_labels(path: Path) -> dict[str, Labels]:
    """Labelled lines by image file.

    Raises:
        ValueError: not JSON, or not of the form above; the line names the file and the entry.
    """
    values = parsed(read_text(path), str(path))
    frames = values.get("frames") if isinstance(values, dict) else None
    if not isinstance(frames, list) or not frames:
        raise ValueError(
            f'{path}: expected {{"frames": [{{"file", "left_px", "right_px"}}, ...]}} with at least one frame'
        )
    labels = {}
    for index, entry in enumerate(frames):
        if not isinstance(entry, dict) or not isinstance(entry.get("file"), str):
            raise ValueError(f"{path}: frames[{index}] names no file")
        labels[entry["file"]] = {
            side: _line(entry.get(f"{side}_px"), f"{path}: {entry['file']} {side}_px") for side in SIDES
        }
    return labels


def _line(values: Any, where: str) -> Line | None:
    if values is None:
        return None
    try:
        return points(values, where)
    except ValueError as error:
        raise ValueError(f"{error}, or null") from None


def write_labels(path: Path, images: Sequence[LabelledImage]) -> None:
    """Write labels.json, one frame a line.

    Raises:
        OSError: the disk refuses.
    """
    rows = []
    for image in images:
        lines = {f"{side}_px": _rounded(line) for side, line in image.lines.items()}
        rows.append(json.dumps({"file": image.file, **lines}, allow_nan=False))
    write_atomic(path, ('{"frames": [\n' + ",\n".join(rows) + "\n]}\n").encode())


def _rounded(line: Line | None) -> list[list[float]] | None:
    return None if line is None else line.round(DECIMALS).tolist()
