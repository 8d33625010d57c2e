"""`deckline eval`: tables on the screen, the same figures as JSON."""

import json
import math
import os
import platform
import sys
from collections.abc import Iterable
from datetime import date
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro
from rich.console import Console
from rich.progress import track
from rich.table import Table

from deckline import __version__
from deckline.dehaze import NOT_DEHAZED
from deckline.evaluation.chain import (
    RANGE_BANDS_M,
    VISIBILITY_BANDS_M,
    FrameScore,
    by_band,
    score_frame,
    summarise,
)
from deckline.evaluation.labels import LabelScore, score_labels, summarise_labels
from deckline.labels import LABELS_FILE, read_labels
from deckline.pipeline import Picture, Pipeline, PipelineConfig
from deckline.recording import open_recording
from deckline.types import SIDES, Frame

FILE_COLUMNS = 150  # of tables that go to a file or a pipe
JsonFile = Annotated[Path | None, tyro.conf.arg(name="json")]


def chain(
    frames: int = 200,
    seed: int = 1000,
    preset: Literal["paper", "cvn", "train"] = "paper",
    visibility: str = "500..3000",
    range_m: tuple[float, float] = (60.0, 800.0),
    fov_deg: float = 90.0,
    dehazer: str = PipelineConfig.dehazer,
    detector: str = PipelineConfig.detector,
    detect_in: Picture = PipelineConfig.detect_in,
    json_file: JsonFile = None,
) -> int:
    """Run the whole chain on freshly rendered frames with exact truth and print its errors.

    Args:
        frames: how many, from random viewpoints.
        seed: of the simulator; the shipped weights never saw seeds from 1000 on.
        preset: the ship.
        visibility: metres at 2 % contrast, LOW..HIGH.
        range_m: distance from the ramp, nearest and farthest.
        fov_deg: horizontal field of view.
        dehazer: name or .onnx file; none to skip dehazing.
        detector: name or .onnx file.
        detect_in: the picture that lines are looked for in.
        json_file: write the figures here as well.
    """
    from deckline.sim import frames as render
    from deckline.sim.record import SimConfig, parse_visibility

    config = SimConfig(
        preset=preset,
        trajectory="random",
        frames=frames,
        visibility_m=parse_visibility(visibility),
        seed=seed,
        fov_deg=fov_deg,
        range_m=range_m,
        keep_clear=True,
    )
    title = (
        f"{frames} simulated frames, preset {preset}, seed {seed}, V {visibility} m, {range_m[0]:g}-{range_m[1]:g} m"
    )
    return _evaluate(render(config), frames, title, PipelineConfig(dehazer, detector, detect_in=detect_in), json_file)


def recording(
    source: tyro.conf.Positional[Path],
    dehazer: str = PipelineConfig.dehazer,
    detector: str = PipelineConfig.detector,
    detect_in: Picture = PipelineConfig.detect_in,
    json_file: JsonFile = None,
) -> int:
    """Run the whole chain on a recording that carries truth (scene.json) and print its errors.

    Args:
        source: recording folder.
        dehazer: name or .onnx file; none to skip dehazing.
        detector: name or .onnx file.
        detect_in: the picture that lines are looked for in.
        json_file: write the figures here as well.
    """
    opened = open_recording(source)
    config = PipelineConfig(dehazer, detector, detect_in=detect_in)
    return _evaluate(opened, len(opened), str(source), config, json_file)


