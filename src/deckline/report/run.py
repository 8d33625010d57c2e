"""Run the chain over a recording and write what a user sees: records, film, report."""

import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from types import FrameType
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from deckline.config import RunConfig
from deckline.config_file import to_toml_text
from deckline.files import lock_folder, printable
from deckline.flight import FrameResult
from deckline.recording import BadFrame, FrameError, Recording, Source
from deckline.report.figures import count_reasons
from deckline.report.film import OverlayWriter, join_dehazing
from deckline.report.html import STATUSES, Pictures, report_html
from deckline.report.provenance import Settings, run_info, settings_of
from deckline.report.records import (
    Record,
    View,
    frame_record,
    lookup,
    read_records,
    skipped_record,
    to_line,
    write_csv,
)
from deckline.report.run_folder import (
    CONFIG,
    CSV,
    JSONL,
    REPORT,
    VIDEO,
    PictureSample,
    RunFolder,
    check_apart,
    resume_folder,
    start_folder,
)
from deckline.report.video import join
from deckline.types import Diagnostic, Frame, Reason

INTERRUPTED, NOTHING_USABLE = 130, 1  # exit codes
RESUMED = Diagnostic(Reason.RESUMED, "the run was interrupted here: the track began anew")
REPORT_RECORDS = 2000  # records that plots are made of, at most, besides those with pictures
REPORT_SKIPPED = 200  # skipped frames always among them, at most

Chain = Callable[[Frame], FrameResult]
DEFAULTS = RunConfig()
Counts = dict[str, int]


@dataclass(frozen=True)
class RunSummary:
    """What a run came to."""

    frames: int  # records written, skipped frames included
    counts: Counts  # by status, and "skipped"
    written: list[Path]
    interrupted: bool

    @property
    def exit_code(self) -> int:
        if self.interrupted:
            return INTERRUPTED
        return NOTHING_USABLE if self.frames == self.counts.get("skipped", 0) else 0


def run(
    source: Source,
    chain: Chain,
    out: Path,
    *,
    config: RunConfig = DEFAULTS,
    max_frames: int | None = None,
    resume: bool = False,
    overwrite: bool = False,
    views: tuple[View, ...] = (),
) -> RunSummary:
    """Run `chain` over `source`; write guidance.jsonl, guidance.csv, overlay.mp4, report.html and run.toml into `out`.

    Frames that cannot be used are named on stderr, counted and left out. Ctrl-C ends the run after the current frame:
    what is written is whole, and `resume` goes on from there. A resumed run begins its track anew: the first record
    after the break carries the flag "resumed". A source without an end is run until Ctrl-C or `max_frames`, and cannot
    be resumed.

    Args:
        source: frames in their order.
        chain: a flight.
        out: folder, made when missing.
        config: what the flight is built from.
        max_frames: stop after so many frames of the source, unusable ones included.
        resume: go on after the last whole line of an interrupted run in `out`.
        overwrite: replace the results of an older run in `out`, at the end.
        views: watch each frame of this run, those before a resumed one's break left out.

    Raises:
        ValueError: `out` holds results or cannot be written, there is nothing to resume, or not with these settings.
    """
    if max_frames is not None and max_frames < 1:
        raise ValueError(f"max_frames must be at least 1, got {max_frames}")
    if resume and not isinstance(source, Recording):
        raise ValueError(f"{source.name}: frames missed live are gone: leave resume out, or choose another folder")
    total = min((limit for limit in (source.length, max_frames) if limit is not None), default=None)
    settings = settings_of(chain)
    state = {"source": source.name, "frames": str(source.length)} | settings
    if isinstance(source, Recording):
        check_apart(Path(source.name), out)
    with lock_folder(out):
        folder = resume_folder(out, state) if resume else start_folder(out, state, overwrite)
        return _fly(source, chain, folder, total, config, settings, views)


