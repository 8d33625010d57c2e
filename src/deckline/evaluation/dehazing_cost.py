"""What a dehazer costs: latency and peak memory, each run in a fresh process of its own.

    python -m deckline.evaluation.dehazing_cost TASK

is that process; TASK is JSON: {"dehazer", "source", "key", "size_px": [1280, 720], ...}. It prints {"seconds",
"peak_bytes"}. Peak memory is Linux's VmHWM: getrusage's peak, but it can be set back once everything is loaded, and
does not begin at the parent's size.
"""

import ctypes
import gc
import json
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

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
    """One run. A plain mapping of it goes to the process."""

    dehazer: str  # name in DEHAZERS, or absolute path of an .onnx file
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
        runs: of each dehazer.
        done: called after every run.
    """
    found: dict[str, list[Cost]] = {name: [] for name in tasks}
    failed: dict[str, str] = {}
    for _ in range(runs):
        for name, task in tasks.items():
            if name not in failed:
                outcome = _in_process(task)
                if isinstance(outcome, Cost):
                    found[name].append(outcome)
                else:
                    failed[name] = outcome
            done()
    return {name: _median(costs) for name, costs in found.items() if name not in failed}, failed


def _median(costs: list[Cost]) -> Cost:
    peaks = [cost.peak_bytes for cost in costs if cost.peak_bytes is not None]
    return Cost(statistics.median(cost.seconds for cost in costs), statistics.median(peaks) if peaks else None)


def _in_process(task: CostTask) -> Cost | str:
    """A run's cost, or why it failed."""
    command = [sys.executable, "-m", "deckline.evaluation.dehazing_cost", json.dumps(asdict(task))]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    if ended.returncode != 0:
        last = (ended.stderr.strip().splitlines() or [f"the process ended with {ended.returncode}"])[-1]
        return f"{last} (no memory left?)" if ended.returncode < 0 else last
    return Cost(**json.loads(ended.stdout))


def run_once(task: CostTask) -> Cost:
    """Cost of one run in this process: the second of two, and the peak memory of both."""
    source = open_pairs(Path(task.source), deck_z_m=task.deck_z_m, sea_z_m=task.sea_z_m)
    frame = _resized(source.load(task.key).frame, *task.size_px)
    dehazer = build_dehazer(task.dehazer, task.full_size)
    resident = _reset_peak()
    restore(dehazer, frame)
    start = time.perf_counter()
    restore(dehazer, frame)
    seconds = time.perf_counter() - start
    return Cost(seconds, None if resident is None else _memory("VmHWM") - resident)


def _resized(frame: Frame, width: int, height: int) -> Frame:
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
    return _memory("VmRSS")


def _memory(entry: str) -> int:
    """Bytes of one entry of /proc/self/status."""
    for line in STATUS.read_text().splitlines():
        name, _, value = line.partition(":")
        if name == entry:
            return 1024 * int(value.split()[0])
    raise ValueError(f"{STATUS} has no {entry}")


if __name__ == "__main__":
    given = json.loads(sys.argv[1])
    print(json.dumps(asdict(run_once(CostTask(**given | {"size_px": tuple(given["size_px"])})))))