def labels(
    folders: tyro.conf.Positional[list[Path]],
    deck_z_m: float | None = None,
    dehazer: str = NOT_DEHAZED,
    detector: str = PipelineConfig.detector,
    json_file: JsonFile = None,
) -> int:
    """Find the lines in images that carry labels (labels.json beside them) and print the distance to them in pixels.

    Args:
        folders: image folders with camera.toml and labels.json.
        deck_z_m: world z of the deck plane, for the status after localization.
        dehazer: name or .onnx file, whose pictures the detector sees; none: the hazy ones, as in the chain.
        detector: name or .onnx file.
        json_file: write the figures here as well.
    """
    pipeline = Pipeline(PipelineConfig(dehazer, detector, detect_in="dehazed"))
    scores = []
    for folder in folders:
        lines = read_labels(folder / LABELS_FILE)
        for frame in open_recording(folder, deck_z_m=deck_z_m):
            if frame.file in lines:
                scores.append(score_labels(pipeline(frame), lines[frame.file]))
    figures = summarise_labels(scores)
    console = heading(f"{len(scores)} labelled frames; dehazer {dehazer}, detector {detector}")
    table = Table("frame", "status", *(f"{side} {what}, px" for side in SIDES for what in ("median", "95 %")))
    for score in scores:
        table.add_row(score.file, score.status, *(cell for side in SIDES for cell in _quantile_cells(score, side)))
    console.print(table)
    _print_figures(console, figures)
    return _finish(figures, json_file)


def _quantile_cells(score: LabelScore, side: str) -> list[str]:
    if side not in score.errors_px:
        return ["-", "-"]
    return [f"{np.percentile(score.errors_px[side], percent):.2f}" for percent in (50, 95)]


def _evaluate(frames: Iterable[Frame], total: int, title: str, config: PipelineConfig, json_file: Path | None) -> int:
    pipeline = Pipeline(config)
    scores = []
    for frame in track(frames, "evaluating", total=total, console=Console(stderr=True)):
        scores.append(score_frame(pipeline(frame)))
    figures = summarise(scores)
    chain = f"dehazer {config.dehazer}, detector {config.detector} in the {config.detect_in} picture"
    _print_tables(scores, figures, f"{title}; {chain}")
    return _finish(figures, json_file)


def _finish(figures: dict[str, float], json_file: Path | None) -> int:
    if json_file is not None:
        write_json(json_file, figures)
        print(json_file)
    return 0


def write_json(path: Path, figures: dict[str, float]) -> None:
    """Write figures under their dotted names; a number that does not exist is null."""
    plain = {name: value if math.isfinite(value) else None for name, value in figures.items()}
    partial = path.with_name(path.name + ".part")
    partial.write_text(json.dumps(plain, indent=1) + "\n")
    partial.replace(path)


def _print_tables(scores: list[FrameScore], figures: dict[str, float], title: str) -> None:
    console = heading(title)
    _print_figures(console, figures)
    bands = by_band(scores, "range_m", RANGE_BANDS_M), by_band(scores, "visibility_m", VISIBILITY_BANDS_M)
    for what, groups in zip(("range to the ramp", "visibility"), bands, strict=True):
        console.print(_band_table(what, groups))


def heading(title: str) -> Console:
    """A console on which what was measured, where and when is already printed."""
    console = Console(width=None if sys.stdout.isatty() else FILE_COLUMNS)
    console.print(f"[bold]{title}[/bold]")
    console.print(
        f"deckline {__version__}, {platform.machine()} with {os.cpu_count()} cores, "
        f"Python {platform.python_version()}, {date.today()}"
    )
    return console


def _print_figures(console: Console, figures: dict[str, float]) -> None:
    table = Table("figure", "value")
    for name, value in figures.items():
        table.add_row(name, f"{value:.4g}")
    console.print(table)


def _band_table(what: str, groups: dict[str, list[FrameScore]]) -> Table:
    columns = {
        "found": "found_rate",
        "direction left, deg": "direction_error_deg.left.median",
        "right, deg": "direction_error_deg.right.median",
        "lateral left, m": "lateral_error_at_ramp_m.left.median",
        "right, m": "lateral_error_at_ramp_m.right.median",
        "points left, px": "point_error_px.left.median",
        "right, px": "point_error_px.right.median",
        "hazy, dB": "psnr_db_hazy.mean",
        "dehazed, dB": "psnr_db.mean",
        "without sky, dB": "psnr_db_surface.mean",
    }
    table = Table(what, "frames", *columns)
    for label, members in groups.items():
        figures = summarise(members)
        cells = (f"{figures[name]:.3g}" if name in figures else "-" for name in columns.values())
        table.add_row(label, str(len(members)), *cells)
    return table
