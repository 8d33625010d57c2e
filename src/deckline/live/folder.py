"""The run folder of a live session: guidance.jsonl while it flies, the other files at its end."""

import shutil
import socket
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path

from deckline.flight import Flight
from deckline.live.datagrams import parse_host_port
from deckline.live.mailbox import BackgroundWriter
from deckline.live.messages import LIVE_COLUMNS
from deckline.live.pipeline import Outputs
from deckline.live.recorder import FrameFolder
from deckline.live.source import LiveSource
from deckline.live.tally import Log, Tally
from deckline.report.provenance import settings_of
from deckline.report.records import Record, to_line
from deckline.report.run_folder import start_folder
from deckline.report.writer import RunWriter
from deckline.types import Frame

RECORDING = "recording"  # folder of the frames
WAITING_LINES, WAITING_FRAMES = 1000, 16  # for the disk; a 720p frame takes 2.8 MB


@contextmanager
def open_output(to: str, log: Log) -> Iterator[Callable[[Record], None]]:
    """Sends records as JSON lines: to "-", stdout, or to udp://HOST:PORT, one a datagram.

    A datagram that the network does not take is lost, and `log` gets a line, at most one every `REPORT_EVERY_S`.

    Raises:
        ValueError: neither.
    """
    if to == "-":
        yield _print_record
        return
    address, unsent = parse_host_port(to), Tally(f"messages not sent to {to}", log)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as output, closing(unsent):

        def send(record: Record) -> None:
            try:
                output.sendto(to_line(record).encode(), address)
            except OSError as error:
                unsent.add(error.strerror or str(error))

        yield send


def _print_record(record: Record) -> None:
    print(to_line(record), end="", flush=True)


class FlightRecorder:
    """Writes what a session sends into a run folder, in the background; with `record` its frames too.

    Args:
        out: folder, made when missing.
        source: of the frames.
        flight: that answers them.
        record: write each frame into out/recording, from the beginning.
        overwrite: replace an older result.

    Raises:
        ValueError: `out` holds results, or cannot be written.
    """

    def __init__(self, out: Path, source: LiveSource, flight: Flight, record: bool, overwrite: bool) -> None:
        self._recording, self._overwrite = out / RECORDING, overwrite
        self._frames: FrameFolder | None = None
        self._images: BackgroundWriter[Frame] | None = None
        self.is_recording = False
        self._check_recording(record)
        self._folder = start_folder(out, {"source": source.name} | settings_of(flight), overwrite)
        self._writer = RunWriter(self._folder, source, flight, is_filmed=False, columns=LIVE_COLUMNS)
        self._lines: BackgroundWriter[Record] = BackgroundWriter(self._writer.write, WAITING_LINES)
        self.record(record)

    def record(self, on: bool) -> None:
        """Begin, go on, or cease to write frames; for any thread.

        Raises:
            ValueError: the folder holds frames of another session.
            OSError: the disk refuses.
        """
        self._check_recording(on)
        if on and self._frames is None:
            if self._recording.exists():
                shutil.rmtree(self._recording)
            self._frames = FrameFolder(self._recording)
            self._images = BackgroundWriter(self._frames.add, WAITING_FRAMES)
        self.is_recording = on

    def _check_recording(self, on: bool) -> None:
        if on and self._frames is None and self._recording.exists() and not self._overwrite:
            raise ValueError(f"{self._recording} holds frames of another session: replace them with --overwrite")

    def _add_frame(self, frame: Frame) -> None:
        if self.is_recording and self._images is not None:
            self._images.offer(frame)

    def add_to(self, outputs: Outputs) -> Outputs:
        """The same outputs, and this folder."""

        def send(record: Record) -> None:
            self._lines.offer(record)
            outputs.send(record)

        return replace(outputs, send=send, record=self._add_frame)

    def finish(self) -> list[Path]:
        """Close everything and write the files that are made at the end; returns all of them."""
        self._close()
        written = self._writer.publish()
        self._folder.finish()
        return written

    def abandon(self) -> None:
        """Close everything after a failure; guidance.jsonl and run.toml alone: a restart must not wait for more."""
        self._close()
        self._writer.publish_settings()
        self._folder.finish()

    def _close(self) -> None:
        if self._images is not None and self._frames is not None:
            self._images.close()
            self._frames.close()
        self._lines.close()
        self._writer.close()

    def notes(self) -> list[str]:
        """For people, after `finish`: what most frames lack, and one line for each kind of thing that was lost."""
        writers = {"messages": self._lines, "frames": self._images}
        losses = [
            f"{writer.lost} {name} not written: {writer.error or 'the disk is too slow'}"
            for name, writer in writers.items()
            if writer is not None and writer.lost
        ]
        return self._writer.hints + losses
