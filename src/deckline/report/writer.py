"""The files of one flight, written the same way by `deckline run` and `deckline live`."""

from collections.abc import Iterable, Mapping
from itertools import islice
from pathlib import Path
from shutil import copyfile

from deckline.config_file import to_toml_text
from deckline.flight import FrameResult
from deckline.recording import Source
from deckline.report.digest import REPORT_RECORDS, RunDigest
from deckline.report.film import OverlayWriter
from deckline.report.html import report_html
from deckline.report.provenance import Chain, run_info, settings_of
from deckline.report.records import NO_COLUMNS, Record, kind_of, read_records, to_line, write_csv
from deckline.report.run_folder import CONFIG, CSV, DEHAZING, REPORT, VIDEO, PictureSample, RunFolder
from deckline.report.status import STATUS_WORDS
from deckline.report.video import join


class RunWriter:
    """Writes guidance.jsonl while a flight goes on, and the other files when it ends.

    Args:
        folder: of the run, started or resumed.
        source: of the frames.
        chain: the flight, whose configuration and models the files state.
        is_filmed: make a film and pictures for the report; both are dehazed.
        columns: further columns of guidance.csv.

    Attributes:
        counts: frames by status, and "skipped".
        hints: for people, once the files are published: what most frames lack, and its remedy.
    """

    def __init__(
        self,
        folder: RunFolder,
        source: Source,
        chain: Chain,
        *,
        is_filmed: bool = True,
        columns: Mapping[str, Iterable[str | int]] = NO_COLUMNS,
    ) -> None:
        self.counts = {**dict.fromkeys(STATUS_WORDS, 0), **folder.counts}
        self.hints: list[str] = []
        self._folder, self._source, self._chain, self._columns = folder, source, chain, columns
        self._lines = folder.jsonl.open("ab", buffering=0)
        self._sample = PictureSample(folder.work / "pictures") if is_filmed else None
        self._film = OverlayWriter(folder, self._sample, chain.dehazer, chain.config.models) if self._sample else None

    @property
    def frames(self) -> int:
        """Records of frames, skipped ones included."""
        return sum(self.counts.values())

    def write(self, record: Record) -> None:
        """Append a record."""
        self._lines.write(to_line(record).encode())  # in a single write: a kill cuts off one line at most
        if record["file"] is not None:
            self.counts[kind_of(record)] += 1

    def draw(self, index: int, result: FrameResult) -> None:
        """Append the result of record `index` to the film; waits while too many are still to be drawn."""
        if self._film is not None:
            self._film.add(index, result)

    def close(self) -> None:
        """Wait until everything is drawn and written."""
        self._lines.close()
        if self._film is not None:
            self._film.close()

    def publish(self, total: int | None = None, is_stopped: bool = False) -> list[Path]:
        """Make the files that need the whole run, then rename them to where they belong; returns all of them.

        Args:
            total: frames that there are; None: not known.
            is_stopped: the run ends before its last frame.
        """
        work, names = self._folder.work, [CSV, REPORT, CONFIG]
        self._write_settings()
        digest = RunDigest(self.frames, self._sample)
        write_csv(work / CSV, map(digest.add, read_records(self._folder.jsonl)), self._columns)
        if join(self._folder.pieces(), work / VIDEO):
            copyfile(self._folder.dehazing, work / DEHAZING)
            names += [VIDEO, DEHAZING]
        info = run_info(self._source, self.frames, total, is_stopped) | settings_of(self._chain)
        report = report_html(info, digest.records, digest.pictures, self.counts, self._read_dehazing())
        (work / REPORT).write_text(report, encoding="utf-8")
        self.hints = digest.hints()
        return self._folder.publish(names)

    def publish_settings(self) -> None:
        """Rename the records and the settings alone to where they belong, in no time."""
        self._write_settings()
        self._folder.publish([CONFIG])

    def _write_settings(self) -> None:
        (self._folder.work / CONFIG).write_text(to_toml_text(self._chain.config), encoding="utf-8")

    def _read_dehazing(self) -> list[Record]:
        """What dehazing found in the film's frames, evenly chosen."""
        path, step = self._folder.dehazing, max(-(-self.frames // REPORT_RECORDS), 1)
        return list(islice(read_records(path), None, None, step)) if path.exists() else []
