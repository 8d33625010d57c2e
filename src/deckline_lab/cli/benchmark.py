"""`deckline benchmark`."""

import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import Any

import tyro

from deckline.cli.run import unpack_sample
from deckline.config import Engine
from deckline.detect import Detector, OnnxDetector
from deckline.flight import Flight
from deckline.live.pipeline import live_config
from deckline.options import DEFAULTS, FlightOptions
from deckline.recording import open_recording, select_frames
from deckline.runtime import describe_processor
from deckline_lab.evaluation import stage_timing as measure
from deckline_lab.evaluation.tables import Figures, OutputFiles, publish
from deckline_lab.rivals.catalog import flight_from_config


def benchmark(
    source: tyro.conf.Positional[Path | None] = None,
    out: Path | None = None,
    every: int = 1,
    start: float = 0.0,
    duration: float | None = None,
    peer: Path | None = None,
    options: FlightOptions = DEFAULTS,
) -> int:
    """Measure how long every stage takes on this machine, and how late live answers are.

    The recording is answered frame after frame, run as `deckline run` does with film and report, and played at its own
    pace. Stages are compared with one pass of UFLD with ResNet-18 on the same engine.

    Args:
        source: recording, folder of images or video; the shipped approach when not given.
        out: JSON file of the figures.
        every: take one frame of so many.
        start: seconds after the first frame at which to begin.
        duration: seconds of the recording to take.
        peer: .onnx file of UFLD with ResNet-18; without it one is made with torch, if that is installed.
        options: of the configuration.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        opened = unpack_sample(folder / "approach") if source is None else open_recording(source)
        chosen = select_frames(opened, every, start, duration)
        config = options.run_config(opened.base_config)
        flight = flight_from_config(config)
        networks: dict[str, Any] = {"dehazer": flight.dehazer, "detector": flight.detector}
        whole = measure.measure_file(chosen, flight, folder / "film.mp4")
        run_rate = measure.measure_run(chosen, Flight.from_config(config, **networks), folder / "run")
        live, progress = measure.measure_live(chosen, Flight.from_config(live_config(config), **networks))
        passes, notes = _measure_passes(flight.detector, peer, config.engine, folder)
    file_figures, live_figures = whole.figures(), live.figures() | asdict(progress)
    guided = whole.seconds[measure.GUIDANCE]
    rates = {"guidance": len(guided) / sum(guided), "film and report": run_rate}
    file_figures["frames_per_s"] = rates
    tables = [
        measure.stage_table("file: one frame after the other", file_figures, passes),
        measure.stage_table("live: the recording at its own pace", live_figures, passes),
        *([measure.pass_table(passes)] if passes else []),
    ]
    words = [f"{value:.1f} frames/s to {name}" for name, value in rates.items()]
    notes += [f"file: {', '.join(words)}; {_describe(whole)}"]
    notes += [f"live: {progress.dropped} of {progress.frames} frames dropped; {_describe(live)}"]
    figures: dict[str, Any] = {"processor": describe_processor(), "engine": asdict(config.engine)}
    figures |= {"file": file_figures, "live": live_figures, "passes": passes}
    engine = f"{config.models.detector} on {config.engine.device} {config.engine.precision}"
    title = f"{'shipped approach' if source is None else source}: {len(chosen)} frames, {engine}, "
    title += f"{config.engine.threads or 'all'} threads\n{figures['processor']}"
    publish(title, tables, figures, OutputFiles(json=out), notes)
    return 0


def _measure_passes(
    detector: Detector, peer: Path | None, engine: Engine, folder: Path
) -> tuple[dict[str, Figures], list[str]]:
    """One pass of the detector and of the peer; nothing and the reason where there is no peer."""
    try:
        other = OnnxDetector(peer or measure.export_peer(folder), engine=engine, compare=True)
    except ImportError as error:
        return {}, [f"no ratios to {measure.PEER}: {error}"]
    return measure.measure_passes(detector, other), []


def _describe(timing: measure.Timing) -> str:
    memory = "" if timing.peak_bytes is None else f"; at most {timing.peak_bytes / 2**20:.0f} MiB resident"
    return f"first answer after {timing.first_s:.2f} s{memory}"


COMMANDS = {"benchmark": benchmark}
EXAMPLES = {
    "deckline benchmark": (
        "deckline benchmark --threads 2",
        "deckline benchmark flights/first --device openvino --precision bf16 --out profile.json",
    ),
}
