"""A command that is expected to refuse its arguments."""

import pytest

from deckline.cli.main import main


def refuse(capsys: pytest.CaptureFixture[str], command: str, *words: object) -> str:
    """The line of a command that refuses its arguments."""
    assert main(["eval", command, *map(str, words)]) == 2
    (line,) = (line for line in capsys.readouterr().err.splitlines() if line.startswith("deckline: error"))
    return line
