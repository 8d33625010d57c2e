"""Files from anywhere: regular and of a bounded size, plain values; folders with one writer; printable lines."""

import errno
import fcntl
import os
import re
import stat
import sys
import tomllib
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

MOST_BYTES = 1 << 29  # of a file that is read as a whole
MOST_TEXT_BYTES = 1 << 28  # of a table, or of scene.json: of 40 hours at 1 Hz, of 80 minutes at 30 Hz
MOST_CONFIG_BYTES = 1 << 20
MOST_PIXELS = 36_000_000  # of a picture: 8192x4320
MOST_DEPTH = 50  # of tables in tables
LARGEST_INTEGER = 2**63
MOST_WORD, MOST_LINE = 200, 2000  # characters of a word in an error, such as a file's name, and of all of it
_TOML_KEY = r"""(?:"(?:[^"\\\n]|\\.)*"|'[^'\n]*'|[\w-]+)"""
_DEEP_KEY = re.compile(rf"(?:\.[ \t]*{_TOML_KEY}[ \t]*){{{MOST_DEPTH}}}")
# C0 and C1 controls, lone surrogates, line separators, marks that turn the direction of writing
_UNPRINTABLE = re.compile("[\x00-\x1f\x7f-\x9f\ud800-\udfff\u200e\u200f\u2028-\u202e\u2066-\u2069]")


def open_regular(path: Path) -> BinaryIO:
    """Open a file to read it; a FIFO, socket, device or folder is an OSError, and is not waited for."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    mode = os.fstat(descriptor).st_mode
    if stat.S_ISREG(mode):
        return os.fdopen(descriptor, "rb")
    os.close(descriptor)
    reason = os.strerror(errno.EISDIR) if stat.S_ISDIR(mode) else "it is no regular file but a FIFO, socket or device"
    raise OSError(errno.EINVAL, reason, str(path))


def check_regular(path: Path) -> None:
    """Raise OSError as `open_regular`: for readers that open the file themselves."""
    open_regular(path).close()


def read_regular(path: Path, most_bytes: int = MOST_BYTES) -> bytes:
    """All of a regular file; an OSError as `open_regular`, and for more bytes than there may be."""
    with open_regular(path) as file:
        data = file.read(most_bytes + 1) if os.fstat(file.fileno()).st_size <= most_bytes else None
    if data is None or len(data) > most_bytes:
        raise OSError(errno.EFBIG, f"it is larger than {most_bytes >> 20} MiB", str(path))
    return data


def is_there(path: Path) -> bool:
    """Whether something lies there, be it a link to nothing, which a reader then refuses and no default replaces."""
    return os.path.lexists(path)


def is_beneath(path: Path, folder: Path) -> bool:
    """Whether a path, its links followed, stays in a folder."""
    return path.resolve().is_relative_to(folder.resolve())


@contextmanager
def lock_folder(folder: Path) -> Iterator[None]:
    """Make a folder and hold its lock until the end; a killed program releases it.

    Raises:
        ValueError: somebody else holds it, or it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    except OSError as error:
        raise ValueError(f"{folder}: cannot be written: {error.strerror or error}") from None
    try:
        with suppress(OSError):  # a file system without locks, such as NFS
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise ValueError(f"{folder}: another run writes there: wait for it, or choose another folder") from None
        yield
    finally:
        os.close(descriptor)


@contextmanager
def name_in_errors(path: Path) -> Iterator[None]:
    """Name a file or folder in errors of the system that name none, such as those of a write to a full disk."""
    try:
        yield
    except OSError as error:
        if error.filename is None and error.errno is not None:
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise


def check_size(width: int, height: int) -> None:
    """Raise ValueError for a picture of more pixels than there may be; to be asked before it is decoded."""
    if width * height > MOST_PIXELS:
        raise ValueError(f"{width}x{height} px are more than {MOST_PIXELS:,}: scale it down")


def parse_plain(parse: Callable[[str], Any], text: str) -> Any:
    """What a parser of JSON, TOML or YAML makes of a text.

    Raises:
        ValueError: as `parse`, for values nested too deeply, for one in several places as YAML's aliases
            do, which grows without end when it is printed, and for whole numbers beyond 64 bits.
    """
    try:
        values = parse(text)
    except RecursionError:
        raise ValueError("nested too deeply") from None
    waiting, seen = [(values, 0)], set()
    while waiting:
        value, depth = waiting.pop()
        if depth > MOST_DEPTH:
            raise ValueError(f"nested more than {MOST_DEPTH} deep")
        if isinstance(value, int) and abs(value) >= LARGEST_INTEGER:
            raise ValueError(f"a whole number of {value.bit_length()} bits; 64 are the most")
        if isinstance(value, dict | list):
            if id(value) in seen:
                raise ValueError("a list or table in two places")
            seen.add(id(value))
            waiting += [(item, depth + 1) for item in (value.values() if isinstance(value, dict) else value)]
    return values


def parse_toml(text: str) -> dict[str, Any]:
    """Tables of a TOML text; a ValueError as `parse_plain`.

    A dotted key costs tomllib time and memory with the square of its dots, so deep ones are refused before it reads.
    """
    if found := _DEEP_KEY.search(text):
        line = 1 + text.count("\n", 0, found.start())
        raise ValueError(f"line {line}: a key of more than {MOST_DEPTH} parts")
    return dict(parse_plain(tomllib.loads, text))


def printable(text: object) -> str:
    r"""A text without what terminals obey and UTF-8 cannot hold: control characters become \x1b or \u202e, bytes of
    names that are no UTF-8 become \xff.
    """
    return _UNPRINTABLE.sub(lambda found: _escape(ord(found[0])), str(text))


def shorten(text: str, most: int) -> str:
    """A text of at most `most` characters: its middle gives way to three dots."""
    if len(text) <= most:
        return text
    head = (most - 3) * 2 // 3
    return f"{text[:head]}...{text[head + 3 - most :]}"


def describe_error(error: BaseException) -> str:
    """An error in one line of at most `MOST_LINE` characters; of the system's errors the file and the reason.

    A word, such as a file's name, loses its middle beyond `MOST_WORD` characters.
    """
    text = str(error) or type(error).__name__
    if isinstance(error, OSError) and error.strerror:
        names = [str(name) for name in (error.filename, error.filename2) if name is not None]
        text = f"{' -> '.join(names) or 'a file'}: {error.strerror}"
    return shorten(" ".join(shorten(word, MOST_WORD) for word in text.split()), MOST_LINE)


def print_line(line: object) -> None:
    """Print one printable line on stderr."""
    print(printable(line), file=sys.stderr, flush=True)


def print_notes(notes: Iterable[str]) -> None:
    """Print what is odd about a source but does not stop it, one line each."""
    for note in notes:
        print_line(f"note: {note}")


def _escape(code: int) -> str:
    code -= 0xDC00 if 0xDC80 <= code <= 0xDCFF else 0  # where Python puts the bytes of a name that is no UTF-8
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}"
