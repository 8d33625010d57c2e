"""`--dashboard`, `--mcap` and `--foxglove` of `deckline run` and `live`: views of a flight."""

import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from deckline.config import RunConfig
from deckline.extras import needs_extra
from deckline.files import print_line
from deckline.flight import FrameResult
from deckline.live.mailbox import BackgroundWriter
from deckline.live.tally import Log
from deckline.report.records import FlightView, Record

WAITING = 16  # live answers that wait to be sent, at most

Address = Annotated[tuple[()] | tuple[str] | None, tyro.conf.arg(metavar="[HOST:PORT]")]  # None: not asked for


@dataclass(frozen=True)
class ViewOptions:
    """What watches a flight besides its files.

    Args:
        dashboard: watch in a browser (127.0.0.1:8080), a recording until Ctrl-C.
        mcap: for pictures and guidance as ROS 2 messages.
        foxglove: the same live, for Foxglove (127.0.0.1:8765).
    """

    dashboard: Address = None
    mcap: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    foxglove: Address = None

    @contextmanager
    def open(
        self,
        source: str,
        config: RunConfig,
        *,
        is_live: bool,
        overwrite: bool,
        log: Log = print_line,
        record: Callable[[bool], None] | None = None,
        is_recording: bool = False,
    ) -> Iterator[tuple[FlightView, ...]]:
        """The views that are asked for.

        Args:
            source: what people call the source.
            config: of the flight.
            is_live: answers have an age; guidance waits for no view.
            overwrite: replace the file of `mcap`.
            log: takes lines for people.
            record: turns recording on and off; None: frames cannot be recorded.
            is_recording: whether it is on.

        Raises:
            ImportError: an extra is not installed.
            ValueError: the file is there already, or nobody can listen at an address.
        """
        with ExitStack() as stack:
            views: list[FlightView] = []
            if self.dashboard is not None:
                address = "".join(self.dashboard)
                board = _open_dashboard(address, source, config, is_live, log, record, is_recording)
                views.append(stack.enter_context(board))
            if self.mcap is not None or self.foxglove is not None:
                views.append(stack.enter_context(self._open_publisher(source, config, is_live, overwrite, log)))
            yield tuple(views)

    @contextmanager
    def _open_publisher(
        self, source: str, config: RunConfig, is_live: bool, overwrite: bool, log: Log
    ) -> Iterator[FlightView]:
        """What turns a flight into ROS 2 messages. Live, what cannot be sent in time is lost and counted."""
        with needs_extra("foxglove"):
            from deckline.adapters.foxglove.publisher import DEFAULT, FlightPublisher, Publisher
        served = None if self.foxglove is None else "".join(self.foxglove) or DEFAULT
        with closing(Publisher(self.mcap, served, overwrite)) as publisher:
            if publisher.url:
                log(f"foxglove: open {publisher.url}")
            view = FlightPublisher(publisher, source, config)
            if not is_live:
                yield view
                return
            writer = BackgroundWriter[tuple[FrameResult | None, Record]](lambda item: view(*item), WAITING)
            with closing(writer):
                yield lambda result, record: writer.offer((result, record))
            if writer.lost:
                reason = writer.error and f"; the last one: {writer.error}"
                log(f"{writer.lost} answers were not published{reason}")


@contextmanager
def _open_dashboard(
    address: str,
    source: str,
    config: RunConfig,
    is_live: bool,
    log: Log,
    record: Callable[[bool], None] | None,
    is_recording: bool,
) -> Iterator[FlightView]:
    with needs_extra("dashboard"):
        from deckline.adapters.dashboard.server import DEFAULT, Dashboard
    with closing(Dashboard(address or DEFAULT, source, config, is_live, record, is_recording)) as dashboard:
        log(f"dashboard: {dashboard.url}")
        yield dashboard.view
        if not is_live:
            log(f"{dashboard.url} stays open until Ctrl-C")
            with suppress(KeyboardInterrupt):
                threading.Event().wait()
