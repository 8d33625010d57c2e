"""Optional parts of the installation."""

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def needs_extra(extra: str) -> Iterator[None]:
    """Turn a missing package into the command that installs it.

    Raises:
        ImportError: naming the package and `pip install "deckline[extra]"`.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        if error.name is None or error.name.startswith("deckline"):
            raise
        raise ImportError(f'{error.name} is not installed; run: pip install "deckline[{extra}]"') from error
