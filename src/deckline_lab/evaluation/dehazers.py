"""Dehazers by the names and files that a command line gives, and what one costs, each run in a fresh process.

Peak memory is Linux's VmHWM: getrusage's peak, but it can be set back once everything is loaded, and does not begin at
the parent's size.
"""

import ctypes
import gc
import hashlib
import multiprocessing
import time
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median

import cv2
import numpy as np
from numpy.typing import NDArray

import deckline.dehaze
from deckline.dehaze import Dehazer, OnnxDehazer, restore
from deckline.dehaze.base import DehazeResult
from deckline.runtime import sha256_of
from deckline.types import Frame
from deckline_lab import rivals
from deckline_lab.evaluation.dehazing_pairs import open_pairs
from deckline_lab.rivals.catalog import ALL_DEHAZERS

USUAL_FILES = ("dehaze.onnx", "detect.onnx")  # as `deckline train` calls them: their folder's name is shown
NO_REDUCTION_PX = 10**9  # a working size that no image exceeds
RESET_PEAK = Path("/proc/self/clear_refs")  # proc(5): 5 sets the peak resident set to what is resident now


def by_name(given: Iterable[str]) -> dict[str, str]:
    """Name to show -> name in ALL_DEHAZERS or path, each once.

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
    """What a table calls it: the name itself; a file's, or its folder's for a file called dehaze.onnx."""
    if given in ALL_DEHAZERS:
        return given
    if not given.endswith(".onnx"):
        raise ValueError(
            f"unknown dehazer {given!r}: use one of {', '.join(ALL_DEHAZERS)}, or the path of an .onnx file "
            f"(write sources before --dehazer)"
        )
    return file_label(Path(given))


def file_label(path: Path) -> str:
    """What a table calls a network's file: its name, or its folder's where all trainings give the same name."""
    return path.resolve().parent.name if path.name in USUAL_FILES else path.stem


def detector_label(given: str) -> str:
    """What a table calls a detector: its name, or what its .onnx file is called."""
    return file_label(Path(given)) if given.endswith(".onnx") else given


def build_dehazer(given: str, full_size: bool = False) -> Dehazer:
    """A dehazer with its model loaded, by its name in ALL_DEHAZERS or the path of an .onnx file.

    With `full_size`, networks without a coarse grid work on the whole picture, not on one averaged down.

    Raises:
        ValueError: an .onnx file that is missing or no dehazer.
    """
    name = shown_name(given)
    dehazer = ALL_DEHAZERS[given]() if given in ALL_DEHAZERS else OnnxDehazer(Path(given), name)
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
    files = [*Path(deckline.dehaze.__file__).parent.glob("*.py"), *Path(rivals.__file__).parent.glob("*.py")]
    return hashlib.sha256(b"".join(path.read_bytes() for path in sorted(files))).hexdigest()


class SharedDehazer:
    """A dehazer that caches the last frame's result for the next method that shares it."""

    def __init__(self, dehazer: Dehazer) -> None:
        self.name = dehazer.name
        self._dehazer = dehazer
        self._last: tuple[Frame, DehazeResult] | None = None

    def __call__(self, image_rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        return self._dehazer(image_rgb)

    def restore(self, frame: Frame) -> DehazeResult:
        if self._last is None or self._last[0] is not frame:
            self._last = frame, restore(self._dehazer, frame)
        return self._last[1]


@dataclass(frozen=True)
class CostTask:
    """One run."""

    dehazer: str  # name in ALL_DEHAZERS, or path of an .onnx file
    source: str
    key: str  # of the pair whose hazy picture is dehazed
    size_px: tuple[int, int]  # width, height that the picture is resized to
    full_size: bool
    deck_z_m: float | None
    sea_z_m: float | None


@dataclass(frozen=True)
class Cost:
    """Medians over the runs."""

    seconds: float  # one picture, after a first one that is not counted
    peak_bytes: float | None  # beyond what was resident with model and picture loaded; None without Linux's /proc


def measure_costs(
    tasks: Mapping[str, CostTask], runs: int, done: Callable[[], None]
) -> tuple[dict[str, Cost], dict[str, str]]:
    """Costs by the names of the tasks, and for what could not be measured the reason; `done` is called after every run.

    The runs are interleaved, so that a busy machine disturbs all alike; a dehazer that fails is not asked again.
    """
    costs: dict[str, list[Cost]] = {name: [] for name in tasks}
    failed: dict[str, str] = {}
    for _ in range(runs):
        for name, task in tasks.items():
            try:
                if name not in failed:
                    costs[name].append(run_in_process(task))
            except BrokenProcessPool:
                failed[name] = "the process died (no memory left?)"
            except Exception as error:  # whatever a dehazer raises is the reason
                failed[name] = f"{type(error).__name__}: {error}"
            done()
    return {name: _median(runs) for name, runs in costs.items() if name not in failed}, failed


def _median(costs: list[Cost]) -> Cost:
    peaks = [cost.peak_bytes for cost in costs if cost.peak_bytes is not None]
    return Cost(median(cost.seconds for cost in costs), median(peaks) if peaks else None)


def run_in_process(task: CostTask) -> Cost:
    """Cost of one run in a fresh process."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(run_once, task).result()


def run_once(task: CostTask) -> Cost:
    """Cost of one run in this process: the second of two, and the peak memory of both."""
    frame = open_pairs(Path(task.source), deck_z_m=task.deck_z_m, sea_z_m=task.sea_z_m).load(task.key).frame
    image = cv2.resize(frame.image_rgb, task.size_px, interpolation=cv2.INTER_AREA).astype(np.uint8)
    frame = replace(frame, image_rgb=image, camera=frame.camera.resized(*task.size_px), depth_m=None)
    dehazer = build_dehazer(task.dehazer, task.full_size)
    resident = reset_peak()
    restore(dehazer, frame)
    start = time.perf_counter()
    restore(dehazer, frame)
    seconds = time.perf_counter() - start
    return Cost(seconds, None if resident is None else read_memory("VmHWM") - resident)


def reset_peak() -> int | None:
    """Bytes resident now, where the peak now begins; None where the system does not report it.

    Freed memory is returned to the system first: the allocator's reserve would hide what a dehazer takes.
    """
    gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # of the GNU C library
    if trim is not None:
        trim(0)
    try:
        RESET_PEAK.write_text("5")
    except OSError:
        return None
    return read_memory("VmRSS")


def read_memory(entry: str) -> int:
    """Bytes of an entry of Linux's /proc/self/status, such as VmHWM, the most that was resident."""
    entries = dict(line.partition(":")[::2] for line in Path("/proc/self/status").read_text().splitlines())
    return 1024 * int(entries[entry].split()[0])
