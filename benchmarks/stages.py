"""How long the chain's stages take on one 1280x720 frame, each as a ratio to its peer in the same run.

    python benchmarks/stages.py [--repeats 10] [--detector ufld-r18.onnx ...] [--peer "infer ufld-r18"]

The frame is of the shipped approach, with pose, deck height and sea, which the geometry dehazer needs. `infer` is one
pass of a detector's network; `detect` all passes in this frame, two or three where the detector sees the runway. Runs
are interleaved, so that a busy machine disturbs all alike; medians are printed.
"""

import argparse
import os
import platform
import statistics
import tempfile
import time
import zipfile
from collections.abc import Callable
from dataclasses import replace
from datetime import date
from pathlib import Path

from deckline.cli.run import SAMPLE
from deckline.config import Models, RunConfig, Tracking
from deckline.dehaze import DEHAZERS, NOT_DEHAZED, restore
from deckline.detect import DETECTORS, OnnxDetector
from deckline.detect.crop import full_crop, normalise, sample_crop
from deckline.flight import Flight
from deckline.recording import open_recording
from deckline.types import Frame

PEERS = {"dehaze": "dehaze dark-channel", "detect": "detect classical", "infer": "infer ufld"}  # by kind of stage
FRAME = 21  # of the shipped approach: the ship near, in haze that the sea tells
SEA_BELOW_DECK_M = 20.0  # of the sample's ship


def load_frame() -> Frame:
    """A frame of the shipped approach with pose, depth and the heights of deck and sea."""
    with tempfile.TemporaryDirectory() as folder, zipfile.ZipFile(SAMPLE) as archive:
        archive.extractall(folder)
        frame = open_recording(folder).load(FRAME)
    if frame.world_from_body is None or frame.deck_z_m is None:
        raise SystemExit(f"{SAMPLE}: frame {FRAME} has no pose or no deck height")
    return replace(frame, sea_z_m=frame.deck_z_m + SEA_BELOW_DECK_M)


def list_stages(frame: Frame, detectors: list[str]) -> dict[str, Callable[[], float]]:
    """Every stage by name; a call runs it and returns its wall time, s."""
    stages: dict[str, Callable[[], float]] = {}
    single = RunConfig(tracking=Tracking(enabled=False))
    for name in DEHAZERS:
        if name != NOT_DEHAZED:
            flight = Flight.from_config(replace(single, models=Models(name, "classical")))
            if reason := restore(flight.dehazer, frame).note:
                raise SystemExit(f"{name}, frame {FRAME}: {reason}")
            stages[f"dehaze {name}"] = lambda flight=flight: time_call(restore, flight.dehazer, frame)
    for name in (*DETECTORS, *detectors):
        flight = Flight.from_config(replace(single, models=Models(NOT_DEHAZED, name)))
        stages[f"detect {Path(name).stem}"] = lambda flight=flight: flight(frame).seconds["detect"]
        if isinstance(flight.detector, OnnxDetector):
            size = flight.detector.config.grid.size
            window = full_crop((frame.camera.width, frame.camera.height), size)
            view = normalise(sample_crop(frame.image_rgb, window, size))
            stages[f"infer {Path(name).stem}"] = lambda infer=flight.detector.infer, view=view: time_call(infer, view)
    return stages


def time_call(function: Callable[..., object], *arguments: object) -> float:
    """Wall time of a call, s."""
    start = time.perf_counter()
    function(*arguments)
    return time.perf_counter() - start


def main(repeats: int, detectors: list[str], peer: str | None) -> None:
    stages = list_stages(load_frame(), detectors)
    if peer is not None and peer not in stages:
        raise SystemExit(f"--peer {peer!r} is none of {', '.join(stages)}")
    rounds = [{name: stage() for name, stage in stages.items()} for _ in range(repeats + 1)][1:]  # the first warms up
    medians = {name: statistics.median(seconds[name] for seconds in rounds) for name in stages}
    print(f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}, {date.today()}")
    print(f"{'stage':26} {'ms':>8} {'ratio':>7}  peer")
    for name, median in medians.items():
        own_peer = peer or PEERS[name.partition(" ")[0]]
        print(f"{name:26} {1e3 * median:8.1f} {median / medians[own_peer]:7.2f}  {own_peer}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=10)
    parser.add_argument("--detector", nargs="*", default=[], help=".onnx files to measure too")
    parser.add_argument("--peer", help="one peer for all stages: a stage's name, as printed")
    given = parser.parse_args()
    main(given.repeats, given.detector, given.peer)
