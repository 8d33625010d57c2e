"""Rows of an evaluation, stored in a file that a stopped command resumes from.

The file holds JSON lines: {"settings": ...} with what decides the numbers, then {"key": [...], "row": ...} for every
row. NaN and infinity are written as Python's json writes them.
"""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from deckline.files import check_regular

MOST_SHOWN = 160  # characters of a setting in an error
Key = tuple[str | int, ...]


class Store:
    """Rows by key, in memory and, when there is a folder, in its file.

    As a context manager it reports after Ctrl-C what was stored.

    Args:
        out: folder, made when missing; None: rows in memory alone.
        name: of the file.
        settings: JSON values that decide the numbers.
        extendable: the setting, a mapping, that may have other entries in a later command; none may change.

    Raises:
        ValueError: the folder holds rows that were made with other settings, or cannot be used.
    """

    def __init__(self, out: Path | None, name: str, settings: Mapping[str, Any], extendable: str | None = None) -> None:
        self.rows: dict[Key, Any] = {}
        self.path = None if out is None else out / name
        self._extendable = extendable
        plain = json.loads(json.dumps(settings))
        if self.path is None:
            return
        known: dict[str, Any] | None = None
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self.path.touch()
            for line in _whole_lines(self.path):
                if "settings" in line:
                    known = line["settings"]
                else:
                    self.rows[tuple(line["key"])] = line["row"]
            parts = () if known is None else (known, known.get(str(extendable), {}))
            if not all(isinstance(part, dict) for part in parts):
                raise TypeError
        except OSError as error:
            raise ValueError(f"{out}: cannot be written: {error.strerror or error}") from None
        except (ValueError, LookupError, TypeError, AttributeError, RecursionError):
            raise ValueError(f"{self.path} holds something else: choose another folder") from None
        merged = plain if known is None else self._merge(known, plain)
        if merged != known:
            self._append({"settings": merged})

    def add(self, key: Key, row: Any) -> None:
        """Store one row: JSON values."""
        self.rows[key] = row
        self._append({"key": key, "row": row})

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if isinstance(error, KeyboardInterrupt):
            lost = "nothing was written; commands with --out FOLDER resume where they were stopped"
            stored = f"{self.path} holds what was measured; the same command resumes there"
            raise KeyboardInterrupt(lost if self.path is None else stored) from None

    def _append(self, line: dict[str, Any]) -> None:
        if self.path is not None:
            with self.path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(line, ensure_ascii=False, separators=(",", ":")) + "\n")

    def _merge(self, known: dict[str, Any], settings: dict[str, Any]) -> dict[str, Any]:
        """The settings of both commands, which agree in all that both give."""
        free = {self._extendable}
        pairs = [(name, known.get(name), settings.get(name)) for name in sorted({*known, *settings} - free)]
        if self._extendable is not None:
            before, after = known.get(self._extendable, {}), settings[self._extendable]
            pairs += [(f"{self._extendable} {name}", before[name], after[name]) for name in after if name in before]
            settings = settings | {self._extendable: before | after}
        for name, old, new in pairs:
            if old != new:
                was, wanted = (json.dumps(value)[:MOST_SHOWN] for value in (old, new))
                raise ValueError(f"{self.path} was made with {name} {was}, not {wanted}: choose another folder")
        return settings


def _whole_lines(path: Path) -> Iterator[dict[str, Any]]:
    """Every line of the file; what a killed writer left unfinished at its end is cut off."""
    end = 0
    check_regular(path)
    with path.open("r+b") as file:
        for line in file:
            if not line.endswith(b"\n"):
                break
            yield json.loads(line)
            end += len(line)
        file.truncate(end)
