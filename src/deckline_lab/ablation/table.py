"""`deckline eval ablation`: the paper's Table 5, trained and measured by one command.

OUT/<row>/                 checkpoint, ONNX file and figures of each row, as `deckline train dehaze` writes them
OUT/images.jsonl           how the rows are made, and one line for each test image and row
OUT/ablation.json, .md     the table
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tyro

from deckline.config import Engine
from deckline.dehaze import OnnxDehazer
from deckline.extras import needs_extra
from deckline.files import print_line
from deckline.recording import FrameError, Recording, open_recording
from deckline.runtime import sha256_of
from deckline.types import Frame
from deckline_lab.evaluation.dehazing_score import FIGURES, restoration
from deckline_lab.evaluation.store import Store
from deckline_lab.evaluation.tables import MISSING, OutputFiles, Table, number, publish
from deckline_lab.statistics import Difference, paired_difference
from deckline_sim.progress import progress

HAZY = "hazy"  # the row that does nothing
IMAGES_FILE = "images.jsonl"
COLUMNS = (
    "row", "PSNR, dB", "gain [95 %]", "SSIM", "no sky, dB", "gain [95 %]",
    "M param.", "GMACs", "steps", "minutes", "paper, dB",
)  # fmt: skip
CAPTION = (
    "Each row adds one part to the row above, and its gain is over that row on the same images. MACs at 256x256 px. "
    "The paper's PSNR is on its own pictures. Images of one flight resemble each other: the intervals are too narrow."
)

Figures = Mapping[str, float]  # of one image, by FIGURES; those that exist
Scores = dict[str, dict[int, Figures]]  # row -> image -> figures


@dataclass(frozen=True)
class AblationConfig:
    """How each row is trained. What is not here is as in `deckline train dehaze`."""

    minutes: float | None = None  # training time of each row
    cpu_minutes: bool = False  # they are of computing: the same budget for each row on a busy machine
    steps: int | None = None  # of each row; with minutes as well, whichever ends first
    size: Literal["t", "s", "b"] = "t"
    unshuffle: Literal[1, 4] = 4  # image px per px of the network's grid; 1 is the paper's full resolution
    batch: int = 2
    crop_height: int = 288  # px
    crop_width: int = 512  # px
    lr: float = 5e-4
    recorded_share: float = 0.0  # of the augmented row's crops have their recorded haze; others get new haze
    flip_vertical: float = 0.0  # probability, in the augmented row; the paper's is 0.5
    seed: int = 0  # of the first weights and of what is drawn
    threads: int = 0  # of torch and ONNX Runtime; 0 leaves their own choice
    device: Literal["auto", "cpu", "cuda"] = "auto"  # to train on


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
        from deckline_lab.ablation import rows as trained
    if every < 1:
        raise ValueError(f"--every must be at least 1, got {every}")
    base, pairs = trained.base_recipe(**asdict(config)), dataset / "train"
    test = open_recording(dataset / "test")
    trained.check_pairs(pairs, base.held_out)
    with Store(out, IMAGES_FILE, trained.describe_rows(base, pairs)) as store:
        costs = trained.train_rows(base, pairs, out)
        files = {row.key: out / row.key / trained.WEIGHTS_FILE for row in trained.ROWS}
        dehazers = {
            key: OnnxDehazer(file, engine=Engine(threads=config.threads or None)) for key, file in files.items()
        }
        scores = measure({HAZY: None, **dehazers}, test, range(0, len(test), every), store)
    rows = [row | costs.get(row["row"], {}) for row in summarise_rows(scores)]
    names = {HAZY: ("hazy, left as it is", MISSING)}
    names |= {row.key: (row.name, f"{row.paper_psnr_db:.2f}") for row in trained.ROWS}
    table = Table("the paper's Table 5", COLUMNS, [_cells(row, *names[row["row"]]) for row in rows], (CAPTION,))
    made_with = {"dataset": str(dataset), "every": every, **asdict(config)}
    budget = " or ".join(f"{made_with[name]:g} {name}" for name in ("minutes", "steps") if made_with[name] is not None)
    title = f"{dataset}: {rows[0]['images']} test images; {budget} for each row"
    publish(title, [table], {**made_with, "rows": rows}, OutputFiles(out / "ablation.json", out / "ablation.md"))
    return 0


def measure(dehazers: Mapping[str, OnnxDehazer | None], source: Recording, indices: range, store: Store) -> Scores:
    """Figures of each row and image, as far as they are not in the store already, to which they are added one by one.

    Args:
        dehazers: by row, from above; None gives the image back.
        source: frames with their clear pictures.
        indices: of the frames.
        store: its keys are an image and the SHA-256 of a row's weights.
    """
    weights = {row: "" if dehazer is None else sha256_of(dehazer.session.path) for row, dehazer in dehazers.items()}
    with progress("measuring", len(indices)) as advance:
        for index in indices:
            missing = [row for row in dehazers if (index, weights[row]) not in store.rows]
            try:
                frame = source.load(index) if missing else None
            except FrameError as error:
                print_line(f"skipped {error}")
                frame = None
            if frame is not None:
                for row in missing:
                    store.add((index, weights[row]), _score(frame, dehazers[row]))
            advance()
    rows = store.rows
    return {row: {k: rows[k, sha] for k in indices if (k, sha) in rows} for row, sha in weights.items()}


def _score(frame: Frame, dehazer: OnnxDehazer | None) -> Figures:
    if frame.truth is None or frame.truth.clear_rgb is None:
        raise ValueError(f"{frame.file}: no clear picture to compare with; write the dataset with `deckline dataset`")
    surface = None if frame.depth_m is None else np.isfinite(frame.depth_m)
    image = frame.image_rgb if dehazer is None else dehazer(frame.image_rgb)
    return restoration(image, frame.truth.clear_rgb, surface)


def summarise_rows(scores: Mapping[str, Mapping[int, Figures]], seed: int = 0) -> list[dict[str, Any]]:
    """Name, count of images, means, and gains over the row above, of every row; what does not exist is left out."""
    rows: list[dict[str, Any]] = []
    above: Mapping[int, Figures] = {}
    for key, images in scores.items():
        if not images:
            raise ValueError(f"no image could be evaluated for {key}")
        rng = np.random.default_rng(seed)
        means, gains = {}, {}
        for name in FIGURES:
            values = {image: figures[name] for image, figures in images.items() if name in figures}
            if values:
                means[name] = float(np.mean(list(values.values())))
            both = [value - above[k][name] for k, value in values.items() if name in above.get(k, {})]
            if both:
                gains[name] = asdict(paired_difference(both, rng))
        rows.append({"row": key, "images": len(images), **means, "gains": gains})
        above = images
    return rows


def _cells(row: Mapping[str, Any], name: str, paper: str) -> list[str]:
    shown = {**row, **{key: row[key] / unit for key, unit in (("parameters", 1e6), ("macs_256", 1e9)) if key in row}}
    formats = {"psnr_db": ".2f", "ssim": ".4f", "psnr_db_surface": ".2f"}
    formats |= {"parameters": ".3f", "macs_256": ".3f", "steps": ".0f", "minutes": ".1f"}
    cells = [name]
    for key, digits in formats.items():
        cells.append(number(shown.get(key), digits))
        if key.startswith("psnr_db"):
            cells.append(Difference(**row["gains"][key]).text("+.2f") if key in row["gains"] else MISSING)
    return [*cells, paper]
