"""`deckline benchmark`."""

import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import tyro

from deckline.cli.run import DEFAULTS, unpack_sample
from deckline.detect import OnnxDetector
from deckline.evaluation import benchmark as measure
from deckline.evaluation.tables import OutputFiles, publish
from deckline.flight import Flight
from deckline.options import RunOptions
from deckline.recording import open_recording, select_frames
from deckline.runtime import describe_processor


def benchmark(
    source: tyro.conf.Positional[Path | None] = None,
    out: Path | None = None,
    every: int = 1,
    start: float = 0.0,
    duration: float | None = None,
    peer: Path | None = None,
    options: Annotated[RunOptions, tyro.conf.arg(name="")] = DEFAULTS,
) -> int:
    """Measure how long every stage takes on this machine, beside UFLD with ResNet-18 on the same engine.

    Args:
        source: recording, folder of images or video; the shipped approach when not given.
        out: JSON file of the figures.
        every: take one frame of so many.
        start: seconds after the first frame at which to begin.
        duration: seconds of the recording to take.
        peer: .onnx file of UFLD with ResNet-18; without it one is made with torch, if that is installed.
        options: of the configuration.
    """
    config = options.run_config()
    flight = Flight.from_config(config)
    notes, looks = [], {}
    with tempfile.TemporaryDirectory() as folder:
        opened = unpack_sample(Path(folder) / "approach") if source is None else open_recording(source)
        timing = measure.measure_file(select_frames(opened, every, start, duration), flight, Path(folder) / "film.mp4")
        try:
            other = OnnxDetector(peer or measure.export_peer(Path(folder)), engine=config.engine)
            looks = measure.measure_looks(flight.detector, other)
        except ImportError as error:
            notes.append(f"no ratios to {measure.PEER}: {error}")
    peer_ms = looks[measure.PEER]["pass_ms"] if looks else None
    stages = measure.summarise(timing.seconds)
    figures: dict[str, Any] = {"processor": describe_processor(), "engine": asdict(config.engine), "looks": looks}
    figures["file"] = {"stages": stages, "first_s": timing.first_s, "peak_bytes": timing.peak_bytes}
    frames = len(timing.seconds["guidance"])
    per_s = {name: frames / sum(timing.seconds[name]) for name in measure.WHOLE}
    figures["file"]["frames_per_s"] = per_s
    tables = [measure.stage_table("file, frame after frame", stages, peer_ms)]
    tables += [measure.look_table(looks)] if looks else []
    memory = "" if timing.peak_bytes is None else f", at most {timing.peak_bytes / 2**20:.0f} MiB resident"
    notes.insert(0, ", ".join(f"{value:.1f} frames/s to {name}" for name, value in per_s.items()) + memory)
    notes.insert(1, f"first answer {timing.first_s:.2f} s after the first frame's file is opened")
    engine = f"{config.engine.device} {config.engine.precision}, threads: {config.engine.threads or 'all'}"
    title = f"{'shipped approach' if source is None else source}: {frames} frames, {config.models.detector} on {engine}"
    publish(f"{title}\n{figures['processor']}", tables, figures, OutputFiles(json=out), notes)
    return 0
