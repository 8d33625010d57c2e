"""Delay of live MPEG-TS over the loopback: deckline's receiver, an older revision's, and FFmpeg's own udp: protocol.

    python benchmarks/stream.py [--seconds 20] [--old 9c6fe99]

One process codes 1280x720 at 30 Hz (H.264, ultrafast, zerolatency) and sends every datagram to each receiver. Each
receiver is a process of its own. A picture shows its number. Delay: from the end of coding to the decoded picture.
Arrival: what the receiver states as the time of arrival, minus the end of coding.
"""

import importlib.util
import multiprocessing
import os
import platform
import queue
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from datetime import date
from fractions import Fraction
from pathlib import Path
from types import ModuleType
from typing import Any

import av
import numpy as np
import tyro

from deckline.live.datagrams import Receiver, is_transport
from deckline.live.decoding import decode_container, decode_stream

RATE_HZ, SIZE, BITS, BLOCK_PX = 30, (1280, 720), 12, 64
PES_LENGTH = {"unstated": "1", "stated": "0"}  # FFmpeg's muxer leaves it out; GStreamer's states it up to 64 KiB
NAMES = ("old", "deckline", "FFmpeg udp:", "FFmpeg udp:, no parser")
LOW_DELAY = {"fflags": "nobuffer", "flags": "low_delay", "protocol_whitelist": "udp", "localaddr": "127.0.0.1"}
LOW_DELAY |= {"probesize": "500000", "analyzeduration": "500000"}
Times = dict[int, tuple[float, float]]  # number of a picture -> decoded, stated arrival, s


def main(seconds: float = 20.0, old: str = "9c6fe99") -> None:
    print(f"{platform.processor() or platform.machine()}, {os.cpu_count()} CPUs, load {os.getloadavg()[0]:.1f}")
    print(f"PyAV {av.__version__}, old revision {old}, {date.today()}\n")
    print("| PES length | receiver | delay, median ms | 95 % | later than old, pictures | ratio | arrival, ms | seen |")
    print("|---|---|---|---|---|---|---|---|")
    for length, option in PES_LENGTH.items():
        sent, received = measure(seconds, old, option)
        common = set(sent).intersection(*received.values())
        delay = {name: np.array([received[name][n][0] - sent[n] for n in common]) for name in NAMES}
        arrival = {name: np.array([received[name][n][1] - sent[n] for n in common]) for name in NAMES}
        reference = np.median(delay["old"])
        for name in NAMES:
            median, late = np.median(delay[name]), np.percentile(delay[name], 95)
            pictures, ratio = (median - reference) * RATE_HZ, median / reference
            print(
                f"| {length} | {name} | {1e3 * median:.1f} | {1e3 * late:.1f} | {pictures:.2f} | {ratio:.1f} "
                f"| {1e3 * np.median(arrival[name]):.1f} | {len(received[name])} of {len(sent)} |"
            )


def measure(seconds: float, old: str, omit_length: str) -> tuple[dict[int, float], dict[str, Times]]:
    """When each picture was sent, and what each receiver measured."""
    context = multiprocessing.get_context("spawn")
    ports, answers, stopped = free_ports(len(NAMES)), context.Queue(), context.Event()
    arguments = [(name, port, old, answers, stopped) for name, port in zip(NAMES, ports, strict=True)]
    receivers = [context.Process(target=receive, args=each) for each in arguments]
    for receiver in receivers:
        receiver.start()
    for _ in NAMES:
        answers.get(timeout=60)
    time.sleep(0.5)
    sent = send(seconds, ports, omit_length)
    stopped.set()
    received = dict(answers.get(timeout=60) for _ in NAMES)
    for receiver in receivers:
        receiver.join()
    return sent, received


def free_ports(count: int) -> list[int]:
    probes = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(count)]
    for probe in probes:
        probe.bind(("127.0.0.1", 0))
    ports = [probe.getsockname()[1] for probe in probes]
    for probe in probes:
        probe.close()
    return ports


