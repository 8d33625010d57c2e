"""The rows that `deckline eval dehazing` writes while it works, so that a stopped command goes on.

OUT/dehazing.jsonl: one line for each image and dehazer. OUT/dehazing.settings.json: what they were measured with.
"""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TextIO

import numpy as np

from deckline.atomic import write_atomic
from deckline.evaluation.dehazing_measure import FIGURES, ImageScore, LineScore
from deckline.report.records import keep_whole_lines, read_records

ROWS, SETTINGS = "dehazing.jsonl", "dehazing.settings.json"
DEHAZERS_KEY = "dehazers"  # name -> which model; others may be added to a file, none may change
DIGITS = 6  # significant digits of distances

Settings = dict[str, Any]
RowKey = tuple[str, str, str]  # source, key in it, dehazer


class Rows:
    """Scores so far, in memory and, when there is a folder, in its file: whole lines, flushed one by one.

    Args:
        out: folder, made when missing; None keeps the rows in memory alone.
        settings: plain JSON values that decide the numbers; `dehazers` maps each dehazer's name to its model.

    Raises:
        ValueError: the folder holds rows measured with other settings, or cannot be used.
    """

    def __init__(self, out: Path | None, settings: Settings) -> None:
        self.scores: dict[RowKey, ImageScore] = {}
        self._file: TextIO | None = None
        if out is None:
            return
        try:
            out.mkdir(parents=True, exist_ok=True)
            settings = _merged(out, settings)
            write_atomic(out / SETTINGS, (json.dumps(settings, indent=1) + "\n").encode())
            path = out / ROWS
            path.touch()
            keep_whole_lines(path)
            for row in read_records(path):
                self._keep(_score(row))
            self._file = path.open("a", encoding="utf-8")
        except OSError as error:
            raise ValueError(f"{out}: cannot be written: {error.strerror or error}") from None
        except (KeyError, TypeError) as error:
            raise ValueError(
                f"{out / ROWS}: a line is no row of this command ({error!r}): choose another folder"
            ) from None

    def add(self, score: ImageScore, file: str, seconds: float) -> None:
        """Keep one score.

        Args:
            file: name of the image's file, for people.
            seconds: that dehazing took, for people.
        """
        self._keep(score)
        if self._file is not None:
            self._file.write(json.dumps(_row(score, file, seconds), allow_nan=False, ensure_ascii=False) + "\n")
            self._file.flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._file is not None:
            self._file.close()

    def _keep(self, score: ImageScore) -> None:
        self.scores[(*score.image, score.dehazer)] = score


def _merged(out: Path, settings: Settings) -> Settings:
    """The settings with the dehazers of both runs."""
    path = out / SETTINGS
    now = json.loads(json.dumps(settings))
    if not path.exists():
        if (out / ROWS).exists():
            raise ValueError(f"{out}: {ROWS} is there without {SETTINGS}: choose another folder")
        return now
    try:
        before = json.loads(path.read_text(encoding="utf-8"))
        known = dict(before[DEHAZERS_KEY])
    except (ValueError, KeyError, TypeError):
        raise ValueError(f"{path} is damaged: choose another folder") from None
    models = [(f"model of {name}", known[name], model) for name, model in now[DEHAZERS_KEY].items() if name in known]
    others = [(key, before.get(key), now.get(key)) for key in sorted({*before, *now} - {DEHAZERS_KEY})]
    for what, old, new in (*others, *models):
        if old != new:
            raise ValueError(
                f"{out} holds rows measured with another {what}: {_short(old)}, not {_short(new)}; "
                f"give the same, or choose another folder"
            )
    return now | {DEHAZERS_KEY: known | now[DEHAZERS_KEY]}


def _row(score: ImageScore, file: str, seconds: float) -> dict[str, Any]:
    lines = score.lines
    return {
        "source": score.image[0],
        "key": score.image[1],
        "file": file,
        "dehazer": score.dehazer,
        "visibility_m": None if math.isnan(score.visibility_m) else _finite(score.visibility_m),
        "film": score.film,
        **score.figures,
        "note": score.note,
        "seconds": float(f"{seconds:.4g}"),
        "found": None if lines is None else lines.found,
        "distances_px": None if lines is None else [float(f"{value:.{DIGITS}g}") for value in lines.distances_px],
    }


def _score(row: Mapping[str, Any]) -> ImageScore:
    visibility = row["visibility_m"]
    found = row["found"]
    return ImageScore(
        image=(row["source"], row["key"]),
        dehazer=row["dehazer"],
        visibility_m=math.nan if visibility is None else float(visibility),
        figures={name: row[name] for name in FIGURES if name in row},
        note=row["note"],
        lines=None if found is None else LineScore(found, np.asarray(row["distances_px"], dtype=np.float64)),
        film=row["film"],
    )


def _finite(visibility_m: float) -> float | str:
    """JSON has no infinity: clear air is a word, which float() reads."""
    return "inf" if math.isinf(visibility_m) else visibility_m


def _short(value: Any) -> str:
    words = json.dumps(value)
    return words if len(words) <= 160 else f"{words[:157]}..."