def _fly(
    source: Source,
    chain: Chain,
    folder: RunFolder,
    total: int | None,
    config: RunConfig,
    settings: Settings,
    views: tuple[View, ...],
) -> RunSummary:
    """Everything of `run` that happens while the folder is its own."""
    sample = PictureSample(folder.work / "pictures")
    try:
        counts, stopped = _process(source, chain, folder, sample, total, config, views)
        frames = sum(counts.values())
        info = run_info(source, frames, total, stopped and total is not None) | settings
        written = _publish(folder, sample, info, counts, config)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"{folder.jsonl} is whole, film and report are not") from None
    console = Console(stderr=True, highlight=False, markup=False, soft_wrap=True)
    console.print(f"{info['frames'].partition(',')[0]} frames: {_format_counts(counts)}")
    if reason := explain_missing(read_records(folder.out / JSONL), frames - counts["skipped"]):
        console.print(printable(reason))
    if stopped and isinstance(source, Recording):
        console.print("stopped; what was written is whole, and --resume goes on from there")
    else:
        folder.finish()
    return RunSummary(frames, counts, written, stopped and total is not None)


def explain_missing(records: Iterable[Record], used: int) -> str:
    """One line that says why most of the used frames have no distances; empty where most have."""
    frames = (record for record in records if "skipped" not in record)
    reasons = count_reasons(frame for frame in frames if lookup(frame, ("guidance", "height_above_deck_m")) is None)
    missing = sum(count for _, count in reasons)
    return f"no distances in {missing} of {used} frames; most often: {reasons[0][0]}" if 2 * missing > used else ""


def _process(
    source: Source,
    chain: Chain,
    folder: RunFolder,
    sample: PictureSample,
    total: int | None,
    config: RunConfig,
    views: tuple[View, ...],
) -> tuple[Counts, bool]:
    """Process every frame that is still missing.

    Returns: counts of all records, and whether Ctrl-C ended it too early.
    """
    counts = dict.fromkeys(STATUSES, 0)
    for record in read_records(folder.jsonl):
        counts[_kind_of(record)] += 1
    first = min(folder.filmed, folder.recorded)
    with ExitStack() as stack:
        stopped = stack.enter_context(_catch_ctrl_c(source))
        progress = stack.enter_context(_make_progress())
        lines = stack.enter_context(folder.jsonl.open("ab", buffering=0))
        film = stack.enter_context(closing(OverlayWriter(folder, sample)))
        task = progress.add_task("frames", total=total, completed=first, counts=_format_counts(counts))
        try:
            for index, item in enumerate(_read_items(source, first, total), first):
                outcome = _apply(chain, item)
                if 0 < index == folder.recorded:
                    outcome = _flag_resumed(outcome)
                record = _make_record(outcome, config)
                if index >= folder.recorded:
                    lines.write(to_line(record).encode())  # in a single write: a kill cuts off one line at most
                    counts[_kind_of(record)] += 1
                    for view in views:
                        view(None if isinstance(outcome, BadFrame) else outcome, record)
                if isinstance(outcome, BadFrame):
                    words = printable(f"skipped {outcome.file}: {outcome.reason}")
                    progress.console.print(words, markup=False, highlight=False, soft_wrap=True)
                else:
                    film.add(index, outcome)
                progress.update(task, completed=index + 1, counts=_format_counts(counts))
                if stopped.is_set() and index + 1 != total:
                    return counts, True
        except KeyboardInterrupt:
            return counts, True
    return counts, stopped.is_set() and sum(counts.values()) != total


def _read_items(source: Source, first: int, total: int | None) -> Iterator[Frame | BadFrame]:
    """Items `first` to `total` of the source. From the beginning it is iterated, as films are read best that way."""
    if first == 0 or not isinstance(source, Recording):
        yield from islice(source.items(), total)
        return
    for index in range(first, len(source) if total is None else total):
        try:
            yield source.load(index)
        except FrameError as error:
            yield BadFrame(error.file, error.reason)


