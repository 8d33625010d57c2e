"""The `deckline` command. Nothing that takes time is imported before a command is chosen."""

import os
import sys
from typing import Any

INTERRUPTED = 130  # the shell's code for a program ended by Ctrl-C
UNREAD = 141  # and for one whose output nobody reads any more, as behind `| head`


def main(argv: list[str] | None = None) -> int:
    """Run one command; returns the exit code. Bad input ends with one line and code 2, Ctrl-C with 130.

    The text of an interrupted command's KeyboardInterrupt names what it wrote.
    """
    # numpy reads it when it is loaded. A frame's matrices are small, and OpenBLAS's idle threads spin on the cores that
    # the networks need.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    args = sys.argv[1:] if argv is None else argv
    try:
        code = int(_run_command(args) or 0)
        sys.stdout.flush()
        return code
    except KeyboardInterrupt as interrupt:
        _print_line(": ".join(filter(None, ("deckline: stopped", str(interrupt)))))
        return INTERRUPTED
    except (ValueError, OSError, ImportError, MemoryError) as error:
        return _report(error)


def _run_command(args: list[str]) -> Any:
    if args == ["--version"]:
        from deckline import __version__

        print(f"deckline {__version__}")
        return 0
    from deckline.cli.commands import run_command

    return run_command(args)


def _report(error: Exception) -> int:
    """Print an error of the user's input as one line; returns the exit code."""
    from deckline.files import describe_error

    if isinstance(error, BrokenPipeError) and _is_unread():
        return UNREAD
    if os.environ.get("DECKLINE_TRACEBACK"):
        raise error
    _print_line(f"deckline: error: {describe_error(error)}")
    return 2


def _is_unread() -> bool:
    """Whether nobody reads our output any more: any other pipe that breaks is an error."""
    import select

    stdout = 1  # its descriptor
    output = select.poll()
    output.register(stdout, 0)
    if not any(event & select.POLLERR for _, event in output.poll(0)):
        return False
    os.dup2(os.open(os.devnull, os.O_WRONLY), stdout)  # or Python would complain when it ends
    return True


def _print_line(line: str) -> None:
    from deckline.files import print_line

    print_line(line)
