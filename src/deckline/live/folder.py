"""The run folder of a live session: guidance.jsonl while it flies, the other files at its end."""

import re
import shutil
import socket
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import islice
from pathlib import Path

from deckline.config_file import to_toml_text
from deckline.flight import Flight
from deckline.live.datagrams import parse_udp
from deckline.live.mailbox import BackgroundWriter
from deckline.live.messages import LIVE_COLUMNS, NO_FRAME
from deckline.live.pipeline import Outputs
from deckline.live.recorder import FrameFolder
from deckline.live.source import LiveSource
from deckline.report.html import report_html
from deckline.report.provenance import run_info, settings_of
from deckline.report.records import Record, read_records, to_line, write_csv
from deckline.report.run_folder import CONFIG, CSV, REPORT, start_folder
from deckline.types import Frame

CREDENTIALS = r"//[^/\s]*@"  # of an address
RECORDING = "recording"  # folder of the frames
WAITING_LINES, WAITING_FRAMES = 1000, 16  # for the disk; a 720p frame takes 2.8 MB
REPORT_RECORDS = 2000  # that the report's plots are made of


@contextmanager
def open_output(to: str) -> Iterator[Callable[[Record], None]]:
    """Sends records as JSON lines: to "-", stdout, or to udp://HOST:PORT, one a datagram.

    A datagram that the network does not take is lost.

    Raises:
        ValueError: neither.
    """
    if to == "-":
        yield _print_record
        return
    address = parse_udp(to)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as output:

        def send(record: Record) -> None:
            try:
                output.sendto(to_line(record).encode(), address)
            except OSError as error:
                print(f"{to}: not sent: {error.strerror or error}", file=sys.stderr)

        yield send


def _print_record(record: Record) -> None:
    print(to_line(record), end="", flush=True)


class Folder:
    """Takes what a session sends, in the background, and makes a run folder of it; with `record` its frames too.

    Args:
        out: folder, made when missing.
        source: of the frames.
        flight: that answers them.
        record: keep each frame in out/recording, from the beginning.
        overwrite: replace an older result.

    Raises:
        ValueError: `out` holds results, or cannot be written.
    """

    def __init__(self, out: Path, source: LiveSource, flight: Flight, record: bool, overwrite: bool) -> None:
        self._source, self._config, self._settings = source, flight.config, settings_of(flight)
        self._recording, self._overwrite = out / RECORDING, overwrite
        self._frames: FrameFolder | None = None
        self._images: BackgroundWriter[Frame] | None = None
        self.is_recording = False
        self._check_recording(record)
        self._folder = start_folder(out, {"source": source.name} | self._settings, overwrite)
        self._file = self._folder.jsonl.open("ab", buffering=0)
        self._lines: BackgroundWriter[Record] = BackgroundWriter(self._write, WAITING_LINES)
        self.record(record)

    def record(self, on: bool) -> None:
        """Begin, or go on, to keep frames, or cease to; for any thread.

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

    def _keep(self, frame: Frame) -> None:
        if self.is_recording and self._images is not None:
            self._images.offer(frame)

    def add_to(self, outputs: Outputs) -> Outputs:
        """The same outputs, and this folder."""

        def send(record: Record) -> None:
            self._lines.offer(record)
            outputs.send(record)

        return replace(outputs, send=send, keep=self._keep)

    def finish(self, counts: dict[str, int]) -> list[Path]:
        """Close everything and write the files that are made at the end; returns all of them.

        Args:
            counts: messages by status, and those without a frame.
        """
        if self._images is not None and self._frames is not None:
            self._images.close()
            self._frames.close()
        self._lines.close()
        self._file.close()
        work, frames = self._folder.work, {key: count for key, count in counts.items() if key != NO_FRAME}
        (work / CONFIG).write_text(to_toml_text(self._config), encoding="utf-8")
        write_csv(work / CSV, read_records(self._folder.jsonl), LIVE_COLUMNS)
        step = max(-(-sum(frames.values()) // REPORT_RECORDS), 1)
        records = list(islice(_frame_records(self._folder.jsonl), None, None, step))
        info = run_info(self._source, sum(frames.values()), None, False) | self._settings
        info["command"] = re.sub(CREDENTIALS, "//", info["command"])
        (work / REPORT).write_text(report_html(info, records, {}, frames), encoding="utf-8")
        written = self._folder.publish([CSV, REPORT, CONFIG])
        self._folder.finish()
        return written

    def losses(self) -> list[str]:
        """One line for each kind of thing that was not written."""
        writers = {"messages": self._lines, "frames": self._images}
        return [
            f"{writer.lost} {name} not kept: {writer.error or 'the disk is too slow'}"
            for name, writer in writers.items()
            if writer is not None and writer.lost
        ]

    def _write(self, record: Record) -> None:
        self._file.write(to_line(record).encode())


def _frame_records(jsonl: Path) -> Iterator[Record]:
    return (record for record in read_records(jsonl) if record["file"] is not None)
