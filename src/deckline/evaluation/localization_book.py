"""Results of whole runs, kept in a file of JSON lines that a stopped command goes on from.

The first line holds the settings, every other one a run.
"""

import json
from pathlib import Path
from typing import Any

from deckline.report.records import keep_whole_lines, read_records

SETTINGS = "settings"  # name of the first line
MOST_SHOWN = 160  # characters of a setting in an error


class Book:
    """Runs by name, in memory and, when there is a folder, in its file.

    Args:
        out: folder, made when missing; None keeps the runs in memory alone.
        name: of the file.
        settings: JSON values that decide the numbers.

    Raises:
        ValueError: the folder holds runs that were made with other settings, or a file of something else.
    """

    def __init__(self, out: Path | None, name: str, settings: dict[str, Any]) -> None:
        self.runs: dict[str, Any] = {}
        self._path: Path | None = None
        if out is None:
            return
        path = out / name
        now = json.loads(json.dumps(settings, allow_nan=False))
        try:
            out.mkdir(parents=True, exist_ok=True)
            path.touch()
            keep_whole_lines(path)
        except OSError as error:
            raise ValueError(f"{out}: cannot be written: {error.strerror or error}") from None
        rows = list(read_records(path))
        if rows:
            _check_same(out, rows[0].get(SETTINGS), now)
        for row in rows[1:]:
            if "run" not in row:
                raise ValueError(f"{path}: the line of {row['file']!r} is no run: choose another folder")
            self.runs[row["file"]] = row["run"]
        self._path = path
        if not rows:
            self._append({"file": SETTINGS, SETTINGS: now})

    def add(self, name: str, run: Any) -> None:
        """Keep one whole run: JSON values.

        Raises:
            ValueError: a number that is not finite.
        """
        self.runs[name] = run
        self._append({"file": name, "run": run})

    def _append(self, row: dict[str, Any]) -> None:
        if self._path is not None:
            with self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row, allow_nan=False, separators=(",", ":")) + "\n")


def _check_same(out: Path, before: Any, now: dict[str, Any]) -> None:
    if not isinstance(before, dict):
        raise ValueError(f"{out} holds a file of something else: choose another folder")
    for key in sorted({*before, *now}):
        if before.get(key) != now.get(key):
            was, wanted = (json.dumps(values.get(key))[:MOST_SHOWN] for values in (before, now))
            raise ValueError(f"{out} holds an evaluation with {key} {was}, not {wanted}: choose another folder")
