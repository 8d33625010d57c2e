"""What a dehazer costs: latency and peak memory, each run in a fresh process of its own.

Peak memory is Linux's VmHWM: getrusage's peak, but it can be set back once everything is loaded, and does not begin at
the parent's size.
"""

import ctypes
import gc
import multiprocessing
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median

import cv2
import numpy as np

from deckline.dehaze import restore
from deckline.evaluation.dehazing_methods import build_dehazer
from deckline.evaluation.dehazing_pairs import open_pairs
from deckline.types import Frame

STATUS = Path("/proc/self/status")
RESET_PEAK = Path("/proc/self/clear_refs")
RESET_WORD = "5"  # proc(5): sets the peak resident set to what is resident now


@dataclass(frozen=True)
class CostTask:
    """One run."""

    dehazer: str  # name in DEHAZERS, or path of an .onnx file
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
    """Costs by name, and for what could not be measured the reason.

    The runs are interleaved, so that a busy machine disturbs all alike; a dehazer that fails is not asked again.

    Args:
        tasks: by name.
        runs: of each dehazer.
        done: called after every run.
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
    source = open_pairs(Path(task.source), deck_z_m=task.deck_z_m, sea_z_m=task.sea_z_m)
    frame = _resize(source.load(task.key).frame, *task.size_px)
    dehazer = build_dehazer(task.dehazer, task.full_size)
    resident = _reset_peak()
    restore(dehazer, frame)
    start = time.perf_counter()
    restore(dehazer, frame)
    seconds = time.perf_counter() - start
    return Cost(seconds, None if resident is None else _read_memory("VmHWM") - resident)


def _resize(frame: Frame, width: int, height: int) -> Frame:
    image = cv2.resize(frame.image_rgb, (width, height), interpolation=cv2.INTER_AREA).astype(np.uint8)
    return replace(frame, image_rgb=image, camera=frame.camera.resized(width, height), depth_m=None)


def _reset_peak() -> int | None:
    """Bytes resident now, where the peak now begins; None where the system cannot say.

    What was freed goes back to the system first: memory kept for later would hide what a dehazer takes.
    """
    gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # of the GNU C library
    if trim is not None:
        trim(0)
    try:
        RESET_PEAK.write_text(RESET_WORD)
    except OSError:
        return None
    return _read_memory("VmRSS")


def _read_memory(entry: str) -> int:
    """Bytes of one entry of /proc/self/status."""
    entries = dict(line.partition(":")[::2] for line in STATUS.read_text().splitlines())
    return 1024 * int(entries[entry].split()[0])
