"""The files of a run, whole at every moment.

OUT/guidance.jsonl grows by whole lines while the run goes on. Everything that a stopped run needs to go on lies in
OUT/.unfinished: the settings, the pieces of the film, the pictures for the report. When the run ends, guidance.csv,
overlay.mp4 and report.html are made there and renamed into OUT, and .unfinished goes away. Where OUT already holds a
run, the new guidance.jsonl grows in .unfinished as well: until the new run ends, the old one stays as it was.
"""

import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from deckline.report.records import keep_whole_lines, read_records
from deckline.report.video import count_pictures

JSONL, CSV, VIDEO, REPORT = "guidance.jsonl", "guidance.csv", "overlay.mp4", "report.html"
UNFINISHED = ".unfinished"
STATE = "run.json"
OTHER = "choose another folder"


@dataclass(frozen=True)
class RunFolder:
    """Where a run is written and how far it came."""

    out: Path
    jsonl: Path  # in `out`, or in `work` while an older run is still in `out`
    recorded: int  # whole lines that were there when the folder was opened
    filmed: int  # records that need no film any more: all before this one

    @property
    def work(self) -> Path:
        return self.out / UNFINISHED

    def next_piece(self) -> Path:
        """File for the next piece of the film."""
        return self.work / f"film-{len(self.pieces()):04d}.mp4"

    def pieces(self) -> list[Path]:
        """Pieces of the film, in order."""
        return sorted(self.work.glob("film-*.mp4"))

    def publish(self, names: list[str]) -> list[Path]:
        """Rename finished files from `work` into `out`; outputs of an older run that have no successor go away."""
        if self.jsonl.parent == self.work and self.jsonl.exists():
            self.jsonl.replace(self.out / JSONL)
        for name in (CSV, VIDEO, REPORT):
            if name in names:
                (self.work / name).replace(self.out / name)
            else:
                (self.out / name).unlink(missing_ok=True)
        return [self.out / name for name in (REPORT, VIDEO, CSV) if name in names] + [self.out / JSONL]

    def finish(self) -> None:
        """The run is whole: what it needed to go on is removed."""
        shutil.rmtree(self.work)


def start_folder(out: Path, state: dict[str, Any], overwrite: bool = False) -> RunFolder:
    """Start a new run in `out`.

    Args:
        out: folder, made when missing.
        state: what decides the results, label to value: a run is resumed only with the same.
        overwrite: replace an older result in `out`, give up an unfinished run there.

    Raises:
        ValueError: `out` holds results already, or cannot be written.
    """
    work = out / UNFINISHED
    if not overwrite and work.exists():
        raise ValueError(f"{out} holds an unfinished run: go on with --resume, replace it with --overwrite, or {OTHER}")
    if not overwrite and any((out / name).exists() for name in (REPORT, VIDEO, CSV, JSONL)):
        raise ValueError(f"{out} holds the results of another run: replace them with --overwrite, or {OTHER}")
    try:
        out.mkdir(parents=True, exist_ok=True)
        if work.exists():
            shutil.rmtree(work)
        work.mkdir()
        jsonl = (work if (out / JSONL).exists() else out) / JSONL
        jsonl.touch()
        _write_state(work, state)
    except OSError as error:
        raise ValueError(f"{out}: cannot be written: {error.strerror or error}") from None
    return RunFolder(out, jsonl, 0, 0)


def resume_folder(out: Path, state: dict[str, Any]) -> RunFolder:
    """Go on with the run that was left unfinished in `out`; start one where `out` holds none at all.

    Raises:
        ValueError: the run there is whole, was made from another source or with other settings, or cannot be read.
    """
    work = out / UNFINISHED
    if not (work / STATE).exists():
        if (out / JSONL).exists() and not work.exists():
            raise ValueError(f"{out}: nothing to resume: the run there is whole")
        return start_folder(out, state, overwrite=True)
    try:
        before = json.loads((work / STATE).read_text(encoding="utf-8"))
        jsonl = (work if (work / JSONL).exists() else out) / JSONL
        _check_same(out, before, json.loads(json.dumps(state)))
        recorded = keep_whole_lines(jsonl)
    except OSError as error:
        raise ValueError(f"{out}: cannot be resumed: {error.strerror or error}") from None
    except json.JSONDecodeError:
        raise ValueError(f"{out}: cannot be resumed: {UNFINISHED}/{STATE} is damaged") from None
    folder = RunFolder(out, jsonl, recorded, recorded)
    if state["overlay"] != str(True):
        return folder
    return RunFolder(out, jsonl, recorded, _first_unfilmed(folder))


def _first_unfilmed(folder: RunFolder) -> int:
    """Index of the first record whose picture is not in the film: a killed writer loses its last few."""
    pictures = sum(count_pictures(piece) for piece in folder.pieces())
    for index, record in enumerate(read_records(folder.jsonl)):
        if "skipped" in record:
            continue
        if pictures == 0:
            return index
        pictures -= 1
    return folder.recorded


def _check_same(out: Path, before: dict[str, Any], now: dict[str, Any]) -> None:
    for key in sorted({*before, *now}):
        if before.get(key) != now.get(key):
            raise ValueError(
                f"{out}: the unfinished run there has {key} {_short(before.get(key))}, not {_short(now.get(key))}: "
                f"give the same to resume, or leave resume out to start again"
            )


def _short(value: Any) -> str:
    words = json.dumps(value)
    return words if len(words) <= 200 else f"{words[:197]}..."


def _write_state(work: Path, state: dict[str, Any]) -> None:
    temporary = work / f"{STATE}.tmp"
    temporary.write_text(json.dumps(state, indent=1) + "\n", encoding="utf-8")
    temporary.replace(work / STATE)
