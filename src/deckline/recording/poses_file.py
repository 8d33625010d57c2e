"""poses.csv: where the aircraft was at each image.

Columns file, time_s, x_m, y_m, z_m, qw, qx, qy, qz in any order: world_from_body, the world North-East-Down or any
right-handed forward-right-down frame. `file` is the image's name; for a video it is the number of the frame, counted
from 0 (bare, or as <video>#<number>). Poses are never interpolated: the row belongs to exactly that image.
"""

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from scipy.spatial.transform import RigidTransform

from deckline.geometry import pose
from deckline.recording.source import RecordingError, number, read_text

POSES_FILE = "poses.csv"
NUMBERS = ("time_s", "x_m", "y_m", "z_m", "qw", "qx", "qy", "qz")
COLUMNS = ("file", *NUMBERS)


@dataclass(frozen=True, eq=False)
class Poses:
    """Rows of poses.csv. The numbers of a row are checked when it is asked for."""

    path: Path
    rows: Mapping[str, tuple[int, tuple[str, ...]]]  # file -> line number, NUMBERS as written
    notes: tuple[str, ...] = ()

    def at(self, file: str) -> tuple[float, RigidTransform]:
        """Time in s and world_from_body of an image.

        Raises:
            ValueError: no row for it, a cell that is no number, or a quaternion that is none.
        """
        if file not in self.rows:
            raise ValueError(f"{self.path} has no row for it; add one, or take the image away")
        line, cells = self.rows[file]
        values = []
        for column, text in zip(NUMBERS, cells, strict=True):
            try:
                values.append(float(text))
            except ValueError:
                raise ValueError(f"{self.path} line {line}: {column} is no number: {text!r}") from None
        try:
            return number(values[0], "time_s"), pose(values[1:4], values[4:8])
        except ValueError as error:
            raise ValueError(f"{self.path} line {line}: {error}") from None

    def by_frame_number(self) -> "Poses":
        """The same rows under plain frame numbers, for a video.

        Raises:
            RecordingError: a file column that holds no frame number, or one twice.
        """
        rows: dict[str, tuple[int, tuple[str, ...]]] = {}
        for file, row in self.rows.items():
            digits = file.rpartition("#")[2].strip()
            if not (digits.isascii() and digits.isdigit()):
                raise RecordingError(
                    f"{self.path} line {row[0]}: for a video, file must be the frame's number from 0, got {file!r}"
                )
            _add(rows, str(int(digits)), row, self.path)
        return Poses(self.path, rows, self.notes)


def read_poses(path: Path) -> Poses:
    """Read poses.csv by its header.

    Raises:
        RecordingError: missing, empty or unreadable file, a missing column, no rows, or a file named twice.
    """
    reader = csv.reader(read_text(path).splitlines())
    header = [cell.strip() for cell in next(reader, [])]
    missing = [column for column in COLUMNS if column not in header]
    if missing:
        raise RecordingError(f"{path} line 1: column {', '.join(missing)} missing; expected {','.join(COLUMNS)}")
    repeated = sorted({column for column in header if header.count(column) > 1})
    if repeated:
        raise RecordingError(f"{path} line 1: column {', '.join(repeated)} stands there more than once")
    unknown = [column for column in header if column not in COLUMNS]
    rows: dict[str, tuple[int, tuple[str, ...]]] = {}
    try:
        for cells in reader:
            if any(cell.strip() for cell in cells):
                named = dict(zip(header, (cell.strip() for cell in cells), strict=False))
                numbers = tuple(named.get(column, "") for column in NUMBERS)
                _add(rows, named.get("file", ""), (reader.line_num, numbers), path)
    except csv.Error as error:
        raise RecordingError(f"{path} line {reader.line_num}: {error}") from None
    if not rows:
        raise RecordingError(f"{path}: zero poses: there is a header but no row below it")
    return Poses(path, rows, (f"{path} line 1: unknown column {', '.join(unknown)} ignored",) if unknown else ())


def _add(rows: dict, file: str, row: tuple[int, tuple[str, ...]], path: Path) -> None:
    if file in rows:
        raise RecordingError(f"{path} lines {rows[file][0]} and {row[0]}: {file!r} stands there twice; keep one")
    rows[file] = row
