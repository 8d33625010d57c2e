"""`deckline sim`: simulator frames into an AirSim-layout recording."""

import math
import shlex
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Literal

import numpy as np
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from deckline import __version__
from deckline.app.extras import needs_extra
from deckline.recording import RecordingWriter

with needs_extra("sim"):
    from deckline.sim import SimConfig, frames


def parse_visibility(text: str) -> tuple[float, float]:
    """'clear' -> (inf, inf); '800' -> (800, 800); '300..3000' -> (300, 3000). Metres at 2 % contrast.

    Raises:
        ValueError: anything else, or a range that is empty or not positive.
    """
    if text == "clear":
        return math.inf, math.inf
    low, _, high = text.partition("..")
    try:
        bounds = float(low), float(high or low)
    except ValueError:
        raise ValueError(f"visibility must be metres, LOW..HIGH or clear, got {text!r}") from None
    if not 0 < bounds[0] <= bounds[1]:
        raise ValueError(f"visibility needs 0 < LOW <= HIGH, got {text!r}")
    return bounds


def simulate(config: SimConfig, out: Path, image_format: Literal["png", "ppm"] = "png") -> None:
    """Write `config.frames` frames into the recording `out`, going on where an earlier call stopped.

    Raises:
        ValueError: `out` holds a recording made with other settings.
    """
    scene = {
        "generator": f"deckline {__version__}",
        "command": shlex.join(["deckline", *sys.argv[1:]]),
        **_what_decides_a_frame(config),
    }
    with RecordingWriter(out, image_format=image_format, scene=scene) as writer, _progress() as progress:
        task = progress.add_task("rendering", total=config.frames, completed=writer.count)
        for frame in frames(config, start=writer.count):
            writer.add(frame)
            progress.advance(task)
    print(out)


def _what_decides_a_frame(config: SimConfig) -> dict[str, object]:
    """Kept in scene.json: a recording made with other values is never continued. Infinity is written as text."""
    values = asdict(config)
    length = values.pop("frames")
    if config.trajectory == "approach":  # more frames of an approach are other frames
        values["length"] = length
    return {name: value if _is_plain(value) else str(value) for name, value in values.items()}


def _is_plain(value: object) -> bool:
    return not isinstance(value, float | tuple) or bool(np.all(np.isfinite(value)))


def _progress() -> Progress:
    return Progress(TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
