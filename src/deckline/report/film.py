"""The film and the report's pictures, made in a thread of their own: guidance does not wait for what people look at.

What dehazing tells of a frame is known only then. It is kept beside the records, which were written before, and joined
with them once the run ends.
"""

import queue
import threading
from collections.abc import Iterable, Iterator
from contextlib import closing

from deckline.flight import FrameResult
from deckline.report.overlay import OVERLAY_PX, draw_overlay, draw_panels
from deckline.report.records import Record, dehazing_record, keep_whole_lines, to_line
from deckline.report.run_folder import PictureSample, RunFolder
from deckline.report.video import VideoPiece

WAITING = 4  # results that wait to be drawn, at most: 25 MB each in 4K


class OverlayWriter:
    """Draws results in the order in which they are added, until `close`.

    An error ends the drawing; the next `add` or `close` raises it.

    Args:
        folder: of the run.
        sample: gets the pictures for the report.
    """

    def __init__(self, folder: RunFolder, sample: PictureSample) -> None:
        self._folder = folder
        self._sample = sample
        self._results: queue.Queue[tuple[int, FrameResult] | None] = queue.Queue(WAITING)
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._work, name="film", daemon=True)
        self._thread.start()

    def add(self, index: int, result: FrameResult) -> None:
        """Draw the result of record `index`; waits while too many are still to be drawn."""
        self._results.put((index, result))
        self._raise()

    def close(self) -> None:
        """Wait until everything is drawn and written."""
        self._results.put(None)
        self._thread.join()
        self._raise()

    def _raise(self) -> None:
        if self._error is not None:
            error, self._error = self._error, None
            raise error

    def _work(self) -> None:
        results = iter(self._results.get, None)
        try:
            self._draw(results)
        except BaseException as error:
            self._error = error
            for _ in results:  # `add` must not wait for a thread that draws no more
                pass

    def _draw(self, results: Iterable[tuple[int, FrameResult]]) -> None:
        path = self._folder.dehazed
        path.touch()
        keep_whole_lines(path)
        piece = VideoPiece(self._folder.work / f"film-{len(self._folder.pieces()):04d}.mp4", OVERLAY_PX)
        with closing(piece), path.open("ab", buffering=0) as dehazed:
            for index, result in results:
                panels = draw_panels(result)  # it dehazes
                dehazed.write(to_line({"index": index, "told": dehazing_record(result)}).encode())
                self._sample.add(index, panels)
                piece.add(draw_overlay(result.frame, result.guidance, panels), result.frame.time_s)


def join_dehazing(records: Iterable[Record], dehazed: Iterable[Record]) -> Iterator[Record]:
    """Records with what dehazing told of their frames.

    Args:
        records: all of a run, in their order.
        dehazed: what `OverlayWriter` wrote, by ascending "index"; a resumed run tells of some frames again.
    """
    told = iter(dehazed)
    line = next(told, None)
    for index, record in enumerate(records):
        while line is not None and line["index"] < index:
            line = next(told, None)
        yield record | line["told"] if line is not None and line["index"] == index else record
