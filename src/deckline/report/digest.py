"""What the end of a run needs of its records, gathered while they pass by once."""

from deckline.report.advice import remedy_of
from deckline.report.figures import TextCounter
from deckline.report.html import ReportPictures
from deckline.report.records import Record, lookup
from deckline.report.run_folder import PictureSample
from deckline.types import Reason, Status

REPORT_RECORDS = 2000  # records that plots are made of, at most, besides those with pictures
REPORT_SKIPPED = 200  # skipped frames always among them, at most


class RunDigest:
    """Chooses the report's records, whose number does not grow with the run; counts why frames lack distances or `ok`.

    Args:
        frames: of the run, skipped ones included.
        sample: the report's pictures; None: none.

    Attributes:
        records: those of the report.
        pictures: those that belong to them.
    """

    def __init__(self, frames: int, sample: PictureSample | None) -> None:
        self.records: list[Record] = []
        self.pictures: ReportPictures = {}
        self._step = max(-(-frames // REPORT_RECORDS), 1)
        self._sample, self._pictured = sample, set(sample.indices() if sample else ())
        self._index = self._skipped = 0
        self._missing, self._unverified = TextCounter(), TextCounter()
        self._unverified_frames = 0

    def add(self, record: Record) -> Record:
        """Take the next record; a live message without a frame is left out. Returns the record."""
        if record["file"] is None:
            return record
        index, is_skipped = self._index, "skipped" in record
        self._index += 1
        self._skipped += is_skipped
        if self._sample is not None and index in self._pictured:
            self.pictures[len(self.records)] = self._sample.read(index)
        if index % self._step == 0 or index in self._pictured or (is_skipped and self._skipped <= REPORT_SKIPPED):
            self.records.append(record)
        if not is_skipped:
            self._count(record)
        return record

    def _count(self, record: Record) -> None:
        heights = (lookup(record, ("guidance", f"height_above_deck_{unit}")) for unit in ("m", "widths"))
        if all(height is None for height in heights):
            self._missing.add(tuple(record["reasons"]), record["reason"])
        if record["status"] == Status.UNVERIFIED:
            self._unverified_frames += 1
            for reason in dict.fromkeys(record["reasons"]):
                self._unverified.add(reason, reason)

    def hints(self) -> list[str]:
        """One line for each thing that most frames lack, with its most frequent reason and remedy."""
        used, missing, lines = self._index - self._skipped, self._missing.rows(), []
        without = sum(count for _, count in missing)
        if 2 * without > used:
            lines.append(f"no distances in {without} of {used} frames; most often: {missing[0][0]}")
        if 2 * self._unverified_frames > used and (reasons := self._unverified.rows()):
            reason = Reason(reasons[0][0])
            words = ": ".join(filter(None, (str(reason), remedy_of(reason))))
            lines.append(f"unverified in {self._unverified_frames} of {used} frames; most often {words}")
        return lines
