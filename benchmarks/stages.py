"""How long the chain's stages take on one 1280x720 frame, as ratios to the dark channel prior in the same run.

    python benchmarks/stages.py [--repeats 10]

Runs are interleaved, so that a busy machine disturbs all alike; medians are printed.
"""

import argparse
import os
import platform
import statistics
import time
from collections.abc import Callable
from datetime import date

import numpy as np

from deckline.dehaze import DEHAZERS
from deckline.detect import DETECTORS

PEER = "dehaze dark-channel"
SIZE = (720, 1280, 3)


def main(repeats: int) -> None:
    image = np.random.default_rng(0).integers(0, 256, SIZE, dtype=np.uint8)
    stages: dict[str, Callable[[np.ndarray], object]] = {}
    stages |= {f"dehaze {name}": build() for name, build in DEHAZERS.items() if name != "none"}
    stages |= {f"detect {name}": build() for name, build in DETECTORS.items()}
    seconds: dict[str, list[float]] = {name: [] for name in stages}
    for stage in stages.values():
        stage(image)
    for _ in range(repeats):
        for name, stage in stages.items():
            start = time.perf_counter()
            stage(image)
            seconds[name].append(time.perf_counter() - start)
    peer = statistics.median(seconds[PEER])
    print(f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}, {date.today()}")
    print(f"{'stage':28} {'ms':>8} {'ratio to ' + PEER:>30}")
    for name, values in seconds.items():
        median = statistics.median(values)
        print(f"{name:28} {1e3 * median:8.1f} {median / peer:30.2f}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=10)
    main(parser.parse_args().repeats)