class Wire:
    """What a muxer writes, in datagrams to every port."""

    def __init__(self, ports: list[int]) -> None:
        self._link, self._ports, self._rest = socket.socket(socket.AF_INET, socket.SOCK_DGRAM), ports, bytearray()

    def write(self, data: bytes) -> int:
        self._rest.extend(data)
        while len(self._rest) >= 188:
            size = min(len(self._rest) // 188, 7) * 188
            for port in self._ports:
                self._link.sendto(self._rest[:size], ("127.0.0.1", port))
            del self._rest[:size]
        return len(data)


def send(seconds: float, ports: list[int], omit_length: str) -> dict[int, float]:
    """Number of each picture -> when its coding ended, monotonic clock."""
    sent: dict[int, float] = {}
    muxer = {"omit_video_pes_length": omit_length}
    with av.open(Wire(ports), "w", format="mpegts", options=muxer, container_options=muxer) as container:
        coder = container.add_stream("libx264", rate=RATE_HZ, options={"preset": "ultrafast", "tune": "zerolatency"})
        (coder.width, coder.height), coder.pix_fmt, coder.gop_size = SIZE, "yuv420p", RATE_HZ
        scene = np.random.default_rng(0).integers(100, 106, (SIZE[1], SIZE[0], 3), dtype=np.uint8)
        start_s = time.monotonic()
        for number in range(round(seconds * RATE_HZ)):
            time.sleep(max(start_s + number / RATE_HZ - time.monotonic(), 0.0))
            picture = av.VideoFrame.from_ndarray(draw_number(scene, number), format="rgb24")
            picture.pts, picture.time_base = number, Fraction(1, RATE_HZ)
            packets = coder.encode(picture)
            sent[number] = time.monotonic()
            container.mux(packets)
    return sent


def draw_number(scene: np.ndarray, number: int) -> np.ndarray:
    shown = np.roll(scene, number, axis=1)
    for bit in range(BITS):
        shown[:BLOCK_PX, bit * BLOCK_PX : (bit + 1) * BLOCK_PX] = 220 * (number >> bit & 1)
    return shown


def read_number(picture: Any) -> int:
    luma = np.frombuffer(picture.planes[0], np.uint8).reshape(-1, picture.planes[0].line_size)
    row = luma[BLOCK_PX // 2]
    return sum(int(row[bit * BLOCK_PX + BLOCK_PX // 2] > 110) << bit for bit in range(BITS))


def receive(name: str, port: int, old: str, answers: Any, stopped: Any) -> None:
    """Measure one receiver in a process of its own."""
    ended, times = threading.Event(), {}
    pictures = open_receiver(name, port, old, ended)
    answers.put(name)
    found: queue.Queue[Any] = queue.Queue()
    threading.Thread(target=collect, args=(pictures, found), daemon=True).start()
    while not stopped.is_set() or not found.empty():
        try:
            picture, decoded_s = found.get(timeout=0.1)
        except queue.Empty:
            continue
        if picture.image is not None and not picture.damage:
            times[read_number(picture.image)] = (decoded_s, picture.arrival_s)
    ended.set()
    answers.put((name, times))


def collect(pictures: Iterator[Any], found: "queue.Queue[Any]") -> None:
    try:
        for picture in pictures:
            found.put((picture, time.monotonic()))
    except av.error.FFmpegError:
        return  # silence after the last picture


def open_receiver(name: str, port: int, old: str, ended: threading.Event) -> Iterator[Any]:
    address = f"udp://127.0.0.1:{port}"
    if name == "old":
        datagrams, transport = load_old(old)
        return transport.decode_stream(datagrams.Receiver(address, ended, transport.transport_packets), ended)
    if name == "deckline":
        return decode_stream(Receiver(address, ended, is_transport), ended)
    flags = {"fflags": "nobuffer+noparse+nofillin"} if "no parser" in name else {}
    return decode_container(lambda: av.open(address, format="mpegts", options=LOW_DELAY | flags, timeout=(20.0, 1.0)))


def load_old(revision: str) -> tuple[ModuleType, ModuleType]:
    """The modules live/datagrams.py and live/transport.py of a revision that has them."""
    modules = []
    with tempfile.TemporaryDirectory() as folder:
        for module in ("datagrams", "transport"):
            source = subprocess.check_output(["git", "show", f"{revision}:src/deckline/live/{module}.py"], text=True)
            path = Path(folder) / f"old_{module}.py"
            path.write_text(source.replace("from deckline.live.datagrams", "from old_datagrams"), encoding="utf-8")
            spec = importlib.util.spec_from_file_location(path.stem, path)
            assert spec is not None and spec.loader is not None
            modules.append(importlib.util.module_from_spec(spec))
            sys.modules[path.stem] = modules[-1]
            spec.loader.exec_module(modules[-1])
    return modules[0], modules[1]


if __name__ == "__main__":
    tyro.cli(main)
