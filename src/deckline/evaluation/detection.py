"""`deckline eval detection`: how well both lines are found, and how often where there are none."""

import math
import sys
from functools import partial
from pathlib import Path
from typing import Annotated

import tyro

from deckline.dehaze import NOT_DEHAZED
from deckline.evaluation.commands import JsonFile
from deckline.evaluation.detection_frames import FrameSet, Rendered, named, open_recorded
from deckline.evaluation.detection_measure import DetectionScore
from deckline.evaluation.detection_scores import NOT_LABELLED, Method, evaluate, open_book
from deckline.evaluation.detection_tables import NOTES, detection_tables, flat_figures, report
from deckline.evaluation.detection_worst import worst_of, write_worst
from deckline.evaluation.expectation import drawn_expectation
from deckline.extras import needs_extra
from deckline.pipeline import Pipeline, PipelineConfig
from deckline.report.provenance import settings_of
from deckline.types import Detection, Frame

FRAMES, DECKLESS = 200, 100  # rendered when no source is given
SKIPPED_SHOWN = 5
MarkdownFile = Annotated[Path | None, tyro.conf.arg(name="markdown")]


def detection(
    sources: tyro.conf.Positional[tuple[Path, ...]] = (),
    frames: int | None = None,
    deckless: int | None = None,
    preset: tuple[str, ...] = ("paper",),
    seed: int = 1000,
    visibility: str = "500..3000",
    range_m: tuple[float, float] | None = None,
    fov_deg: float = 90.0,
    dehazer: str = NOT_DEHAZED,
    detector: str = PipelineConfig.detector,
    told_within_m: float | None = None,
    out: Path | None = None,
    worst: int = 0,
    json_file: JsonFile = None,
    markdown_file: MarkdownFile = None,
) -> int:
    """Find the lines in frames whose lines are known: found-rate, false lines, errors, lane scores, calibration.

    Prints figures of all frames, then by range, visibility, light, contrast and ship. With --out, a stopped command
    goes on where it was when it is given again.

    Args:
        sources: recordings with truth, folders with labels.json, or folders of recordings.
        frames: rendered afresh of each preset, from random viewpoints; 200 when no source is given.
        deckless: rendered afresh without a runway in the image; 100 when no source is given.
        preset: ships of the rendered frames: paper, cvn, axial, small, runway, train.
        seed: of the simulator; the shipped weights never saw seeds from 1000 on.
        visibility: of the rendered frames, metres at 2 % contrast, LOW..HIGH or clear.
        range_m: distance of the rendered frames from the ramp; 60 to 800 m, 30 to 1500 m for preset train.
        fov_deg: horizontal field of view of the rendered frames; preset train draws its own.
        dehazer: name or .onnx file, whose pictures the detector sees; none: the hazy ones, as in the chain.
        detector: name or .onnx file.
        told_within_m: the chain is told beforehand where the runway is, wrong by draws of this 1-sigma and 2 degrees,
            and of one somewhere in view where there is none.
        out: folder of the scores of every frame and of the worst frames' pictures.
        worst: so many of the worst frames become pictures in --out, with a line of figures each in worst.md.
        json_file: write the figures here as well.
        markdown_file: write the tables here as well.
    """
    _check(frames, deckless, worst, out)
    if told_within_m is not None and not (math.isfinite(told_within_m) and told_within_m >= 0):
        raise ValueError(f"--told-within-m must be a number of metres, 0 or more, got {told_within_m}")
    sets = all_sets(sources, frames, deckless, preset, seed, visibility, range_m, fov_deg)
    pipeline = Pipeline(PipelineConfig(dehazer, detector, detect_in="dehazed"))
    told = {} if told_within_m is None else {"told_within_m": told_within_m}
    book = open_book(out, {**settings_of(pipeline), **told, "frames": [item.settings for item in sets]})
    evaluate(sets, [Method(partial(_find, pipeline, told_within_m), book)])
    title = f"{named(sets)}; dehazer {dehazer}, detector {detector}"
    title += "" if told_within_m is None else f", told where the runway is within {told_within_m:g} m"
    lengths = {item.name: len(item) for item in sets}  # an earlier command may have scored more frames
    scores = [score for score in book.scores.values() if score.index < lengths[score.source]]
    _report(scores, [why for why in book.skipped.values() if why != NOT_LABELLED], title, json_file, markdown_file)
    if out is not None and worst:
        print(write_worst(out, {item.name: item for item in sets}, worst_of(scores, worst), pipeline))
    for item in sets:
        item.close()
    return 0


def _find(pipeline: Pipeline, told_within_m: float | None, frame: Frame) -> Detection:
    told = None if told_within_m is None else drawn_expectation(frame, told_within_m)
    return pipeline(frame, told).detection


def _check(frames: int | None, deckless: int | None, worst: int, out: Path | None) -> None:
    for name, value in (("--frames", frames), ("--deckless", deckless), ("--worst", worst)):
        if value is not None and value < 0:
            raise ValueError(f"{name} must not be negative, got {value}")
    if worst and out is None:
        raise ValueError("--worst needs --out FOLDER for its pictures")


def all_sets(
    sources: tuple[Path, ...],
    frames: int | None,
    deckless: int | None,
    presets: tuple[str, ...],
    seed: int,
    visibility: str,
    range_m: tuple[float, float] | None,
    fov_deg: float,
) -> list[FrameSet]:
    """Recorded frames, and rendered ones where they are asked for or nothing is recorded.

    Raises:
        ValueError: a source that cannot be evaluated, an unknown preset, or a value that the simulator refuses.
        ImportError: the sim extra is not installed.
    """
    sets = open_recorded(sources)
    frames = frames if frames is not None else 0 if sources else FRAMES
    deckless = deckless if deckless is not None else 0 if sources else DECKLESS
    if frames or deckless:
        sets += rendered_sets(frames, deckless, presets, seed, visibility, range_m, fov_deg)
    return sets


def rendered_sets(
    frames: int,
    deckless: int,
    presets: tuple[str, ...],
    seed: int,
    visibility: str,
    range_m: tuple[float, float] | None,
    fov_deg: float,
) -> list[FrameSet]:
    """Fresh frames of every preset, and some without a runway.

    Raises:
        ValueError: an unknown preset, or a value that the simulator refuses.
        ImportError: the sim extra is not installed.
    """
    with needs_extra("sim"):
        from deckline.sim import SimConfig
        from deckline.sim.record import parse_visibility
    config = SimConfig(
        preset="train",
        trajectory="deckless",
        frames=max(deckless, 1),
        visibility_m=parse_visibility(visibility),
        seed=seed,
        fov_deg=fov_deg,
        keep_clear=False,
        range_m=range_m,
        frames_per_ship=1,
    )
    sets: list[FrameSet] = []
    if frames:
        several = SimConfig.frames_per_ship
        values = vars(config) | {"frames": frames, "frames_per_ship": several, "trajectory": "random"}
        sets += [Rendered(SimConfig(**(values | {"preset": preset}))) for preset in dict.fromkeys(presets)]
    return [*sets, Rendered(config)] if deckless else sets


def _report(
    scores: list[DetectionScore], skipped: list[str], title: str, json_file: Path | None, markdown_file: Path | None
) -> None:
    for reason in skipped[:SKIPPED_SHOWN]:
        print(f"skipped {reason}", file=sys.stderr)
    if len(skipped) > SKIPPED_SHOWN:
        print(f"skipped {len(skipped)} frames in all", file=sys.stderr)
    report(title, detection_tables(scores), [NOTES], flat_figures(scores), json_file, markdown_file)
