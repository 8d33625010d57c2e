"""Run the chain over a source and write what a user sees: records, film, report."""

import signal
import threading
from collections.abc import Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from deckline.files import lock_folder, printable
from deckline.flight import FrameResult
from deckline.interrupts import on_first_signal
from deckline.recording import BadFrame, Recording, Source
from deckline.report.provenance import Chain, settings_of
from deckline.report.records import SKIPPED, FlightView, Record, frame_record, skipped_record
from deckline.report.run_folder import RunFolder, check_apart, resume_folder, start_folder
from deckline.report.writer import RunWriter
from deckline.types import Diagnostic, Frame, Reason

INTERRUPTED, NOTHING_USABLE = 130, 1  # exit codes
RESUMED = Diagnostic(Reason.RESUMED, "the run was interrupted here: the track began anew")


@dataclass(frozen=True)
class RunSummary:
    """What a run came to."""

    frames: int
    """Records written, skipped frames included."""
    counts: dict[str, int]
    """Records by status, and "skipped"."""
    written: list[Path]
    """The files of the run."""
    interrupted: bool
    """Ctrl-C ended it before its last frame."""

    @property
    def exit_code(self) -> int:
        if self.interrupted:
            return INTERRUPTED
        return NOTHING_USABLE if self.frames == self.counts.get(SKIPPED, 0) else 0


def run(
    source: Source,
    chain: Chain,
    out: Path,
    *,
    max_frames: int | None = None,
    resume: bool = False,
    overwrite: bool = False,
    views: tuple[FlightView, ...] = (),
) -> RunSummary:
    """Run `chain` over `source`; write guidance.jsonl, guidance.csv, overlay.mp4, report.html and run.toml into `out`.

    With the film comes dehazing.jsonl: what dehazing found in its frames. Frames that cannot be used are named on
    stderr, counted and left out. Ctrl-C ends the run after the current frame: what is written is whole, and `resume`
    goes on from there. A resumed run begins its track anew: the first result after the break carries the flag
    "resumed". A source without an end is run until Ctrl-C or `max_frames`, and cannot be resumed.

    Args:
        source: frames in their order.
        chain: a flight.
        out: folder, made when missing.
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
    state = {"source": source.name, "frames": str(source.length)} | settings_of(chain)
    if isinstance(source, Recording):
        check_apart(Path(source.name), out)
    with lock_folder(out):
        folder = resume_folder(out, state) if resume else start_folder(out, state, overwrite)
        return _run(source, chain, folder, total, views)


def _run(
    source: Source, chain: Chain, folder: RunFolder, total: int | None, views: tuple[FlightView, ...]
) -> RunSummary:
    """Everything of `run` that happens while the folder is its own."""
    try:
        with closing(RunWriter(folder, source, chain)) as writer:
            stopped = _fly(source, chain, folder, writer, total, views)
        written = writer.publish(total, stopped and total is not None)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"{folder.jsonl} is whole, film and report are not") from None
    console = Console(stderr=True, highlight=False, markup=False, soft_wrap=True)
    count = f"{writer.frames}" if total is None else f"{writer.frames} of {total}"
    console.print(f"{count} frames: {_format_counts(writer.counts)}")
    for hint in writer.hints:
        console.print(printable(hint))
    if stopped and isinstance(source, Recording):
        console.print("stopped; what was written is whole, and --resume goes on from there")
    else:
        folder.finish()
    return RunSummary(writer.frames, writer.counts, written, stopped and total is not None)


def _fly(
    source: Source,
    chain: Chain,
    folder: RunFolder,
    writer: RunWriter,
    total: int | None,
    views: tuple[FlightView, ...],
) -> bool:
    """Process every frame that is still missing; returns whether Ctrl-C ended it too early."""
    first, is_resumed = min(folder.filmed, folder.recorded), folder.recorded > 0
    with ExitStack() as stack:
        stopped = _catch_ctrl_c(source, stack)
        progress = stack.enter_context(_make_progress())
        task = progress.add_task("frames", total=total, completed=first, counts=_format_counts(writer.counts))
        try:
            for index, item in enumerate(_read_items(source, first, total), first):
                outcome = _apply(chain, item)
                if is_resumed and index >= folder.recorded and isinstance(outcome, FrameResult):
                    outcome, is_resumed = _flag_resumed(outcome), False
                if index >= folder.recorded:
                    result, record = _make_record(outcome, chain)
                    writer.write(record)
                    for view in views:
                        view(result, record)
                if isinstance(outcome, BadFrame):
                    words = printable(f"skipped {outcome.file}: {outcome.reason}")
                    progress.console.print(words, markup=False, highlight=False, soft_wrap=True)
                else:
                    writer.draw(index, outcome)
                progress.update(task, completed=index + 1, counts=_format_counts(writer.counts))
                if stopped.is_set() and index + 1 != total:
                    return True
        except KeyboardInterrupt:
            return True
    return stopped.is_set() and writer.frames != total


def _catch_ctrl_c(source: Source, stack: ExitStack) -> threading.Event:
    """An event that the first Ctrl-C sets, so that the current frame is finished; a live source's wait ends too."""
    event = threading.Event()

    def stop() -> None:
        event.set()
        source.stop()

    if threading.current_thread() is threading.main_thread():  # elsewhere the caller watches for signals
        stack.enter_context(on_first_signal(stop, signal.SIGINT))
    return event


def _read_items(source: Source, first: int, total: int | None) -> Iterator[Frame | BadFrame]:
    """Items `first` to `total` of the source. From the beginning it is iterated, as films are read best that way."""
    if first == 0 or not isinstance(source, Recording):
        yield from islice(source.items(), total)
        return
    yield from map(source.item, range(first, len(source) if total is None else total))


def _apply(chain: Chain, item: Frame | BadFrame) -> FrameResult | BadFrame:
    """One frame through the chain; a frame that a stage refuses is a bad frame, and the run goes on."""
    if isinstance(item, BadFrame):
        return item
    try:
        return chain(item)
    except ValueError as error:
        return BadFrame(item.file, " ".join(str(error).split()))


def _make_record(outcome: FrameResult | BadFrame, chain: Chain) -> tuple[FrameResult | None, Record]:
    """The result, if there is one, and what is written about the frame."""
    if isinstance(outcome, BadFrame):
        return None, skipped_record(outcome)
    return outcome, frame_record(outcome, chain.config.approach)


def _flag_resumed(result: FrameResult) -> FrameResult:
    """The first result after a break of the run, whose track knows nothing of the frames before it."""
    if result.track is None:
        return result
    track = replace(result.track, flags=(*result.track.flags, RESUMED))
    return replace(result, track=track, guidance=result.guidance.with_flag(RESUMED))


def _format_counts(counts: dict[str, int]) -> str:
    return ", ".join(f"{count} {kind}" for kind, count in counts.items() if count) or "none"


def _make_progress() -> Progress:
    words, counts = TextColumn("{task.description}"), TextColumn("{task.fields[counts]}", markup=False)
    return Progress(
        words, BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(), counts, console=Console(stderr=True)
    )
