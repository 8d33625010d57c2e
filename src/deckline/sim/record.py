"""`deckline sim`: simulator frames into an AirSim-layout recording, or into one picture to look at."""

import math
import os
import shlex
import sys
from contextlib import closing
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from deckline import __version__
from deckline.extras import needs_extra
from deckline.progress import progress
from deckline.recording import RecordingWriter
from deckline.recording.writer import ImageFormat, encode_frame
from deckline.sim.parallel import map_frames

with needs_extra("sim"):
    from deckline.sim import SimConfig
    from deckline.sim.config import FLIGHTS
    from deckline.sim.sheet import join_tiles, sheet_tile

NOT_DECIDING = ("--out", "--jobs")  # options of a command that do not change what it makes


@dataclass(frozen=True)
class SheetConfig:
    """A contact sheet.

    Args:
        tile_px: width of a frame in the picture; frames are rendered at their full size and shrunk.
        columns: frames beside each other.
        truth: dot the true lines, left red and right green.

    Raises:
        ValueError: a number below 1.
    """

    tile_px: int = 320
    columns: int = 6
    truth: bool = False

    def __post_init__(self) -> None:
        for name in ("tile_px", "columns"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(self, name)}")


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


def visibility_text(visibility_m: tuple[float, float]) -> str:
    """What `parse_visibility` reads back."""
    low, high = visibility_m
    if math.isinf(low):
        return "clear"
    return f"{low:g}" if low == high else f"{low:g}..{high:g}"


def simulate(config: SimConfig, out: Path, image_format: ImageFormat = "png", jobs: int = 1) -> None:
    """Write `config.frames` frames into the recording `out`, going on where an earlier call stopped.

    Args:
        jobs: processes that render; the files are the same whatever it is. 0: one for every core.

    Raises:
        ValueError: `out` holds a recording made with other settings.
        OSError: the disk refuses, or rendering stopped.
    """
    scene = {
        "generator": f"deckline {__version__}",
        "command": repeatable_command(),
        **what_decides_a_frame(config),
    }
    with RecordingWriter(out, image_format=image_format, scene=scene) as writer:
        items = [(config, index) for index in range(writer.count, config.frames)]
        encode = partial(encode_frame, image_format=image_format)
        rendered = closing(map_frames(encode, items, jobs))
        with progress("rendering", config.frames, writer.count) as advance, rendered as encoded_frames:
            for encoded in encoded_frames:
                writer.append(encoded)
                advance()
    print(out)


def write_sheet(config: SimConfig, out: Path, sheet: SheetConfig, jobs: int = 1) -> None:
    """Render `config.frames` frames into one picture, written whole or not at all.

    Raises:
        ValueError: a file name that ends neither in .png nor in .jpg, or a folder that cannot be written.
        OSError: the disk refuses, or rendering stopped.
    """
    from deckline.report.draw import check_picture_name, write_picture  # needs OpenCV, which recordings can do without

    check_picture_name(out, "a contact sheet")
    out.parent.mkdir(parents=True, exist_ok=True)
    if not os.access(out.parent, os.W_OK):
        raise ValueError(f"{out}: its folder cannot be written")
    tile = partial(sheet_tile, width_px=sheet.tile_px, with_truth=sheet.truth)
    rendered = closing(map_frames(tile, [(config, index) for index in range(config.frames)], jobs))
    tiles = []
    with progress("rendering", config.frames) as advance, rendered as pictures:
        for picture in pictures:
            tiles.append(picture)
            advance()
    write_picture(out, join_tiles(tiles, sheet.columns))
    print(out)


def what_decides_a_frame(config: SimConfig) -> dict[str, Any]:
    """Kept in scene.json: a recording made with other values is never continued. Infinity is written as text."""
    values = asdict(config)
    length = values.pop("frames")
    if config.trajectory in FLIGHTS:  # more frames of an approach are other frames
        values["length"] = length
    return {name: plain(value) for name, value in values.items()}


def plain(value: Any) -> Any:
    """The value as JSON holds it: tuples are lists, infinity and NaN are text."""
    if isinstance(value, dict):
        return {name: plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def repeatable_command() -> str:
    """The command as it was typed, without what does not change its result: the folder and the processes."""
    kept, skip = [], False
    for word in sys.argv[1:]:
        if not skip and word.partition("=")[0] not in NOT_DECIDING:
            kept.append(word)
        skip = word in NOT_DECIDING
    return shlex.join(["deckline", *kept])
