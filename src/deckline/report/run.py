"""Run the chain over a source and write what a user sees: records, film, report."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from types import FrameType
from typing import Any, BinaryIO

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from deckline.pipeline import FrameResult
from deckline.recording import BadFrame, FrameError, Source, Stream
from deckline.report.overlay import OVERLAY_PX, overlay
from deckline.report.panels import panels
from deckline.report.pictures import PictureSample
from deckline.report.provenance import settings_of
from deckline.report.records import Record, frame_record, read_records, skipped_record, to_line, write_csv
from deckline.report.run_folder import CSV, REPORT, VIDEO, RunFolder, resume_folder, start_folder
from deckline.report.run_report import report_text, run_info
from deckline.report.video import VideoPiece, join
from deckline.types import Flag, Frame, Status

INTERRUPTED, NOTHING_USABLE = 130, 1  # exit codes
PICTURES = "pictures"
RESUMED = Flag("resumed", "the run was interrupted here: the track began anew")
KINDS = (*map(str, Status), "skipped")

Chain = Callable[[Frame], FrameResult]


@dataclass(frozen=True)
class RunSummary:
    """What a run came to."""

    frames: int  # records written, skipped frames included
    counts: dict[str, int]  # by status, and "skipped"
    written: list[Path]
    interrupted: bool

    @property
    def exit_code(self) -> int:
        if self.interrupted:
            return INTERRUPTED
        return NOTHING_USABLE if self.frames == self.counts.get("skipped", 0) else 0


def run(
    source: Stream,
    pipeline: Chain,
    out: Path,
    *,
    overlay: bool = True,
    report: bool = True,
    max_frames: int | None = None,
    resume: bool = False,
    overwrite: bool = False,
) -> RunSummary:
    """Run `pipeline` over `source` and write guidance.jsonl, guidance.csv, overlay.mp4 and report.html into `out`.

    A resumed run begins its track anew: the first record after the break carries the flag "resumed".

    Frames that cannot be used are named on stderr, counted and left out. Ctrl-C ends the run after the frame at hand:
    what was written is whole, and `resume` goes on from there. With `overwrite`, an earlier run in `out` is replaced at
    the end.
    A source without an end is run until Ctrl-C or `max_frames`, and cannot be resumed.

    Args:
        source: frames in their order.
        pipeline: the chain.
        out: folder, made when missing.
        overlay: write overlay.mp4.
        report: write report.html.
        max_frames: stop after so many frames of the source, unusable ones included.
        resume: go on after the last whole line of an interrupted run in `out`.
        overwrite: replace the results of an older run in `out`.

    Raises:
        ValueError: `out` holds results or cannot be written, there is nothing to resume, or not with these settings.
    """
    if max_frames is not None and max_frames < 1:
        raise ValueError(f"max_frames must be at least 1, got {max_frames}")
    if resume and not isinstance(source, Source):
        raise ValueError(f"{source.name}: what was not seen live is gone: leave resume out, or choose another folder")
    total = min((limit for limit in (source.length, max_frames) if limit is not None), default=None)
    settings = settings_of(pipeline)
    state = {"source": source.name, "frames": str(source.length), "overlay": str(overlay)} | settings
    folder = resume_folder(out, state) if resume else start_folder(out, state, overwrite)
    sample = PictureSample(folder.work / PICTURES) if report else None
    counts, interrupted = _process(source, pipeline, folder, sample, total, overlay)
    frames = sum(counts.values())
    interrupted = interrupted and total is not None
    info = run_info(source, settings, frames, total, interrupted)
    written = _publish(folder, sample if report else None, info, counts)
    console = Console(stderr=True, highlight=False, markup=False)
    console.print(f"{frames}{'' if total is None else f' of {total}'} frames: {_counts_text(counts)}")
    if interrupted and isinstance(source, Source):
        console.print("stopped; what was written is whole, and --resume goes on from there")
    else:
        folder.finish()
    return RunSummary(frames, counts, written, interrupted)


def _process(
    source: Stream, pipeline: Chain, folder: RunFolder, sample: PictureSample | None, total: int | None, film: bool
) -> tuple[dict[str, int], bool]:
    """Every frame that is still to be done; counts of all records, and whether Ctrl-C ended it."""
    counts = dict.fromkeys(KINDS, 0)
    for record in read_records(folder.jsonl):
        counts[_kind(record)] += 1
    first = min(folder.filmed, folder.recorded)
    with ExitStack() as stack:
        stopped = stack.enter_context(_noticing_ctrl_c(source))
        progress = stack.enter_context(_progress())
        lines = stack.enter_context(folder.jsonl.open("ab", buffering=0))
        piece = stack.enter_context(VideoPiece(folder.next_piece(), OVERLAY_PX)) if film else None
        task = progress.add_task("frames", total=total, completed=first, counts=_counts_text(counts))
        items = _items(source, first, total)
        try:
            for index, item in enumerate(items, first):
                outcome = _tried(pipeline, item)
                if index >= folder.recorded:
                    outcome = _resumed(outcome) if 0 < index == folder.recorded else outcome
                    counts[_record(lines, outcome)] += 1
                if isinstance(outcome, BadFrame):
                    progress.console.print(
                        f"skipped {outcome.file}: {outcome.reason}", markup=False, highlight=False, soft_wrap=True
                    )
                else:
                    _show(outcome, index, sample, piece)
                progress.update(task, completed=index + 1, counts=_counts_text(counts))
                if stopped.is_set() and index + 1 != total:
                    return counts, True
        except KeyboardInterrupt:
            return counts, True
    return counts, stopped.is_set() and sum(counts.values()) != total


def _tried(pipeline: Chain, item: Frame | BadFrame) -> FrameResult | BadFrame:
    """One frame through the chain; a frame that a stage refuses is a bad frame, and the run goes on."""
    if isinstance(item, BadFrame):
        return item
    try:
        return pipeline(item)
    except ValueError as error:
        return BadFrame(item.file, " ".join(str(error).split()))


def _resumed(outcome: FrameResult | BadFrame) -> FrameResult | BadFrame:
    """The first result after a break of the run, whose track knows nothing of what was before."""
    if isinstance(outcome, BadFrame) or outcome.track is None:
        return outcome
    flags = (*outcome.track.flags, RESUMED)
    return replace(
        outcome, track=replace(outcome.track, flags=flags), guidance=replace(outcome.guidance, flags=flags)
    )  # fmt: skip


def _record(lines: BinaryIO, outcome: FrameResult | BadFrame) -> str:
    """Append one line in a single write; returns what it counts as."""
    record = skipped_record(outcome) if isinstance(outcome, BadFrame) else frame_record(outcome)
    lines.write(to_line(record).encode())
    return _kind(record)


def _show(result: FrameResult, index: int, sample: PictureSample | None, piece: VideoPiece | None) -> None:
    if sample is None and piece is None:
        return
    pictures = panels(result)
    if sample is not None:
        sample.add(index, pictures)
    if piece is not None:
        piece.add(overlay(result.frame, result.guidance, pictures), result.frame.time_s)


def _publish(
    folder: RunFolder, sample: PictureSample | None, info: dict[str, str], counts: dict[str, int]
) -> list[Path]:
    """Make the files that need the whole run, then rename them to where they belong."""
    names = [CSV]
    write_csv(folder.work / CSV, read_records(folder.jsonl))
    if join(folder.pieces(), folder.work / VIDEO):
        names.append(VIDEO)
    if sample is not None:
        text = report_text(folder.jsonl, sample, info, counts)
        (folder.work / REPORT).write_text(text, encoding="utf-8")
        names.append(REPORT)
    return folder.publish(names)


def _items(source: Stream, first: int, total: int | None) -> Iterator[Frame | BadFrame]:
    """Items `first` to `total` of the source. From the beginning it is iterated, as films are read best that way."""
    if first == 0 or not isinstance(source, Source):
        yield from islice(source.items(), total)
        return
    for index in range(first, len(source) if total is None else total):
        try:
            yield source.load(index)
        except FrameError as error:
            yield BadFrame(error.file, error.reason)


def _kind(record: Record) -> str:
    return "skipped" if "skipped" in record else str(record["status"])


def _counts_text(counts: dict[str, int]) -> str:
    return ", ".join(f"{count} {kind}" for kind, count in counts.items())


def _progress() -> Progress:
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[counts]}", markup=False),
        console=Console(stderr=True),
    )


@contextmanager
def _noticing_ctrl_c(source: Stream) -> Iterator[threading.Event]:
    """An event that the first Ctrl-C sets, so that the frame at hand is finished; the second one interrupts.

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
