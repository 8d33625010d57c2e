"""How long the chain's stages take on one 1280x720 frame, as ratios to a peer in the same run.

    python benchmarks/stages.py [--repeats 10] [--detector ufld-r18.onnx ...] [--peer "look ufld-r18"]

`look` is one pass of a detector's network; `detect` all that it makes in a frame of the shipped approach, two or three
where it sees the runway. Runs are interleaved, so that a busy machine disturbs all alike; medians are printed.
"""

import argparse
import os
import platform
import statistics
import tempfile
import time
import zipfile
from collections.abc import Callable
from datetime import date
from pathlib import Path

import numpy as np

from deckline.cli.run import SAMPLE
from deckline.dehaze import DEHAZERS
from deckline.detect import DETECTORS, Detector, OnnxDetector
from deckline.detect.crop import full_crop, normalise, sample_crop
from deckline.evaluation.dehazing_methods import file_label
from deckline.recording import open_recording

PEER = "dehaze dark-channel"
FRAME = 22  # of the shipped approach: the ship near, in haze


def sample_image() -> np.ndarray:
    """A frame of the shipped approach, (720, 1280, 3)."""
    with tempfile.TemporaryDirectory() as folder, zipfile.ZipFile(SAMPLE) as archive:
        archive.extractall(folder)
        image = open_recording(folder).load(FRAME).image_rgb
    resized = sample_crop(image, full_crop((image.shape[1], image.shape[0]), (1280, 720)), (1280, 720))
    return np.rint(resized).astype(np.uint8)


def stages_of(image: np.ndarray, detectors: list[Path]) -> dict[str, Callable[[np.ndarray], object]]:
    """Every stage by name."""
    stages: dict[str, Callable[[np.ndarray], object]] = {}
    stages |= {f"dehaze {name}": build() for name, build in DEHAZERS.items() if name != "none"}
    named: dict[str, Detector] = {name: build() for name, build in DETECTORS.items()}
    named |= {file_label(path): OnnxDetector(path) for path in detectors}
    for name, detector in named.items():
        stages[f"detect {name}"] = detector
        if isinstance(detector, OnnxDetector):
            size = (detector.config.grid.width, detector.config.grid.height)
            view = normalise(sample_crop(image, full_crop((1280, 720), size), size))
            stages[f"look {name}"] = lambda _, infer=detector.infer, view=view: infer(view)
    return stages


def main(repeats: int, detectors: list[Path], peer_name: str) -> None:
    image = sample_image()
    stages = stages_of(image, detectors)
    if peer_name not in stages:
        raise SystemExit(f"--peer {peer_name!r} is none of {', '.join(stages)}")
    seconds: dict[str, list[float]] = {name: [] for name in stages}
    for stage in stages.values():
        stage(image)
    for _ in range(repeats):
        for name, stage in stages.items():
            start = time.perf_counter()
            stage(image)
            seconds[name].append(time.perf_counter() - start)
    peer = statistics.median(seconds[peer_name])
    print(f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}, {date.today()}")
    print(f"{'stage':28} {'ms':>8} {'ratio to ' + peer_name:>30}")
    for name, values in seconds.items():
        median = statistics.median(values)
        print(f"{name:28} {1e3 * median:8.1f} {median / peer:30.2f}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=10)
    parser.add_argument("--detector", type=Path, nargs="*", default=[], help=".onnx files to measure as well")
    parser.add_argument("--peer", default=PEER, help="a stage's name, as printed")
    given = parser.parse_args()
    main(given.repeats, given.detector, given.peer)
