"""Text tables with a header, of bounded size. A row is split into cells when it is asked for."""

import csv
import io
from array import array
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deckline.recording.source import RecordingError, read_data

MOST_ROWS = 4_000_000  # 5 hours at 200 Hz
MOST_COLUMNS = 1_000
MOST_LINE_BYTES = 1 << 16
MOST_FILES = 1_000_000  # that a table may name: 9 hours at 30 Hz
BOM = b"\xef\xbb\xbf"
ALIASES = {
    **dict.fromkeys(("lat", "latitude", "latitude_deg"), "lat_deg"),
    **dict.fromkeys(("lon", "lng", "longitude", "longitude_deg"), "lon_deg"),
    **dict.fromkeys(("alt", "altitude", "altitude_m"), "alt_m"),
}
Cells = Mapping[str, str]  # a row's texts by column


class TextTable:
    """Rows below a header, blank ones left out. Memory is that of the file and 16 bytes a row.

    Args:
        path: UTF-8 text, with or without a byte-order mark.
        delimiter: of cells, one character; a cell that holds it is in double quotes.

    Attributes:
        header: names of the columns; other spellings of latitude, longitude and altitude are lat_deg, lon_deg, alt_m.

    Raises:
        RecordingError: the file cannot be read, is no text, or has too long lines, too many columns or rows.
    """

    def __init__(self, path: Path, delimiter: str) -> None:
        self.path = path
        self._delimiter = delimiter
        self._data = read_data(path).removeprefix(BOM)
        starts = self._find_lines()
        self._starts, self._lines = starts[:1], np.ones(1, np.int64)
        self.header = [ALIASES.get(name.lower(), name) for name in self._split(0)]
        self._starts, self._lines = self._drop_blank(starts)
        self._check_bounds()

    def _find_lines(self) -> NDArray[np.int64]:
        ends = np.flatnonzero(np.frombuffer(self._data, np.uint8) == ord("\n"))
        starts = np.concatenate([[0], ends + 1])
        lengths = np.diff(starts, append=len(self._data))
        if (longest := int(lengths.argmax())) >= 0 and lengths[longest] > MOST_LINE_BYTES:
            self._fail(longest + 1, f"a line of {lengths[longest]:,} bytes; {MOST_LINE_BYTES:,} are the most")
        return starts

    def _drop_blank(self, starts: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Starts and numbers of the lines below the header that hold more than blanks and delimiters."""
        starts = starts[starts < len(self._data)]
        blanks = b" \t\r\n" + self._delimiter.encode()
        filled = np.frombuffer(self._data.translate(bytes(byte not in blanks for byte in range(256))), np.uint8)
        rows = 1 + np.flatnonzero(np.maximum.reduceat(filled, starts)[1:]) if len(starts) else starts
        return starts[rows], rows + 1

    def _check_bounds(self) -> None:
        for count, most, what in ((len(self.header), MOST_COLUMNS, "columns"), (len(self), MOST_ROWS, "rows")):
            if count > most:
                self._fail(1, f"{count:,} {what}; {most:,} are the most")

    def _fail(self, line: int, reason: str) -> None:
        raise RecordingError(f"{self.path} line {line}: {reason}")

    def __len__(self) -> int:
        return len(self._starts)

    def __getitem__(self, row: int) -> tuple[int, Cells]:
        """Number of the line in the file, and the cells by column."""
        return int(self._lines[row]), dict(zip(self.header, self._split(row), strict=False))

    def __iter__(self) -> Iterator[tuple[int, Cells]]:
        return (self[row] for row in range(len(self)))

    def take(self, rows: NDArray[np.bool_]) -> "TextTable":
        """The same table with some of its rows."""
        taken = object.__new__(TextTable)
        vars(taken).update(vars(self), _starts=self._starts[rows], _lines=self._lines[rows])
        return taken

    def texts(self, column: str) -> Iterator[str]:
        """The cells of a column, empty where a row is too short or has no such column."""
        at = self.header.index(column) if column in self.header else len(self.header)
        return (cells[at] if at < len(cells) else "" for cells in map(self._split, range(len(self))))

    def numbers(self, columns: Sequence[str]) -> NDArray[np.float64]:
        """Cells of columns (C) as numbers (N, C); NaN for what is none."""
        at, values = [self.header.index(column) for column in columns], array("d")
        with suppress(ValueError):  # a cell that is no number, a row that is too short
            found = np.loadtxt(
                io.BytesIO(self._data), delimiter=self._delimiter, skiprows=1, usecols=at, comments=None, ndmin=2
            )
            if len(found) == len(self):
                return found
        for row in range(len(self)):
            cells = self._split(row)
            try:
                values.extend([float(cells[index]) for index in at])
            except (ValueError, IndexError):
                values.extend([parse_number(cells[index]) if index < len(cells) else float("nan") for index in at])
        return np.frombuffer(values, np.float64).reshape(len(self), len(at))

    def index_files(self) -> dict[str, int]:
        """Row of each text of the column `file`; a RecordingError for one that is in two rows, or too many."""
        if len(self) > MOST_FILES:
            self._fail(1, f"{len(self):,} rows name files; {MOST_FILES:,} are the most")
        rows: dict[str, int] = {}
        for row, file in enumerate(self.texts("file")):
            if (first := rows.setdefault(file, row)) != row:
                lines = f"lines {self._lines[first]} and {self._lines[row]}"
                raise RecordingError(f"{self.path} {lines}: {file!r} is there twice; delete one row")
        return rows

    def require(self, required: Sequence[str], optional: Sequence[str] = (), hint: str = "") -> list[str]:
        """Notes on columns that are not known.

        Raises:
            RecordingError: a missing or repeated column, or no rows.
        """
        counts = Counter(column for column in self.header if column)
        if missing := [column for column in required if column not in counts]:
            what = f"column {', '.join(missing)} missing" if counts or len(self) else "the file is empty"
            self._fail(1, f"{what}; expected the columns {self._delimiter.join(required)}{hint}")
        if repeated := sorted(column for column, count in counts.items() if count > 1):
            self._fail(1, f"column {', '.join(repeated)} is there more than once")
        if not len(self):
            self._fail(1, "zero frames: there is a header but no row below it")
        unknown = [column for column in counts if column not in (*required, *optional)]
        return [f"{self.path} line 1: unknown column {', '.join(unknown)} ignored"] if unknown else []

    def _split(self, row: int) -> list[str]:
        start = int(self._starts[row])
        end = self._data.find(b"\n", start)
        try:
            text = self._data[start : end if end >= 0 else None].decode()
            plain = '"' not in text
            cells = text.split(self._delimiter) if plain else next(csv.reader([text], delimiter=self._delimiter))
        except UnicodeDecodeError as error:
            raise RecordingError(f"{self.path}: not a text file ({error.reason} in line {self._lines[row]})") from None
        except csv.Error as error:
            raise RecordingError(f"{self.path} line {self._lines[row]}: {error}") from None
        return [cell.strip() for cell in cells]


def read_table(
    path: Path, delimiter: str, required: Sequence[str], optional: Sequence[str] = ()
) -> tuple[TextTable, list[str]]:
    """A table with these columns, and notes on others; errors as those of `TextTable` and `TextTable.require`."""
    table = TextTable(path, delimiter)
    return table, table.require(required, optional)


def parse_number(text: str) -> float:
    """The number of a cell; NaN for what is none."""
    try:
        return float(text)
    except ValueError:
        return float("nan")
