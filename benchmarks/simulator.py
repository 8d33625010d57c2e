"""How many frames a second the simulator renders, with depth: alone, over processes, and whether its memory stays flat.

    python benchmarks/simulator.py [--blocks 6] [--jobs 0]
    python benchmarks/simulator.py --blocks 0 --memory-frames 2000

A frame is everything that a recording's frame needs but its files: ship (a new one every 4 frames for preset train),
picture, depth, haze, camera. Cases are interleaved block by block, so that a busy machine disturbs all alike; medians
of blocks are printed. The peer is zlib (level 1) packing the pixels of the same frame: it runs anywhere, costs what
the frame's size costs, and no change to the simulator changes it. Needs numpy, scipy and moderngl alone.
"""

import argparse
import os
import platform
import statistics
import time
import zlib
from dataclasses import replace
from datetime import date
from importlib.metadata import version
from itertools import product
from pathlib import Path

import numpy as np

from deckline.types import Frame
from deckline_sim import SimConfig
from deckline_sim.config import DepthConfig
from deckline_sim.processes import process_count
from deckline_sim.record import CHUNK, map_frames
from deckline_sim.simulate import ShipSimulator

SIZES = ((1280, 720), (640, 360))
PRESETS = ("paper", "train")
AIR = {"clear": (float("inf"), float("inf")), "hazy": (300.0, 3000.0)}
BLOCK = 4  # frames that share a ship
MEMORY_SIZE = (160, 90)
CHECKPOINTS = 10  # of the memory's course
MIB = 2**20


def cases() -> dict[str, SimConfig]:
    """Every case by its name."""
    base = SimConfig(trajectory="random", frames=10**6, depth=DepthConfig(range_m=float("inf")), frames_per_ship=BLOCK)
    return {
        f"{preset:6} {air:6} {width}x{height}": replace(
            base, preset=preset, visibility_m=AIR[air], width=width, height=height
        )
        for (width, height), preset, air in product(SIZES, PRESETS, AIR)
    }


def alone(configs: dict[str, SimConfig], blocks: int) -> dict[str, tuple[float, float]]:
    """Median seconds a frame and median ratio to the peer, in this process."""
    simulators = {name: ShipSimulator(config) for name, config in configs.items()}
    seconds: dict[str, list[float]] = {name: [] for name in configs}
    ratios: dict[str, list[float]] = {name: [] for name in configs}
    for block in range(blocks + 1):  # the first warms up
        for name, simulator in simulators.items():
            start = time.perf_counter()
            frames = [simulator.frame(block * BLOCK + k) for k in range(BLOCK)]
            spent = (time.perf_counter() - start) / BLOCK
            if block > 0:
                seconds[name].append(spent)
                ratios[name].append(spent / peer_seconds(frames[0]))
    for simulator in simulators.values():
        simulator.close()
    return {name: (statistics.median(seconds[name]), statistics.median(ratios[name])) for name in configs}


def peer_seconds(frame: Frame) -> float:
    start = time.perf_counter()
    zlib.compress(frame.image_rgb.tobytes(), 1)
    return time.perf_counter() - start


def spread(config: SimConfig, blocks: int, jobs: int) -> float:
    """Seconds a frame over processes, once all of them are at work."""
    warm = 2 * CHUNK * jobs
    items = [(config, index) for index in range(warm + blocks * CHUNK * jobs)]
    start = 0.0
    for k, _ in enumerate(map_frames(checksum, items, jobs)):
        if k == warm:
            start = time.perf_counter()
    return (time.perf_counter() - start) / (len(items) - warm)


def checksum(frame: Frame) -> int:
    """Uses picture and depth and sends next to nothing back."""
    return zlib.crc32(frame.image_rgb) ^ zlib.crc32(np.ascontiguousarray(frame.depth_m))


def memory(frames: int) -> None:
    """Print this process's resident memory in the course of many small frames of random ships."""
    width, height = MEMORY_SIZE
    config = replace(next(iter(cases().values())), preset="train", width=width, height=height)
    print(f"\nresident memory, {frames} frames of preset train, {width}x{height} px, {frames // BLOCK} ships")
    with ShipSimulator(config) as simulator:
        for index in range(frames):
            simulator.frame(index)
            if (index + 1) % max(1, frames // CHECKPOINTS) == 0:
                print(f"{index + 1:8} frames {resident_mib():8.0f} MiB")
    print(f"{'peak':>15} {peak_mib():8.0f} MiB")


def resident_mib() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / MIB


def peak_mib() -> float:
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def speed(configs: dict[str, SimConfig], blocks: int, jobs: int) -> None:
    """Print the table of speeds."""
    print(f"\n{'case':24} {'ms':>7} {'frames/s':>9} {'ratio to zlib':>14} {f'frames/s, {jobs} processes':>24}")
    for name, (seconds, ratio) in alone(configs, blocks).items():
        pooled = f"{1 / spread(configs[name], blocks, jobs):24.1f}" if jobs > 1 else f"{'-':>24}"
        print(f"{name:24} {1e3 * seconds:7.1f} {1 / seconds:9.1f} {ratio:14.2f} {pooled}", flush=True)


def main(blocks: int, jobs: int, memory_frames: int) -> None:
    configs = cases()
    with ShipSimulator(next(iter(configs.values()))) as simulator:
        info = simulator.renderer.context.info
    packages = ", ".join(f"{name} {version(name)}" for name in ("numpy", "moderngl"))
    print(f"{platform.machine()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, {date.today()}")
    print(f"Python {platform.python_version()}, {packages}")
    print(f"OpenGL {info['GL_VERSION']}, {info['GL_RENDERER']}")
    if blocks:
        speed(configs, blocks, process_count(jobs))
    if memory_frames:
        memory(memory_frames)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--blocks", type=int, default=6, help="measured blocks of 4 frames a case; 0: none")
    parser.add_argument("--jobs", type=int, default=0, help="processes; 0: one for every core")
    parser.add_argument("--memory-frames", type=int, default=0, help="frames of the memory's course; 0: none")
    arguments = parser.parse_args()
    main(arguments.blocks, arguments.jobs, arguments.memory_frames)
