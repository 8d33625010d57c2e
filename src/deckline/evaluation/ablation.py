"""`deckline eval ablation`: the paper's Table 5, trained and measured by one command.

OUT/recipe.json            what the rows are made with
OUT/<row>/                 checkpoint, ONNX file and figures of each row, as `deckline train dehaze` writes them
OUT/images.jsonl           one line for each test image and row; a stopped command goes on after the last one
OUT/ablation.json, .md     the table
"""

import json
import math
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
import tyro

from deckline.dehaze import Dehazer, OnnxDehazer
from deckline.evaluation.ablation_measure import Figures, RowSummary, TrainedRow, summarise_rows
from deckline.evaluation.dehazing_score import FIGURES, restoration
from deckline.evaluation.statistics import Difference
from deckline.evaluation.tables import Table, number, publish
from deckline.extras import needs_extra
from deckline.progress import progress
from deckline.recording import FrameError, Source, open_recording
from deckline.report.records import keep_whole_lines, read_records
from deckline.runtime.weights import sha256_of
from deckline.types import Frame

if TYPE_CHECKING:
    from deckline.train.dehaze import DehazeTrainConfig

HAZY = "hazy"  # the row that does nothing
IMAGES_FILE = "images.jsonl"
INTERRUPTED = 130  # the shell's code for a program ended by Ctrl-C
COLUMNS = (
    "row",
    "PSNR, dB",
    "gain [95 %]",
    "SSIM",
    "no sky, dB",
    "gain [95 %]",
    "M param.",
    "GMACs",
    "steps",
    "minutes",
    "paper, dB",
)
CAPTION = (
    "Each row adds one part to the row above, and its gain is over that row on the same images. MACs at 256x256 px. "
    "The paper's PSNR is on its own pictures. Images of one flight resemble each other: the intervals are too narrow."
)

Scores = dict[str, dict[int, Figures]]  # row -> image -> figures


@dataclass(frozen=True)
class AblationConfig:
    """How each row is trained. What is not here is as in `deckline train dehaze`."""

    minutes: float | None = None  # training time of each row
    steps: int | None = None  # of each row; with minutes as well, whichever ends first
    size: Literal["t", "s", "b"] = "t"
    unshuffle: int = 4  # image px per px of the network's grid; 1 is the paper's full resolution
    batch: int = 2
    crop_height: int = 288  # px
    crop_width: int = 512  # px
    lr: float = 5e-4
    recorded_share: float = 0.0  # of the augmented row's crops keep the haze they were recorded in; others get new haze
    flip_vertical: float = 0.0  # probability, in the augmented row; the paper's is 0.5
    seed: int = 0  # of the first weights and of what is drawn
    threads: int = 0  # of torch and ONNX Runtime; 0 leaves their own choice
    device: Literal["auto", "cpu", "cuda"] = "auto"  # to train on


@dataclass(frozen=True, eq=False)
class Measured:
    """A row of the table as it is measured."""

    key: str
    dehazer: Dehazer | None = None  # None gives the image back
    weights: str = ""  # SHA-256 of its file, so that figures of other weights are not taken for these


@dataclass(frozen=True, eq=False)
class Line:
    """A row of the table as it is printed."""

    key: str
    name: str
    summary: RowSummary
    trained: TrainedRow | None = None  # None for the hazy input


def ablation(
    dataset: tyro.conf.Positional[Path],
    out: Path,
    every: int = 1,
    config: Annotated[AblationConfig, tyro.conf.arg(name="")] = AblationConfig(),
) -> int:
    """Train the rows of the paper's Table 5 on a dataset and measure them on its test part.

    Depthwise-separable convolutions and plain transformers, then MixAttention, then MobileViTv3, then augmentation: the
    same budget, seed and data for each. The same command goes on where it was stopped.

    Args:
        dataset: folder written by `deckline dataset`, with train and test.
        out: folder of the trained rows and the table.
        every: measure on every so many-th test image.
        config: how each row is trained.
    """
    with needs_extra("train"):
        from deckline.train.ablation import train_rows
    if every < 1:
        raise ValueError(f"--every must be at least 1, got {every}")
    base = _base_recipe(config)
    test = open_recording(dataset / "test")
    rows = train_rows(base, dataset / "train", out)
    if rows is None:
        return INTERRUPTED
    measured = [Measured(HAZY), *(_measured(row, config.threads) for row in rows)]
    summaries = summarise_rows(measure(measured, test, range(0, len(test), every), out / IMAGES_FILE))
    lines = [Line(row.key, row.name, summaries[row.key], row) for row in rows]
    lines.insert(0, Line(HAZY, "hazy, left as it is", summaries[HAZY]))
    _report(lines, {"dataset": str(dataset), "every": every, **asdict(config)}, out)
    return 0


