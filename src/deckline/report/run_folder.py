"""The files of a run, whole at every moment.

OUT/guidance.jsonl grows by whole lines during the run. OUT/.unfinished holds all that a stopped run needs to go on:
the settings, the pieces of the film, the pictures for the report. When the run ends, the other files are made there and
renamed into OUT, and .unfinished is removed. Where OUT already holds a run, the new guidance.jsonl grows in .unfinished
too: until the new run ends, the old one stays as it was.
"""

import json
import os
import shutil
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from deckline.atomic import write_atomic
from deckline.files import MOST_CONFIG_BYTES, parse_plain, read_regular
from deckline.recording.images import encode_image
from deckline.report.overlay import Panels
from deckline.report.provenance import Settings
from deckline.report.records import keep_whole_lines, kind_of, read_records
from deckline.report.video import count_pictures

JSONL, CSV, VIDEO, REPORT, CONFIG = "guidance.jsonl", "guidance.csv", "overlay.mp4", "report.html", "run.toml"
DEHAZING = "dehazing.jsonl"  # what dehazing found in each of the film's frames
MADE_AT_THE_END = (REPORT, VIDEO, CSV, DEHAZING, CONFIG)
UNFINISHED = ".unfinished"
STATE = "run.json"
OTHER = "choose another folder"
MOST_PICTURES = 60
JPEG_QUALITY = 78


@dataclass(frozen=True)
class RunFolder:
    """Where a run is written, and what of it is there already."""

    out: Path
    """The folder."""
    jsonl: Path
    """guidance.jsonl: in `out`, or in `work` while an older run is still in `out`."""
    recorded: int = 0
    """Whole lines when the folder is opened."""
    filmed: int = 0
    """Index of the first record whose picture the film lacks."""
    pictures: int = 0
    """Pictures of the film before that record."""
    counts: Mapping[str, int] = field(default_factory=dict)
    """These records by status, and "skipped"."""

    @property
    def work(self) -> Path:
        return self.out / UNFINISHED

    @property
    def dehazing(self) -> Path:
        """Lines of dehazing.jsonl while the film grows: one for each of its pictures."""
        return self.work / "film.jsonl"

    def pieces(self) -> list[Path]:
        """Pieces of the film, in order."""
        return sorted(self.work.glob("film-*.mp4"))

    def publish(self, names: list[str]) -> list[Path]:
        """Rename finished files from `work` into `out`; outputs of an older run that have no successor go away."""
        self.jsonl.replace(self.out / JSONL)
        for name in MADE_AT_THE_END:
            if name in names:
                (self.work / name).replace(self.out / name)
            else:
                (self.out / name).unlink(missing_ok=True)
        return [self.out / name for name in (*MADE_AT_THE_END, JSONL) if name in (*names, JSONL)]

    def finish(self) -> None:
        """Remove what the run needed to go on: it is complete."""
        shutil.rmtree(self.work)


def start_folder(out: Path, state: Settings, overwrite: bool = False) -> RunFolder:
    """Start a new run in `out`.

    Args:
        out: folder, made when missing.
        state: what decides the results, label to value: a run is resumed only with the same.
        overwrite: replace an older result in `out`, give up an unfinished run there.

    Raises:
        ValueError: `out` holds results already, with `overwrite` what no run wrote, or cannot be written.
    """
    work = out / UNFINISHED
    if overwrite:
        _check_ours(out)
    elif work.exists():
        raise ValueError(f"{out} holds an unfinished run: go on with --resume, replace it with --overwrite, or {OTHER}")
    elif any(os.path.lexists(out / name) for name in (*MADE_AT_THE_END, JSONL)):
        raise ValueError(f"{out} holds the results of another run: replace them with --overwrite, or {OTHER}")
    try:
        out.mkdir(parents=True, exist_ok=True)
        if work.exists():
            shutil.rmtree(work)
        work.mkdir()
        jsonl = (work if (out / JSONL).exists() else out) / JSONL
        jsonl.touch()
        write_atomic(work / STATE, json.dumps(state, indent=1).encode())
    except OSError as error:
        raise ValueError(f"{out}: cannot be written: {error.strerror or error}") from None
    return RunFolder(out, jsonl)


