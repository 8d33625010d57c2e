"""`deckline eval flicker`: how steady each dehazer's pictures are along a recording."""

import sys
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import tyro
from numpy.typing import NDArray

from deckline.dehaze import DEHAZERS, NOT_DEHAZED, Dehazer, restore
from deckline.evaluation.dehazing_methods import build_dehazer, by_name
from deckline.evaluation.flicker_score import REGIONS, flicker_figures, sequence_errors
from deckline.evaluation.tables import TO_TERMINAL, Output, Table, number, publish
from deckline.progress import progress
from deckline.recording import FrameError, open_recording
from deckline.types import Frame

CLEAR = "clear"  # the truth without haze; every table has it, and NOT_DEHAZED, the input
MEASURED = tuple(name for name in DEHAZERS if name != NOT_DEHAZED)
COLUMNS = {
    "error, levels": "rmse",
    "temporal PSNR, dB": "psnr_db",
    "flicker, levels": "flicker",
    "jump, levels": "jump",
    "pump, levels": "pump",
}


def flicker(
    source: tyro.conf.Positional[Path],
    dehazer: tuple[str, ...] = MEASURED,
    every: int = 1,
    limit: int | None = None,
    camera_depth_m: float = 200.0,
    output: Output = TO_TERMINAL,
) -> int:
    """Measure how steady dehazed pictures are along a recording with poses, depth and clear truth.

    Each picture is moved onto the next one by the true depth and poses, and what differs is printed: for the deck and
    what stands as high, for the water below, and for the sky. flicker is how far patches a fortieth of the picture
    wide differ beyond the clear truth's own; jump how much more than the truth's the mean colour changes from frame to
    frame; pump the part of the jump that is no steady drift.

    Record with deckline sim --trajectory approach --depth.range-m inf.

    Args:
        source: recording folder.
        dehazer: names or .onnx files; the hazy input ("none") and the clear truth are always measured.
        every: take every so many-th frame.
        limit: stop after so many frames.
        camera_depth_m: the dehazers see the recorded depth up to here, as a depth camera would; 0 hides it.
        output: files of the results.
    """
    for name, value, least in (("every", every, 1), ("limit", limit, 2), ("camera-depth-m", camera_depth_m, 0)):
        if value is not None and not value >= least:
            raise ValueError(f"--{name} must be at least {least}, got {value}")
    named = by_name(name for name in dehazer if name != NOT_DEHAZED)
    if CLEAR in named:
        raise ValueError(f"{named[CLEAR]} would be called {CLEAR}, as the truth is: rename the file or its folder")
    dehazers = {name: build_dehazer(given) for name, given in named.items()}
    steps = _restore_all(source, every, limit, dehazers, camera_depth_m)
    figures = flicker_figures(list(sequence_errors(steps)), truth=CLEAR)
    title = f"{source}: pairs of frames: {figures['pairs']:.0f}, every {every}, depth up to {camera_depth_m:g} m"
    tables = [_table(region, [CLEAR, NOT_DEHAZED, *dehazers], figures) for region in REGIONS]
    publish(title, tables, figures, output)
    return 0


def _restore_all(
    source: Path, every: int, limit: int | None, dehazers: Mapping[str, Dehazer], camera_depth_m: float
) -> Iterator[tuple[Frame, dict[str, NDArray[np.uint8]]] | None]:
    """Every so many-th frame of a recording, `limit` at most, with its pictures; None for one that cannot be read."""
    recording = open_recording(source)
    indices = range(0, len(recording), every)[:limit]
    notes = set()
    with progress("evaluating", len(indices)) as advance:
        for index in indices:
            advance()
            try:
                frame = recording.load(index)
            except FrameError as error:
                print(f"skipped {error}", file=sys.stderr)
                yield None
                continue
            pictures = {CLEAR: clear_picture(frame), NOT_DEHAZED: frame.image_rgb}
            for name, dehazer in dehazers.items():
                restored = restore(dehazer, without_truth(frame, camera_depth_m))
                pictures[name] = restored.image_rgb
                if restored.note and (name, restored.note) not in notes:
                    notes.add((name, restored.note))
                    print(f"{frame.file}: {name}: {restored.note}", file=sys.stderr)
            yield frame, pictures


def without_truth(frame: Frame, camera_depth_m: float) -> Frame:
    """What a dehazer may see of a frame: no truth, and depth only as far as a depth camera reaches; 0: none."""
    depth = None
    if frame.depth_m is not None and camera_depth_m > 0:
        with np.errstate(invalid="ignore"):
            depth = np.where(frame.depth_m <= camera_depth_m, frame.depth_m, np.float32(np.nan))
    return replace(frame, depth_m=depth, truth=None)


def clear_picture(frame: Frame) -> NDArray[np.uint8]:
    """The frame without its haze (H, W, 3).

    Raises:
        ValueError: there is none.
    """
    if frame.truth is not None and frame.truth.clear_rgb is not None:
        return frame.truth.clear_rgb
    if frame.truth is not None and frame.truth.visibility_m == np.inf:
        return frame.image_rgb
    raise ValueError(f"{frame.file}: no picture without haze to compare with; record with deckline sim, which keeps it")


def _table(region: str, names: list[str], figures: Mapping[str, float]) -> Table:
    rows = [
        (name, *(number(figures.get(f"{name}.{region}.{key}"), ".2f") for key in COLUMNS.values())) for name in names
    ]
    return Table(region, ("dehazer", *COLUMNS), rows)
