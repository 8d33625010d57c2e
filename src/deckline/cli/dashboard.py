"""`--dashboard` of `deckline live` and `run`."""

import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from typing import Annotated

import tyro

from deckline.config import RunConfig
from deckline.extras import needs_extra
from deckline.files import print_line
from deckline.report.records import View

Address = Annotated[tuple[()] | tuple[str] | None, tyro.conf.arg(metavar="[HOST:PORT]")]  # None: no dashboard


@contextmanager
def open_dashboard(
    address: Address,
    source: str,
    config: RunConfig,
    is_live: bool,
    record: Callable[[bool], None] | None = None,
    is_recording: bool = False,
) -> Iterator[tuple[View, ...]]:
    """What watches the flight for browsers; nothing without an address. A recording's stays open until Ctrl-C.

    Args:
        address: empty: the default one.
        source: what people call the source.
        config: of the flight.
        is_live: answers have an age.
        record: turns recording on and off; None: frames cannot be recorded.
        is_recording: whether it is on.

    Raises:
        ImportError: NiceGUI is not installed.
        ValueError: nobody can listen there.
    """
    if address is None:
        yield ()
        return
    with needs_extra("dashboard"):
        from deckline.adapters.dashboard.server import DEFAULT, Dashboard
    with closing(Dashboard("".join(address) or DEFAULT, source, config, is_live, record, is_recording)) as dashboard:
        print_line(f"dashboard: {dashboard.url}")
        yield (dashboard.view,)
        if not is_live:
            print_line(f"{dashboard.url} stays open until Ctrl-C")
            _wait_for_ctrl_c()


def _wait_for_ctrl_c() -> None:
    with suppress(KeyboardInterrupt):
        threading.Event().wait()
