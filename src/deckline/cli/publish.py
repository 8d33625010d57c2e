"""`--mcap` and `--foxglove` of `deckline live` and `run`."""

from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

from deckline.cli.dashboard import Address
from deckline.config import RunConfig
from deckline.extras import needs_extra
from deckline.files import print_line
from deckline.flight import FrameResult
from deckline.report.records import Record, View

WAITING = 16  # live answers that wait to be sent, at most


@contextmanager
def open_publisher(
    mcap: Path | None, address: Address, source: str, config: RunConfig, is_live: bool, overwrite: bool
) -> Iterator[tuple[View, ...]]:
    """What turns a flight into ROS 2 messages; nothing without a file and an address.

    Args:
        mcap: new file.
        address: empty: the default one.
        source: what people call the source.
        config: of the flight.
        is_live: guidance does not wait for it: what cannot be sent in time is lost and counted.
        overwrite: replace the file.

    Raises:
        ImportError: the extra `foxglove` is not installed.
        ValueError: the file is there already, or nobody can listen there.
    """
    if mcap is None and address is None:
        yield ()
        return
    with needs_extra("foxglove"):
        from deckline.adapters.foxglove.publisher import DEFAULT, FlightPublisher, Publisher
    served = None if address is None else "".join(address) or DEFAULT
    with closing(Publisher(mcap, served, overwrite)) as publisher:
        if publisher.url:
            print_line(f"foxglove: open {publisher.url}")
        view = FlightPublisher(publisher, source, config)
        if not is_live:
            yield (view,)
            return
        from deckline.live.mailbox import BackgroundWriter

        writer = BackgroundWriter[tuple[FrameResult | None, Record]](lambda item: view(*item), WAITING)
        with closing(writer):
            yield (lambda result, record: writer.offer((result, record)),)
        if writer.lost:
            print_line(f"{writer.lost} answers were not published{writer.error and f'; the last one: {writer.error}'}")
