"""Optional parts of the installation."""

from collections.abc import Iterator
from contextlib import contextmanager

PACKAGES = ("deckline", "deckline_sim", "deckline_lab")


@contextmanager
def needs_extra(extra: str) -> Iterator[None]:
    """Turn a missing package into the command that installs it.

    Args:
        extra: empty: what is missing is no optional part, and the error stays as it is.

    Raises:
        ImportError: naming the package and `pip install "deckline[extra]"`.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        name = (error.name or "").partition(".")[0]
        if not extra or not name or (name in PACKAGES and error.name != name):
            raise
        raise ImportError(f'{error.name} is not installed; run: pip install "deckline[{extra}]"') from error
