"""`deckline sim`: frames rendered over processes, into an AirSim-layout recording or a contact sheet."""

import os
import shlex
import sys
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from functools import partial
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from deckline import __version__
from deckline.checks import check_numbers
from deckline.config_file import settings_to_json
from deckline.recording import RecordingWriter
from deckline.recording.writer import ImageFormat, encode_frame
from deckline.report.draw import check_picture_name, write_picture
from deckline.types import Frame
from deckline_sim.config import FLIGHTS, LARGEST_PX, SimConfig
from deckline_sim.processes import Jobs, map_ordered, works_here
from deckline_sim.progress import progress
from deckline_sim.simulate import ShipSimulator, open_simulator, ship_block

if TYPE_CHECKING:
    from deckline_sim.airfield.simulator import AirfieldSimulator

CHUNK = 4  # most frames in one task of a process; at most 2 * CHUNK * jobs results wait for their turn
T = TypeVar("T")
Item = tuple[SimConfig, int]  # a recording and the index of one of its frames
NOT_DECIDING = ("--out", "--jobs", "--ray")  # options of a command that do not change what it makes
LEFT_RGB, RIGHT_RGB = (255, 0, 0), (0, 255, 0)  # of the true lines in a contact sheet
DOTS = 240  # of each true line: close views show a tenth of it


def map_frames(
    task: Callable[[Frame], T], items: Sequence[Item], jobs: Jobs = 1, total: int | None = None
) -> Generator[T, None, None]:
    """`task(frame)` of every item, in their order and the same whatever `jobs` is; see `map_ordered`.

    Args:
        task: what is done to a frame where it is rendered; picklable when jobs is not 1.
        items: frames; neighbours that share a ship are rendered by one process.
        jobs: who renders: 1: this process, 0: a process for every core, or a Ray cluster.
        total: frames of the whole work, of which the items are the last, for a bar on the screen; None: no bar.

    Raises:
        ValueError: negative jobs.
        OSError: no OpenGL on this machine, or a process died.
    """
    if total is not None:
        yield from show_progress("rendering", map_frames(task, items, jobs), total, total - len(items))
    elif works_here(jobs):
        for config, group in groupby(items, key=itemgetter(0)):
            with open_simulator(config) as simulator:
                for _, index in group:
                    yield task(simulator.frame(index))
    else:
        with closing(map_ordered(partial(_render_chunk, task), _split_chunks(items), jobs)) as chunks:
            for results in chunks:
                yield from results


def show_progress(what: str, results: Generator[T, None, None], total: int, done: int = 0) -> Generator[T, None, None]:
    """The results, which are closed at last, with a bar on the screen."""
    with closing(results), progress(what, total, done) as advance:
        for result in results:
            yield result
            advance()


_opened: "dict[SimConfig, ShipSimulator | AirfieldSimulator]" = {}  # the last recording's, in a rendering process


def _render_chunk(task: Callable[[Frame], T], chunk: list[Item]) -> list[T]:
    config = chunk[0][0]
    if config not in _opened:
        for other in list(_opened):
            _opened.pop(other).close()
        _opened[config] = open_simulator(config)
    return [task(_opened[config].frame(index)) for _, index in chunk]


def _split_chunks(items: Sequence[Item]) -> Iterator[list[Item]]:
    """Neighbours of one recording and one ship, at most CHUNK of them."""
    for _, group in groupby(items, key=lambda item: (id(item[0]), ship_block(*item))):
        same_ship = list(group)
        for first in range(0, len(same_ship), CHUNK):
            yield same_ship[first : first + CHUNK]


@dataclass(frozen=True)
class ContactSheetConfig:
    """A contact sheet."""

    tile_px: int = 320  # width of a frame in the picture; frames are rendered at their full size and shrunk
    columns: int = 6  # frames beside each other
    truth: bool = False  # dot the true lines, left red and right green

    def __post_init__(self) -> None:
        check_numbers(self, "sheet", least=1, most=LARGEST_PX)


