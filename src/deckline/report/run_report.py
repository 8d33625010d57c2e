"""What a run tells its report: where the results came from, and a choice of records that does not grow with the run."""

from pathlib import Path

from deckline.recording import Stream
from deckline.report.html import Picture, report_html
from deckline.report.pictures import PictureSample
from deckline.report.provenance import Settings, command_line, now, software
from deckline.report.records import Record, read_records

REPORT_RECORDS = 2000  # at most, besides those with pictures
REPORT_SKIPPED = 200  # skipped frames always among them, at most


def run_info(source: Stream, settings: Settings, frames: int, total: int | None, interrupted: bool) -> dict[str, str]:
    """Label -> value, in the order in which the report shows them."""
    notes = {f"note {number}": note for number, note in enumerate(source.notes, 1)}
    ended = (f"{frames}" if total is None else f"{frames} of {total}") + (
        ", stopped before the end" if interrupted else ""
    )
    info = {"source": source.name, "frames": ended, "date": now(), "version": software(), "command": command_line()}
    return info | notes | settings


def report_text(jsonl: Path, sample: PictureSample, info: dict[str, str], counts: dict[str, int]) -> str:
    """The HTML of a run whose records lie in `jsonl`."""
    files = {picture.index: picture for picture in sample.kept()}
    step = max(-(-sum(counts.values()) // REPORT_RECORDS), 1)
    records: list[Record] = []
    pictures: list[Picture] = []
    skipped = 0
    for index, record in enumerate(read_records(jsonl)):
        skipped += "skipped" in record
        listed = "skipped" in record and skipped <= REPORT_SKIPPED
        if index in files:
            pictures.append(Picture(len(records), files[index].hazy.read_bytes(), files[index].marked.read_bytes()))
        if index % step == 0 or index in files or listed:
            records.append(record)
    return report_html(info, records, pictures, counts)
