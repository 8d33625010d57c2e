"""Dehazers by the names and files that a command line gives."""

import hashlib
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import deckline.dehaze
from deckline.dehaze import DEHAZERS, Dehazer, OnnxDehazer, restore
from deckline.dehaze.base import Restored
from deckline.runtime import sha256_of
from deckline.types import Frame

USUAL_FILES = ("dehaze.onnx", "detect.onnx")  # as `deckline train` calls them: their folder says more
NO_REDUCTION_PX = 10**9  # a working size that no image exceeds


def by_name(given: Iterable[str]) -> dict[str, str]:
    """Name to show -> name in DEHAZERS or path, each once.

    Raises:
        ValueError: neither a dehazer's name nor an .onnx file, or two files with one name.
    """
    named: dict[str, str] = {}
    for one in given:
        name = shown_name(one)
        if named.setdefault(name, one) != one:
            raise ValueError(f"{named[name]} and {one} would both be called {name}: rename a file or its folder")
    return named


def shown_name(given: str) -> str:
    """What a table calls it: the name itself; a file's, or its folder's for a file called dehaze.onnx.

    Raises:
        ValueError: neither a dehazer's name nor an .onnx file.
    """
    if given in DEHAZERS:
        return given
    if not given.endswith(".onnx"):
        raise ValueError(
            f"unknown dehazer {given!r}: use one of {', '.join(DEHAZERS)}, or the path of an .onnx file "
            f"(sources stand before --dehazer)"
        )
    return file_label(Path(given))


def file_label(path: Path) -> str:
    """What a table calls a network's file: its name, or its folder's where all trainings give the same name."""
    return path.resolve().parent.name if path.name in USUAL_FILES else path.stem


def build_dehazer(given: str, full_size: bool = False) -> Dehazer:
    """A dehazer with its model loaded.

    Args:
        given: name in DEHAZERS, or path of an .onnx file.
        full_size: networks without a coarse grid work on the whole picture, not on one averaged down.

    Raises:
        ValueError: an .onnx file that is missing or no dehazer.
    """
    name = shown_name(given)
    dehazer = DEHAZERS[given]() if given in DEHAZERS else OnnxDehazer(Path(given), name)
    if full_size and isinstance(dehazer, OnnxDehazer) and not dehazer.coarse:
        dehazer.working_long_side_px = NO_REDUCTION_PX
    return dehazer


def model_of(dehazer: Dehazer) -> str:
    """Which model it is: the SHA-256 of a network's file, and of deckline's own dehazing code where that takes part."""
    if not isinstance(dehazer, OnnxDehazer):
        return f"code {_code()}"
    weights = f"weights {sha256_of(dehazer.session.path)}"
    return weights if dehazer.geometry is None else f"{weights}, code {_code()}"


def _code() -> str:
    """SHA-256 of the modules that dehaze."""
    folder = Path(deckline.dehaze.__file__).parent
    return hashlib.sha256(b"".join(path.read_bytes() for path in sorted(folder.glob("*.py")))).hexdigest()


def size_of(dehazer: Dehazer) -> tuple[int, int] | None:
    """Parameters and multiply-accumulates at 256x256; None where there are none, or nobody counted."""
    return dehazer.cost if isinstance(dehazer, OnnxDehazer) else None


class SharedDehazer:
    """A dehazer that keeps the last frame's picture, for the next method that shares it."""

    def __init__(self, dehazer: Dehazer) -> None:
        self.name = dehazer.name
        self._dehazer = dehazer
        self._last: tuple[Frame, Restored] | None = None

    def __call__(self, image_rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        return self._dehazer(image_rgb)

    def restore(self, frame: Frame) -> Restored:
        if self._last is None or self._last[0] is not frame:
            self._last = frame, restore(self._dehazer, frame)
        return self._last[1]
