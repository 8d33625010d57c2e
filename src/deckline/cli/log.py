"""Lines of a long-running command for people: on stderr, with time and level."""

import logging
import time
from typing import Literal

from deckline.files import printable

Level = Literal["info", "warning", "error"]


class _Formatter(logging.Formatter):
    """UTC to the millisecond, level, and the message as one printable line."""

    def __init__(self) -> None:
        self.converter = time.gmtime
        super().__init__("%(asctime)s.%(msecs)03dZ %(levelname)s %(message)s", "%Y-%m-%dT%H:%M:%S")

    def format(self, record: logging.LogRecord) -> str:
        return printable(super().format(record))


def make_log(level: Level) -> logging.Logger:
    """A logger of its own, outside of the tree of named loggers, that prints on stderr from `level` on."""
    handler = logging.StreamHandler()
    handler.setFormatter(_Formatter())
    log = logging.Logger("deckline", level.upper())
    log.addHandler(handler)
    return log