def resume_folder(out: Path, state: Settings) -> RunFolder:
    """Go on with the unfinished run in `out`; start one where `out` holds none at all.

    Raises:
        ValueError: the run there is whole, was made from another source or with other settings, or cannot be read.
    """
    work = out / UNFINISHED
    if not (work / STATE).exists():
        if (out / JSONL).exists() and not work.exists():
            raise ValueError(f"{out}: nothing to resume: the run there is whole")
        return start_folder(out, state, overwrite=work.exists())
    try:
        _check_same(out, _read_state(work / STATE), state)
        _check_ours(out)
        jsonl = (work if (work / JSONL).exists() else out) / JSONL
        recorded = keep_whole_lines(jsonl)
    except OSError as error:
        raise ValueError(f"{out}: cannot be resumed: {error.strerror or error}") from None
    return _review(RunFolder(out, jsonl, recorded))


def check_apart(source: Path, out: Path) -> None:
    """Refuse a source that the results would replace, with a ValueError."""
    if source.resolve() in [(out / name).resolve() for name in (*MADE_AT_THE_END, JSONL)]:
        raise ValueError(f"{source}: the results would replace it: {OTHER} than {out}")


def _check_ours(out: Path) -> None:
    """Refuse to replace links, and what no run wrote: a run leaves guidance.jsonl, or its state while unfinished.

    Raises:
        ValueError: names the first such file.
    """
    is_run = (out / JSONL).is_file() or (out / UNFINISHED / STATE).is_file()
    for path in (out / name for name in (UNFINISHED, *MADE_AT_THE_END, JSONL)):
        if path.is_symlink() or (path.exists() and not is_run):
            raise ValueError(f"{path} is of no run of deckline and is not replaced: {OTHER}")


def _read_state(path: Path) -> Settings:
    try:
        state: Settings = parse_plain(json.loads, read_regular(path, MOST_CONFIG_BYTES).decode())
    except ValueError:
        state = {}
    if not isinstance(state, dict) or not state:
        raise ValueError(f"{path.parent.parent}: cannot be resumed: {UNFINISHED}/{STATE} is damaged")
    return state


def _review(folder: RunFolder) -> RunFolder:
    """The folder with its records counted; `filmed` is the first whose picture is not in the film.

    A killed writer loses its last few pictures.
    """
    made, pictures = sum(count_pictures(piece) for piece in folder.pieces()), 0
    filmed, counts = folder.recorded, Counter[str]()
    for index, record in enumerate(read_records(folder.jsonl)):
        counts[kind_of(record)] += 1
        if "skipped" not in record and pictures < made:
            pictures += 1
        elif "skipped" not in record:
            filmed = min(filmed, index)
    return RunFolder(folder.out, folder.jsonl, folder.recorded, filmed, pictures, counts)


def _check_same(out: Path, before: Settings, now: Settings) -> None:
    for key in sorted({*before, *now}):
        old, new = (str(state.get(key, "unset")).splitlines() for state in (before, now))
        if old != new:
            was, given = (", ".join(line for line in a if line not in b) for a, b in ((old, new), (new, old)))
            raise ValueError(
                f"{out}: the unfinished run there has {key} {was}, not {given}: "
                f"give the same to resume, or start again with --overwrite"
            )


class PictureSample:
    """Small pictures for the report: those of every n-th frame; n doubles whenever there are too many.

    So any run length is spread evenly, and pictures need not stay in memory.

    Args:
        folder: where the pictures lie; those of an interrupted run are taken over.
    """

    def __init__(self, folder: Path) -> None:
        folder.mkdir(exist_ok=True)
        self._folder = folder
        self._every = 1
        self._indices = {int(path.stem) for path in folder.glob("*.marked") if path.stem.isdigit()}
        while len(self._indices) > 1 and all(index % (2 * self._every) == 0 for index in self._indices):
            self._every *= 2

    def add(self, index: int, panels: Panels) -> None:
        """Offer the pictures of record `index`; a record offered before is written again."""
        if index % self._every:
            return
        for path, image in zip(self._files(index), (panels.hazy, panels.marked), strict=True):
            path.write_bytes(encode_image(image, "jpg", JPEG_QUALITY))
        self._indices.add(index)
        while len(self._indices) > MOST_PICTURES:
            self._every *= 2
            for dropped in [index for index in self._indices if index % self._every]:
                self._indices.remove(dropped)
                for path in self._files(dropped):
                    path.unlink(missing_ok=True)

    def indices(self) -> list[int]:
        """Indices of the records whose pictures it has, in order."""
        return sorted(self._indices)

    def read(self, index: int) -> tuple[bytes, bytes]:
        """JPEG files of such a record: hazy, and dehazed with the lines."""
        hazy, marked = self._files(index)
        return hazy.read_bytes(), marked.read_bytes()

    def _files(self, index: int) -> tuple[Path, Path]:
        return self._folder / f"{index:09d}.hazy", self._folder / f"{index:09d}.marked"
