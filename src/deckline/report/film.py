"""The film and the report's pictures, made in a thread of their own: guidance does not wait for them.

Their pictures are dehazed here. What that finds in each frame is a file of its own, dehazing.jsonl.
"""

import queue
import threading
import time
from collections.abc import Iterable
from contextlib import closing

from deckline.config import Models
from deckline.dehaze import Dehazer, DehazeResult, dehaze_for_display
from deckline.flight import FrameResult
from deckline.report.overlay import OVERLAY_PX, draw_overlay, draw_panels
from deckline.report.records import dehazing_record, keep_whole_lines, to_line
from deckline.report.run_folder import PictureSample, RunFolder
from deckline.report.video import VideoPiece

WAITING = 4  # results that wait to be drawn, at most: 25 MB each in 4K


class OverlayWriter:
    """Draws results in the order in which they are added, until `close`.

    An error ends the drawing; the next `add` or `close` raises it.

    Args:
        folder: of the run.
        sample: gets the pictures for the report.
        dehazer: of the pictures, where the chain has not dehazed them.
        models: of the configuration.
    """

    def __init__(self, folder: RunFolder, sample: PictureSample, dehazer: Dehazer, models: Models) -> None:
        self._folder = folder
        self._sample = sample
        self._dehazer = dehazer
        self._models = models
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
        path = self._folder.dehazing
        path.touch()
        keep_whole_lines(path, self._folder.pictures)
        piece = VideoPiece(self._folder.work / f"film-{len(self._folder.pieces()):04d}.mp4", OVERLAY_PX)
        with closing(piece), path.open("ab", buffering=0) as lines:
            for index, result in results:
                dehazed, seconds = self._dehaze(result)
                frame = {"file": result.frame.file, "time_s": result.frame.time_s}
                lines.write(to_line({**frame, **dehazing_record(dehazed), "seconds": round(seconds, 6)}).encode())
                panels = draw_panels(result, dehazed)
                self._sample.add(index, panels)
                piece.add(draw_overlay(result.frame, result.guidance, panels), result.frame.time_s)

    def _dehaze(self, result: FrameResult) -> tuple[DehazeResult, float]:
        """The result's picture, and the seconds that it took."""
        if result.dehazed is not None:
            return result.dehazed, result.seconds.get("dehaze", 0.0)
        start = time.perf_counter()
        dehazed = dehaze_for_display(result.frame, self._dehazer, self._models)
        return dehazed, time.perf_counter() - start