def _base_recipe(config: AblationConfig) -> "DehazeTrainConfig":
    """What the rows have in common.

    Raises:
        ValueError: no budget, or a number out of its range.
    """
    with needs_extra("train"):
        from deckline.train.dehaze import DehazeTrainConfig
        from deckline.train.dehaze_haze import HazeAugmentation
    if config.minutes is None and config.steps is None:
        raise ValueError("give each row a budget: --minutes, --steps, or both (whichever ends first)")
    return DehazeTrainConfig(
        size=config.size,
        unshuffle=config.unshuffle,
        steps=DehazeTrainConfig.steps if config.steps is None else config.steps,
        minutes=config.minutes,
        batch=config.batch,
        crop_height=config.crop_height,
        crop_width=config.crop_width,
        lr=config.lr,
        seed=config.seed,
        threads=config.threads,
        device=config.device,
        haze=HazeAugmentation(recorded_share=config.recorded_share, flip_vertical=config.flip_vertical),
    )


def _measured(row: TrainedRow, threads: int) -> Measured:
    return Measured(row.key, OnnxDehazer(row.weights, threads=threads or None), sha256_of(row.weights))


def measure(rows: Sequence[Measured], source: Source, indices: range, file: Path) -> Scores:
    """Figures of each row and image, as far as they are not in `file` already, to which they are added one by one.

    Args:
        rows: of the table, from above.
        source: frames with their clear pictures.
        indices: of the frames.
        file: JSON lines; made if it does not exist.

    Raises:
        ValueError: a frame without a clear picture, or a file of something else.
    """
    known = _known(file)
    scores: Scores = {row.key: {} for row in rows}
    with file.open("a", encoding="utf-8") as log, progress("measuring", len(indices)) as advance:
        for index in indices:
            missing = [row for row in rows if (index, row.weights) not in known]
            if missing and (frame := _load(source, index)) is not None:
                for row in missing:
                    known[index, row.weights] = figures = _score(frame, row.dehazer)
                    record = {"file": frame.file, "image": index, "row": row.key, "weights": row.weights, **figures}
                    log.write(json.dumps(record) + "\n")
                    log.flush()
            for row in rows:
                if (index, row.weights) in known:
                    scores[row.key][index] = known[index, row.weights]
            advance()
    return scores


def _known(file: Path) -> dict[tuple[int, str], Figures]:
    """Figures by image and weights; what a killed command left unfinished at the end is cut off the file."""
    if not file.is_file():
        return {}
    keep_whole_lines(file)
    try:
        return {
            (int(record["image"]), str(record["weights"])): {name: record[name] for name in FIGURES if name in record}
            for record in read_records(file)
        }
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{file}: a line is no figure of an image ({error!r}): use another folder") from None


def _load(source: Source, index: int) -> Frame | None:
    """A frame, or None and a line on the screen when it cannot be read."""
    try:
        return source.load(index)
    except FrameError as error:
        print(f"skipped {error}", file=sys.stderr)
        return None


def _score(frame: Frame, dehazer: Dehazer | None) -> Figures:
    if frame.truth is None or frame.truth.clear_rgb is None:
        raise ValueError(f"{frame.file}: no clear picture to compare with; write the dataset with `deckline dataset`")
    surface = None if frame.depth_m is None else np.isfinite(frame.depth_m)
    image = frame.image_rgb if dehazer is None else dehazer(frame.image_rgb)
    return restoration(image, frame.truth.clear_rgb, surface)


def _report(lines: list[Line], made_with: dict[str, Any], out: Path) -> None:
    """The table on the screen, as JSON and as Markdown."""
    budget = " or ".join(f"{made_with[name]:g} {name}" for name in ("minutes", "steps") if made_with[name] is not None)
    title = f"{made_with['dataset']}: {lines[0].summary.images} test images; {budget} for each row"
    table = Table("the paper's Table 5", COLUMNS, [_cells(line) for line in lines], (CAPTION,))
    figures = {**made_with, "rows": [_figures(line) for line in lines]}
    publish(title, [table], figures, out / "ablation.json", out / "ablation.md")


def _cells(line: Line) -> list[str]:
    means, gains = line.summary.means, line.summary.gains
    took = line.trained
    return [
        line.name,
        number(means.get("psnr_db"), ".2f"),
        _gain(gains.get("psnr_db")),
        number(means.get("ssim"), ".4f"),
        number(means.get("psnr_db_surface"), ".2f"),
        _gain(gains.get("psnr_db_surface")),
        "-" if took is None else f"{took.parameters / 1e6:.3f}",
        "-" if took is None else f"{took.macs_256 / 1e9:.3f}",
        "-" if took is None else f"{took.steps}",
        "-" if took is None else f"{took.minutes:.1f}",
        "-" if took is None else f"{took.paper_psnr_db:.2f}",
    ]


def _gain(gain: Difference | None) -> str:
    return "-" if gain is None else gain.text("+.2f")


def _figures(line: Line) -> dict[str, Any]:
    gains = {
        name: {"value": gain.value, "low": _finite(gain.low), "high": _finite(gain.high), "images": gain.images}
        for name, gain in line.summary.gains.items()
    }
    took = line.trained
    cost = {} if took is None else {"parameters": took.parameters, "macs_256": took.macs_256}
    spent = {} if took is None else {"steps": took.steps, "minutes": took.minutes}
    return {"row": line.key, "images": line.summary.images, **line.summary.means, "gains": gains, **cost, **spent}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
