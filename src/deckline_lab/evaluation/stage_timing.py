"""How long every stage takes, how late live answers are, both beside UFLD with ResNet-18 on the same engine."""

import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from deckline.dehaze import dehaze_for_display
from deckline.detect import Detector, OnnxDetector
from deckline.extras import needs_extra
from deckline.files import print_line
from deckline.flight import Flight
from deckline.live.messages import FrameCounts
from deckline.live.pipeline import LiveSession, Outputs
from deckline.live.source import Playback
from deckline.recording import Recording
from deckline.report.overlay import OVERLAY_PX, draw_overlay, draw_panels
from deckline.report.run import run
from deckline.report.video import VideoPiece
from deckline.types import Frame
from deckline_lab.evaluation.dehazers import read_memory, reset_peak
from deckline_lab.evaluation.detection_cost import cost_table, measure_costs
from deckline_lab.evaluation.tables import Figures, Table, number

ANSWER = ("decode", "detect", "localize", "track", "guide")  # stages from the file to guidance
FILM = ("dehaze", "film")  # and those that make the film
GUIDANCE = "guidance"  # all stages of an answer
PERCENTILES = (50, 95, 99)
PEER, PEER_NETWORK = "UFLD-R18", "ufld-r18"
PASSES = 30  # of each network, in turns


@dataclass(frozen=True)
class Timing:
    """Of one mode."""

    seconds: dict[str, list[float]]  # by stage, one a frame, in file mode without the first
    first_s: float  # of the first frame, from the beginning of its decoding or from its capture to its guidance
    peak_bytes: float | None  # most that was resident, models included; None without Linux's /proc

    def figures(self) -> dict[str, Any]:
        """JSON values: percentiles by stage, ms; the first answer, s; memory."""
        stages = {
            stage: {f"p{share}_ms": 1e3 * float(np.percentile(times, share)) for share in PERCENTILES}
            for stage, times in self.seconds.items()
        }
        return {"stages": stages, "first_s": self.first_s, "peak_bytes": self.peak_bytes}


def measure_file(source: Recording, flight: Flight, film: Path) -> Timing:
    """Every stage of every usable frame of a source, one after the other.

    Args:
        film: video file to write, as `deckline run` does.

    Raises:
        ValueError: fewer than two frames.
    """
    resident = reset_peak()
    with closing(VideoPiece(film, OVERLAY_PX)) as piece:
        frames = [_measure_frame(frame, decode_s, flight, piece) for frame, decode_s in _decode(source)]
    if len(frames) < 2:
        raise ValueError(f"{source.name} has {len(frames)} usable frames; the first one warms up, so two are needed")
    seconds = {stage: [frame[stage] for frame in frames[1:]] for stage in (*ANSWER, *FILM)}
    seconds[GUIDANCE] = [sum(frame[stage] for stage in ANSWER) for frame in frames[1:]]
    return Timing(seconds, sum(frames[0][stage] for stage in ANSWER), resident and read_memory("VmHWM"))


def measure_run(source: Recording, flight: Flight, out: Path) -> float:
    """Frames a second of `deckline run` into a new folder, film and report included."""
    start = time.perf_counter()
    return run(source, flight, out).frames / (time.perf_counter() - start)


def measure_live(source: Recording, flight: Flight) -> tuple[Timing, FrameCounts]:
    """The age of every answer, from capture to its message, of a recording played at its own pace.

    Raises:
        ValueError: no answer.
    """
    resident = reset_peak()
    quiet = Outputs(send=lambda _: None, log=print_line)
    summary = LiveSession(Playback(source), flight, quiet).run()
    if not summary.ages_s:
        raise ValueError(f"{source.name}: live mode gave no answer")
    peak = resident and read_memory("VmHWM")
    return Timing({"age of the answer": list(summary.ages_s)}, summary.ages_s[0], peak), summary.frames


def _decode(source: Recording) -> Iterator[tuple[Frame, float]]:
    """Usable frames and the seconds that each took to read, damaged ones before it included."""
    start = time.perf_counter()
    for item in source.items():
        if isinstance(item, Frame):
            yield item, time.perf_counter() - start
            start = time.perf_counter()


def _measure_frame(frame: Frame, decode_s: float, flight: Flight, piece: VideoPiece) -> Figures:
    """Seconds of every stage of one frame."""
    result = flight(frame)
    start = time.perf_counter()
    dehazed = result.dehazed or dehaze_for_display(frame, flight.dehazer, flight.config.models)
    dehaze_s = result.seconds.get("dehaze", time.perf_counter() - start)
    start = time.perf_counter()
    panels = draw_panels(result, dehazed)
    piece.add(draw_overlay(frame, result.guidance, panels), frame.time_s)
    film_s = time.perf_counter() - start
    return {**result.seconds, "dehaze": dehaze_s, "decode": decode_s, "film": film_s}


def measure_passes(detector: Detector, peer: Detector) -> dict[str, Figures]:
    """One pass of a detector's network and of the peer's, in turns; nothing for a detector without a network."""
    return measure_costs({detector.name: detector, PEER: peer}, PASSES) if isinstance(detector, OnnxDetector) else {}


def export_peer(folder: Path) -> Path:
    """UFLD with ResNet-18 as an ONNX file; its weights are random, which changes no time.

    Raises:
        ImportError: torch is not installed.
    """
    with needs_extra("train"):
        from deckline_lab.rivals.detectors import DETECTORS
        from deckline_lab.train.detect import DetectTrainConfig, export_detect
    return export_detect(DETECTORS[PEER_NETWORK](DetectTrainConfig()).eval(), folder / f"{PEER_NETWORK}.onnx", {}, 0)


def stage_table(title: str, figures: dict[str, Any], passes: dict[str, Figures]) -> Table:
    """A row a stage; the last column is its median as a share of one pass of the peer."""
    rows = [
        (stage, *(number(value, ".1f") for value in each.values()), _share(each["p50_ms"], passes))
        for stage, each in figures["stages"].items()
    ]
    return Table(title, ("ms", *(f"{share} %" for share in PERCENTILES), f"of {PEER}"), rows)


def pass_table(passes: dict[str, Figures]) -> Table:
    """A row a network; the last column is its time as a share of the peer's."""
    costs = cost_table(passes)
    shares = [_share(each["pass_ms"], passes) for each in passes.values()]
    rows = [(*row, share) for row, share in zip(costs.rows, shares, strict=True)]
    return replace(costs, columns=(*costs.columns, f"of {PEER}"), rows=rows)


def _share(value_ms: float, passes: dict[str, Figures]) -> str:
    return number(value_ms / passes[PEER]["pass_ms"] if passes else None, ".2f")
