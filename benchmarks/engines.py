"""What an engine costs and what it changes: time of one pass of a detector's network, lines and P(runway) against f32.

    python benchmarks/engines.py RECORDING... [--frames 15] [--repeats 30] [--detectors hybrid hybrid-int8]

The first detector on ONNX Runtime in f32 is the reference.

Views are the closest views of the search on frames spread over each recording. Passes are interleaved, so that a busy
machine disturbs all engines alike; medians are printed, with the processor's time beside wall time.
"""

import argparse
import time
from collections.abc import Iterator
from datetime import date
from importlib.metadata import version

import numpy as np

from deckline.config import CPU, Engine
from deckline.detect import DETECTORS, OnnxDetector
from deckline.detect.anchors import decode, decode_region
from deckline.detect.crop import Crop, normalise, sample_crop
from deckline.recording import open_recording
from deckline.runtime import describe_processor
from deckline.runtime.engines import list_precisions
from deckline.types import Detection

ENGINES = {f"{one.device} {one.precision}": one for one in (CPU, Engine("openvino"), Engine("openvino", None, "bf16"))}
MIN_CONFIDENCE = 0.5  # of an anchor in the reference, for its point to be compared

View = tuple[np.ndarray, float]  # what the network sees (3, height, width), and picture pixels per network pixel


def list_views(recordings: list[str], frames: int, reference: OnnxDetector) -> Iterator[tuple[np.ndarray, View]]:
    """Pictures and their closest views; a picture without lines is left out."""
    size = reference.config.grid.size
    for recording in map(open_recording, recordings):
        for index in np.linspace(0, len(recording) - 1, frames).round().astype(int):
            picture = recording.load(int(index)).image_rgb
            region = reference(picture).region_px
            if region is not None:
                crop = Crop(region[0] + 0.5, region[1] + 0.5, (region[2] - region[0]) / size[0])
                yield picture, (normalise(sample_crop(picture, crop, size)), crop.step)


def compare(detector: OnnxDetector, reference: OnnxDetector, view: View) -> tuple[np.ndarray, float]:
    """By how many picture pixels the points of the row anchors move, and P(runway) changes."""
    seen, step = view
    outputs = [one.infer(seen) for one in (detector, reference)]
    config = reference.config
    moves = []
    for line, known in zip(*(output.rows for output in outputs), strict=True):
        points, expected = (decode(rows, config.grid, config.decode) for rows in (line, known))
        both = np.isfinite(points.x_px) & (expected.confidence >= MIN_CONFIDENCE)
        moves.append(step * np.abs(points.x_px - expected.x_px)[both])
    one, two = (decode_region(output.region, output.box).probability for output in outputs)
    return np.concatenate(moves), abs(one - two)


def count(detection: Detection) -> int:
    """Edge lines found."""
    return (len(detection.left) > 0) + (len(detection.right) > 0)


def print_times(names: list[str], view: np.ndarray, repeats: int) -> None:
    """Median time of one pass, for one and two threads of every engine."""
    passes = {
        (f"{name} {key}", threads): DETECTORS[name](Engine(one.device, threads, one.precision)).infer
        for threads in (1, 2)
        for name in names
        for key, one in ENGINES.items()
    }
    wall, used = ({key: [] for key in passes} for _ in range(2))
    for _ in range(repeats + 3):
        for key, infer in passes.items():
            start, start_used = time.perf_counter(), time.process_time()
            infer(view)
            wall[key].append(time.perf_counter() - start)
            used[key].append(time.process_time() - start_used)
    print(f"\n{'engine':26} {'threads':>7} {'wall ms':>8} {'fastest':>8} {'CPU ms':>7} {'CPU ratio':>9}")
    for key in passes:
        times = [1e3 * value for value in (np.median(wall[key][3:]), min(wall[key]), np.median(used[key][3:]))]
        ratio = times[2] / (1e3 * np.median(used[f"{names[0]} cpu f32", 1][3:]))
        print(f"{key[0]:26} {key[1]:7} {times[0]:8.1f} {times[1]:8.1f} {times[2]:7.1f} {ratio:9.2f}")


def main(recordings: list[str], frames: int, repeats: int, names: list[str]) -> None:
    if "bf16" not in list_precisions("openvino"):
        del ENGINES["openvino bf16"]
    packages = ", ".join(f"{package} {version(package)}" for package in ("onnxruntime", "openvino"))
    print(f"{describe_processor()}, {packages}, {date.today()}")
    detectors = {f"{name} {key}": DETECTORS[name](engine) for name in names for key, engine in ENGINES.items()}
    reference = detectors.pop(f"{names[0]} cpu f32")
    views = list(list_views(recordings, frames, reference))
    found = [count(reference(picture)) for picture, _ in views]
    print(f"{len(views)} views\n{'engine':26} {'median px':>9} {'95 % px':>8} {'most dP':>8} {'same lines':>12}")
    for key, detector in detectors.items():
        moves, changes = zip(*(compare(detector, reference, view) for _, view in views), strict=True)
        low, high = np.percentile(np.concatenate(moves), [50, 95])
        same = sum(count(detector(picture)) == number for (picture, _), number in zip(views, found, strict=True))
        print(f"{key:26} {low:9.4f} {high:8.4f} {max(changes):8.5f} {same:4} of {len(views)}", flush=True)
    print_times(names, views[0][1][0], repeats)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recordings", nargs="+")
    parser.add_argument("--frames", type=int, default=15)
    parser.add_argument("--repeats", type=int, default=30)
    parser.add_argument("--detectors", nargs="+", default=["hybrid", "hybrid-int8"])
    given = parser.parse_args()
    main(given.recordings, given.frames, given.repeats, given.detectors)
