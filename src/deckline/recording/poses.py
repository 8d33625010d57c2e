"""Rows of poses: poses.csv that names its images, times.csv, and the table of an AirSim recording.

poses.csv has the columns file, time_s, x_m, y_m, z_m, qw, qx, qy, qz in any order: world_from_body, the world
North-East-Down or any right-handed forward-right-down frame. With a column `file` in a folder of images a row belongs
to the image of this name, and may leave the pose empty; otherwise rows go by time (`pose_track`).
"""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from scipy.spatial.transform import RigidTransform

from deckline.geometry import pose
from deckline.recording.source import RecordingError, check_number, read_text

POSES_FILE = "poses.csv"
TIMES_FILE = "times.csv"  # file, time_s: when each image of a folder was taken
NUMBERS = ("time_s", "x_m", "y_m", "z_m", "qw", "qx", "qy", "qz")
COLUMNS = ("file", *NUMBERS)
Cells = Mapping[str, str]  # a row's texts by column
Rows = list[tuple[int, Cells]]  # with the number of the line


@dataclass(frozen=True, eq=False)
class Poses:
    """Rows of poses.csv. The numbers of a row are checked when it is asked for."""

    path: Path
    rows: Mapping[str, tuple[int, Cells]]  # file -> line number, cells
    notes: tuple[str, ...] = ()

    def at(self, file: str) -> tuple[float, RigidTransform | None]:
        """Time in s and world_from_body of an image, None where its row gives a time only.

        Raises:
            ValueError: there is no row for it, or one that is no pose.
        """
        if file not in self.rows:
            raise ValueError(f"{self.path} has no row for it; add one, or take the image away")
        line, cells = self.rows[file]
        try:
            if not any(cells.get(name) for name in NUMBERS[1:]):
                return check_number(parse_number(cells, NUMBERS[0]), NUMBERS[0]), None
            return parse_pose(cells, NUMBERS)
        except ValueError as error:
            raise ValueError(f"{self.path} line {line}: {error}") from None


def read_poses(path: Path) -> Poses:
    """Read poses.csv whose rows name images. Errors as `read_table`."""
    table, notes = read_table(path, ",", COLUMNS)
    return Poses(path, _index_by_file(path, table), tuple(notes))


def names_images(path: Path) -> bool:
    """Whether a CSV file has a column `file`."""
    return "file" in [cell.strip() for cell in read_text(path).partition("\n")[0].split(",")]


def read_image_times(path: Path) -> dict[str, float]:
    """Time in s of each image of times.csv; NaN for what is no number. Errors as `read_table`."""
    table, _ = read_table(path, ",", ("file", "time_s"))
    return {file: parse_number(cells, "time_s") for file, (_, cells) in _index_by_file(path, table).items()}


def _index_by_file(path: Path, table: Rows) -> dict[str, tuple[int, Cells]]:
    rows: dict[str, tuple[int, Cells]] = {}
    for line, cells in table:
        file = cells.get("file", "")
        if file in rows:
            raise RecordingError(f"{path} lines {rows[file][0]} and {line}: {file!r} stands there twice; keep one")
        rows[file] = line, cells
    return rows


def read_table(
    path: Path, delimiter: str, required: Sequence[str], optional: Sequence[str] = ()
) -> tuple[Rows, list[str]]:
    """Line number and cells of each row of a text table with a header, and notes about unknown columns.

    Raises:
        RecordingError: missing or empty file, a missing or repeated column, no rows.
    """
    reader = csv.reader(read_text(path).splitlines(), delimiter=delimiter)
    try:
        header = [cell.strip() for cell in next(reader, [])]
        rows: Rows = [
            (reader.line_num, dict(zip(header, (cell.strip() for cell in cells), strict=False)))
            for cells in reader
            if any(cell.strip() for cell in cells)
        ]
    except csv.Error as error:
        raise RecordingError(f"{path} line {reader.line_num}: {error}") from None
    named = [column for column in header if column]
    missing = [column for column in required if column not in named]
    if missing:
        what = f"column {', '.join(missing)} missing" if named or rows else "the file is empty"
        raise RecordingError(f"{path} line 1: {what}; expected the columns {delimiter.join(required)}")
    repeated = sorted({column for column in named if named.count(column) > 1})
    if repeated:
        raise RecordingError(f"{path} line 1: column {', '.join(repeated)} stands there more than once")
    if not rows:
        raise RecordingError(f"{path}: zero frames: there is a header but no row below it")
    unknown = [column for column in named if column not in (*required, *optional)]
    return rows, [f"{path} line 1: unknown column {', '.join(unknown)} ignored"] if unknown else []


def parse_number(cells: Cells, column: str) -> float:
    """The number of a cell; NaN for what is none."""
    try:
        return float(cells.get(column, ""))
    except ValueError:
        return float("nan")


def parse_pose(cells: Cells, columns: Sequence[str]) -> tuple[float, RigidTransform]:
    """Time in its column's unit and world_from_body, of time, position, quaternion w, x, y, z; or a ValueError."""
    values = []
    for column in columns:
        text = cells.get(column, "")
        try:
            values.append(float(text))
        except ValueError:
            raise ValueError(f"column {column} is no number: {text!r}") from None
    return check_number(values[0], columns[0]), pose(values[1:4], values[4:8])