def simulate(config: SimConfig, out: Path, image_format: ImageFormat = "png", jobs: Jobs = 1) -> None:
    """Write `config.frames` frames into the recording `out`, going on where an earlier call stopped.

    Args:
        jobs: who renders; the files are the same whoever does.

    Raises:
        ValueError: `out` holds a recording made with other settings.
        OSError: the disk refuses, or rendering stopped.
    """
    origin = {"generator": f"deckline {__version__}", "command": repeatable_command()}
    with RecordingWriter(out, image_format=image_format, scene=origin | frame_settings(config)) as writer:
        items = [(config, index) for index in range(writer.count, config.frames)]
        encode = partial(encode_frame, image_format=image_format)
        with closing(map_frames(encode, items, jobs, config.frames)) as encoded_frames:
            for encoded in encoded_frames:
                writer.append(encoded)
    print(out)


def write_contact_sheet(config: SimConfig, out: Path, sheet: ContactSheetConfig, jobs: Jobs = 1) -> None:
    """Render `config.frames` frames into one picture, written whole or not at all.

    Raises:
        ValueError: a file name that ends neither in .png nor in .jpg, or a folder that cannot be written.
        OSError: the disk refuses, or rendering stopped.
    """
    check_picture_name(out, "a contact sheet")
    out.parent.mkdir(parents=True, exist_ok=True)
    if not os.access(out.parent, os.W_OK):
        raise ValueError(f"{out}: its folder cannot be written")
    tile = partial(make_tile, width_px=sheet.tile_px, with_truth=sheet.truth)
    items = [(config, index) for index in range(config.frames)]
    with closing(map_frames(tile, items, jobs, config.frames)) as tiles:
        write_picture(out, join_tiles(list(tiles), sheet.columns))
    print(out)


def join_tiles(tiles: Sequence[NDArray[np.uint8]], columns: int) -> NDArray[np.uint8]:
    """Pictures of one size (H, W, 3) row by row, (rows * H, columns * W, 3); what is left over stays black."""
    filled = [*tiles, *[np.zeros_like(tiles[0])] * (-len(tiles) % columns)]
    return np.concatenate([np.concatenate(filled[k : k + columns], axis=1) for k in range(0, len(filled), columns)])


def make_tile(frame: Frame, width_px: int, with_truth: bool) -> NDArray[np.uint8]:
    """A frame's image, shrunk to a width when it is wider, with its true lines dotted if asked for."""
    image = frame.image_rgb.copy()
    if width_px < frame.camera.width:
        height_px = max(1, round(frame.camera.height * width_px / frame.camera.width))
        image = np.asarray(cv2.resize(image, (width_px, height_px), interpolation=cv2.INTER_AREA), dtype=np.uint8)
    if with_truth:
        _dot_lines(frame, image)
    return image


def _dot_lines(frame: Frame, image: NDArray[np.uint8]) -> None:
    """Draw the true lines into an image of the frame, whatever its size."""
    if frame.truth is None or frame.true_world_from_camera is None:
        return
    camera_from_world = frame.true_world_from_camera.inv()
    height, width, _ = image.shape
    scale = [width / frame.camera.width, height / frame.camera.height]
    steps = np.linspace(0.0, 1.0, DOTS)[:, None]
    for segment, colour in ((frame.truth.left, LEFT_RGB), (frame.truth.right, RIGHT_RGB)):
        if segment is None:
            continue
        points = segment.p0_m + steps * (segment.p1_m - segment.p0_m)
        pixels = (frame.camera.project(camera_from_world.apply(points)) + 0.5) * scale - 0.5
        pixels = pixels[np.all(np.isfinite(pixels), axis=1)]
        inside = np.all((pixels >= 0) & (pixels < [width - 0.5, height - 0.5]), axis=1)
        u, v = np.rint(pixels[inside]).astype(int).T
        image[v, u] = colour


def frame_settings(config: SimConfig) -> dict[str, Any]:
    """The settings in scene.json: a recording made with others is never continued. Infinity is written as text."""
    values = asdict(config)
    length = values.pop("frames")
    if config.trajectory in FLIGHTS:  # more frames of an approach are other frames
        values["length"] = length
    return dict(settings_to_json(values))


def repeatable_command() -> str:
    """The command line without the options that do not change its result: the folder, and who works."""
    words, skip = [], False
    for word in sys.argv[1:]:
        is_value = skip and not word.startswith("-")  # --ray may have none
        skip = word in NOT_DECIDING
        if not is_value and word.partition("=")[0] not in NOT_DECIDING:
            words.append(word)
    return shlex.join(["deckline", *words])
