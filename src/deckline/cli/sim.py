"""`deckline sim` and `deckline dataset`: everything behind them needs the sim extra."""

import math
import sys
from collections.abc import Sequence
from contextlib import redirect_stderr
from dataclasses import dataclass, field, fields
from io import StringIO
from pathlib import Path
from typing import Annotated, Any, TypeVar

import tyro

from deckline.adapters.airsim.server import ServeConfig, serve_sim
from deckline.recording.writer import ImageFormat
from deckline.sim import CLEAR, SimConfig
from deckline.sim.camera.depth_camera import DepthConfig
from deckline.sim.dataset import DatasetConfig, write_dataset
from deckline.sim.manifest import MANIFEST, check_dataset
from deckline.sim.record import SheetConfig, parse_visibility, simulate, visibility_text, write_sheet

T = TypeVar("T")
SHEET_OPTION, SERVE_OPTION = "--contact-sheet", "--serve"
Visibility = Annotated[
    tuple[float, float],
    tyro.conf.arg(name="visibility", help="metres at 2 % contrast: one value, a range to draw from, or clear."),
    tyro.constructors.PrimitiveConstructorSpec(
        nargs=1,
        metavar="METRES|LOW..HIGH|clear",
        instance_from_str=lambda words: parse_visibility(words[0]),
        is_instance=lambda value: isinstance(value, tuple),
        str_from_instance=lambda value: [visibility_text(value)],
    ),
]


@dataclass(frozen=True)
class SimOptions(SimConfig):
    """What to simulate, with the command's own defaults."""

    frames: int = 40
    visibility_m: Visibility = (300.0, 3000.0)

    def plain(self) -> SimConfig:
        """The same values as the simulator's own class."""
        return SimConfig(**{item.name: getattr(self, item.name) for item in fields(SimConfig)})


RECORDING = SimOptions()
SHEET = SimOptions(preset="train", trajectory="random", frames=48, frames_per_ship=1, visibility_m=(500.0, 10000.0))
# As AirSim: clear air until a client asks for fog, and a depth camera that sees to the horizon.
SERVED = SimOptions(visibility_m=CLEAR, depth=DepthConfig(range_m=math.inf))


@dataclass(frozen=True)
class SimCommand:
    """Render a recording of a deck: images, depth, poses and exact truth lines, in AirSim's layout.

    A stopped command goes on where it was when it is given again. With --contact-sheet, one picture of many frames is
    rendered instead, of random ships unless told otherwise. With --serve, AirSim's clients fly and look around in it.

    Args:
        out: folder of the recording.
        contact_sheet: write this .png or .jpg of all the frames, and no recording.
        sheet: the contact sheet.
        jobs: processes that render; 0 takes as many as there are cores. The files are the same whatever it is.
        image_format: png, or ppm where OpenCV is not installed.
        serve: answer AirSim's clients until Ctrl-C; what they record becomes folders in --out, default recordings.
        server: the server.
        config: what to render.
    """

    out: Path | None = None
    contact_sheet: Path | None = None
    serve: bool = False
    server: Annotated[ServeConfig, tyro.conf.arg(name="")] = field(default_factory=ServeConfig)
    sheet: SheetConfig = field(default_factory=SheetConfig)
    jobs: int = 1
    image_format: ImageFormat = "png"
    config: Annotated[SimOptions, tyro.conf.arg(name="")] = RECORDING

    def run(self) -> int:
        if self.serve:
            if self.contact_sheet is not None:
                raise ValueError("deckline sim takes --serve or --contact-sheet, not both")
            serve_sim(self.config.plain(), self.server, self.out)
            return 0
        if (self.out is None) == (self.contact_sheet is None):
            raise ValueError(
                "deckline sim needs --out FOLDER for a recording, --contact-sheet FILE for a picture, or --serve"
            )
        if self.out is not None:
            simulate(self.config.plain(), self.out, self.image_format, self.jobs)
        if self.contact_sheet is not None:
            write_sheet(self.config.plain(), self.contact_sheet, self.sheet, self.jobs)
        return 0


@dataclass(frozen=True)
class DatasetOptions(DatasetConfig):
    """The paper's dataset, with the visibility as the command line has it."""

    visibility_m: Visibility = DatasetConfig.visibility_m

    def plain(self) -> DatasetConfig:
        """The same values as the dataset's own class."""
        return DatasetConfig(**{item.name: getattr(self, item.name) for item in fields(DatasetConfig)})


@dataclass(frozen=True)
class DatasetCommand:
    """Render the paper's dataset: 600 clear and hazy pairs with depth, 421 for training and 179 for testing, in tiles.

    A stopped command goes on where it was when it is given again. For any number of fully random training frames see
    deckline sim --preset train --trajectory random.

    Args:
        out: folder of the dataset.
        check: render nothing; compare every file in the folder with its manifest.
        jobs: processes that render; 0 takes as many as there are cores. The files are the same whatever it is.
        config: what to render.
    """

    out: tyro.conf.Positional[Path]
    check: bool = False
    jobs: int = 1
    config: Annotated[DatasetOptions, tyro.conf.arg(name="")] = field(default_factory=DatasetOptions)

    def run(self) -> int:
        if self.check:
            print(f"{self.out}: all {check_dataset(self.out, self.jobs)} files are as {MANIFEST} says")
        else:
            write_dataset(self.config.plain(), self.out, self.jobs)
        return 0


def dataset(args: Sequence[str]) -> int:
    """Parse and run `deckline dataset ARGS`."""
    return _parsed(DatasetCommand, "deckline dataset", args).run()


def sim(args: Sequence[str]) -> int:
    """Parse and run `deckline sim ARGS`."""
    words = {word.replace("_", "-").partition("=")[0] for word in args}
    usual = SHEET if SHEET_OPTION in words else SERVED if SERVE_OPTION in words else RECORDING
    return _parsed(SimCommand, "deckline sim", args, SimCommand(config=usual)).run()


def _parsed(kind: type[T], prog: str, args: Sequence[str], default: T | None = None) -> T:
    """A command line's values; a value that a configuration refuses is a ValueError, so that it ends in one line.

    Raises:
        ValueError: a value out of its range.
        SystemExit: help was asked for, or the words make no command line; what to say is said.
    """
    said = StringIO()
    try:
        with redirect_stderr(said):
            if default is None:
                return tyro.cli(kind, prog=prog, args=args)
            return tyro.cli(kind, prog=prog, args=args, default=default)
    except SystemExit as ended:
        refusal: Any = ended.__context__
        if hasattr(refusal, "message") and hasattr(refusal, "arg"):  # tyro's InstantiationError
            option = "" if isinstance(refusal.arg, str) else f"{refusal.arg.lowered.name_or_flags[0]}: "
            raise ValueError(f"{option}{refusal.message}") from None
        print(said.getvalue(), end="", file=sys.stderr)
        raise