def _apply(chain: Chain, item: Frame | BadFrame) -> FrameResult | BadFrame:
    """One frame through the chain; a frame that a stage refuses is a bad frame, and the run goes on."""
    if isinstance(item, BadFrame):
        return item
    try:
        return chain(item)
    except ValueError as error:
        return BadFrame(item.file, " ".join(str(error).split()))


def _flag_resumed(outcome: FrameResult | BadFrame) -> FrameResult | BadFrame:
    """The first result after a break of the run, whose track knows nothing of the frames before it."""
    if isinstance(outcome, BadFrame) or outcome.track is None:
        return outcome
    track = replace(outcome.track, flags=(*outcome.track.flags, RESUMED))
    guidance = replace(outcome.guidance, flags=(*outcome.guidance.flags, RESUMED))
    return replace(outcome, track=track, guidance=guidance)


def _publish(folder: RunFolder, sample: PictureSample, info: Settings, counts: Counts, config: RunConfig) -> list[Path]:
    """Make the files that need the whole run, then rename them to where they belong."""
    names = [CSV, REPORT, CONFIG]
    (folder.work / CONFIG).write_text(to_toml_text(config), encoding="utf-8")
    _complete_records(folder)
    write_csv(folder.work / CSV, read_records(folder.jsonl))
    if join(folder.pieces(), folder.work / VIDEO):
        names.append(VIDEO)
    records, pictures = _choose_records(folder.jsonl, sample, sum(counts.values()))
    (folder.work / REPORT).write_text(report_html(info, records, pictures, counts), encoding="utf-8")
    return folder.publish(names)


def _complete_records(folder: RunFolder) -> None:
    """Join the records with what dehazing told, which the film's thread learned after they were written."""
    joined = folder.work / "joined.jsonl"
    with joined.open("wb") as file:
        for record in join_dehazing(read_records(folder.jsonl), read_records(folder.dehazed)):
            file.write(to_line(record).encode())
    joined.replace(folder.jsonl)


def _choose_records(jsonl: Path, sample: PictureSample, count: int) -> tuple[list[Record], Pictures]:
    """Records for the report, whose number does not grow with the run, and the pictures that belong to them."""
    kept = set(sample.kept())
    step = max(-(-count // REPORT_RECORDS), 1)
    records: list[Record] = []
    pictures: Pictures = {}
    skipped = 0
    for index, record in enumerate(read_records(jsonl)):
        skipped += "skipped" in record
        listed = "skipped" in record and skipped <= REPORT_SKIPPED
        if index in kept:
            pictures[len(records)] = sample.read(index)
        if index % step == 0 or index in kept or listed:
            records.append(record)
    return records, pictures


def _make_record(outcome: FrameResult | BadFrame, config: RunConfig) -> Record:
    return skipped_record(outcome) if isinstance(outcome, BadFrame) else frame_record(outcome, config.approach)


def _kind_of(record: Record) -> str:
    return "skipped" if "skipped" in record else str(record["status"])


def _format_counts(counts: Counts) -> str:
    return ", ".join(f"{count} {kind}" for kind, count in counts.items() if count) or "none"


def _make_progress() -> Progress:
    words, counts = TextColumn("{task.description}"), TextColumn("{task.fields[counts]}", markup=False)
    return Progress(
        words, BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(), counts, console=Console(stderr=True)
    )


@contextmanager
def _catch_ctrl_c(source: Source) -> Iterator[threading.Event]:
    """An event that the first Ctrl-C sets, so that the current frame is finished; the second one interrupts.

    A source that waits for its next frame is told to end the wait.
    """
    event = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield event  # only the main thread may watch for signals; elsewhere the caller does
        return
    before: Any = signal.getsignal(signal.SIGINT)

    def notice(_number: int, _frame: FrameType | None) -> None:
        event.set()
        source.stop()
        signal.signal(signal.SIGINT, before)

    signal.signal(signal.SIGINT, notice)
    try:
        yield event
    finally:
        signal.signal(signal.SIGINT, before)
