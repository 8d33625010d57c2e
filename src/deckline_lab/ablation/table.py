"""`deckline eval ablation`: the paper's Table 5, trained and measured by one command.

OUT/<row>-<seed>/          checkpoint, ONNX file and figures of each training, as `deckline train dehaze` writes them
OUT/images.jsonl           how the rows are made, and one line for each test image and training
OUT/ablation.json, .md     the table
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tyro
from numpy.typing import NDArray

from deckline.config import Engine
from deckline.dehaze import OnnxDehazer
from deckline.extras import needs_extra
from deckline.files import print_line
from deckline.recording import FrameError
from deckline.runtime import sha256_of
from deckline_lab.evaluation.dehazing_pairs import PairSource, open_pairs
from deckline_lab.evaluation.dehazing_score import restoration
from deckline_lab.evaluation.store import Store
from deckline_lab.evaluation.tables import MISSING, OutputFiles, Table, number, publish
from deckline_lab.statistics import Difference, difference_of_trainings
from deckline_sim.progress import progress

HAZY = "hazy"  # the row that does nothing
IMAGES_FILE = "images.jsonl"
FIGURES = {"psnr_db": ".2f", "ssim": ".4f"}  # and their digits
COLUMNS = (
    "row", "PSNR, dB", "gain [95 %]", "of the seeds", "SSIM", "gain [95 %]",
    "M param.", "GMACs", "steps", "minutes", "paper, dB",
)  # fmt: skip
CAPTION = (
    "Each row adds one part to the row above, and its gain is over that row on the same images. Of the seeds: PSNR of "
    "the worst and the best training. Intervals: bootstrap over images and trainings; images of one flight resemble "
    "each other, which it does not see. MACs at 256x256 px; minutes of one training. The paper's PSNR is on its own "
    "pictures."
)

Figures = Mapping[str, float]  # of one image, by FIGURES; those that exist
Scores = dict[str, list[dict[str, Figures]]]  # row -> of each training: image -> figures


@dataclass(frozen=True)
class AblationConfig:
    """How each row is trained. What is not here is as in `deckline train dehaze`."""

    minutes: float | None = None  # training time of each row
    cpu_minutes: bool = False  # they are of computing: the same budget for each row on a busy machine
    steps: int | None = None  # of each row; with minutes as well, whichever ends first
    size: Literal["t", "s", "b"] = "t"
    unshuffle: Literal[1, 4] = 4  # image px per px of the network's grid; 1 is the paper's full resolution
    batch: int = 2
    sub_image_px: int = 256  # side of the sub-images; pictures are averaged down to about 640 px
    lr: float = 5e-4
    recorded_share: float = 0.5  # of the last row's crops have their recorded haze; others get new haze
    seeds: tuple[int, ...] = (0,)  # of the first weights and of what is drawn: each row is trained with every one
    threads: int = 0  # of torch and ONNX Runtime; 0 leaves their own choice
    device: Literal["auto", "cpu", "cuda"] = "auto"  # to train on


def ablation(
    dataset: tyro.conf.Positional[Path],
    out: Path,
    every: int = 1,
    config: Annotated[AblationConfig, tyro.conf.arg(name="")] = AblationConfig(),
) -> int:
    """Train the rows of the paper's Table 5 on a dataset and measure them on its test part.

    Depthwise-separable convolutions and plain transformers on whole pictures in recorded haze, then MixAttention, then
    MobileViTv3, then the paper's sub-images with flips, then haze drawn anew: the same budget, seeds and data for each.
    All pictures are averaged down to about 640 px. The same command goes on where it was stopped.

    Args:
        dataset: folder written by `deckline dataset`, with train and test.
        out: folder of the trained rows and the table.
        every: measure on every so many-th test image.
        config: how each row is trained.
    """
    with needs_extra("train"):
        from deckline_lab.ablation import rows as trained
    if not config.seeds or len(set(config.seeds)) < len(config.seeds):
        raise ValueError(f"seeds must be one or more different numbers, got {config.seeds}")
    given = {name: value for name, value in asdict(config).items() if name != "seeds"}
    base, pairs, test = trained.base_recipe(**given), dataset / "train", open_pairs(dataset / "test", every)
    size = trained.check_pairs(pairs, base.held_out)
    trainings = trained.list_trainings(base, size, config.seeds, out)
    with Store(out, IMAGES_FILE, trained.describe_rows(base, pairs)) as store:
        spent = trained.train_rows(trainings, pairs)
        dehazers: dict[str, list[OnnxDehazer | None]] = {HAZY: [None]}
        for each in trainings:
            file, engine = each.folder / trained.ONNX_FILE, Engine(threads=config.threads or None)
            dehazers.setdefault(each.row.key, []).append(OnnxDehazer(file, engine=engine))
        scores = measure(dehazers, test, base.working_long_side_px, store)
    rows = [row | _sizes(dehazers[row["row"]][0]) | spent.get(row["row"], {}) for row in summarise_rows(scores)]
    names = {HAZY: ("hazy, left as it is", MISSING)}
    names |= {row.key: (row.name, number(row.paper_psnr_db, ".2f")) for row in trained.ROWS}
    table = Table("the paper's Table 5", COLUMNS, [_cells(row, *names[row["row"]]) for row in rows], (CAPTION,))
    made_with = {"dataset": str(dataset), "every": every, **asdict(config)}
    budget = " or ".join(f"{made_with[name]:g} {name}" for name in ("minutes", "steps") if made_with[name] is not None)
    title = f"{dataset}: {rows[0]['images']} test images; {budget} for each row, {len(config.seeds)} trainings of each"
    publish(title, [table], {**made_with, "rows": rows}, OutputFiles(out / "ablation.json", out / "ablation.md"))
    return 0


def measure(
    dehazers: Mapping[str, Sequence[OnnxDehazer | None]], source: PairSource, long_side_px: int, store: Store
) -> Scores:
    """Figures of each training and image, as far as they are not in the store already, to which they are added.

    Args:
        dehazers: of each row, from above; None gives the image back.
        source: pairs of a hazy and a clear picture.
        long_side_px: pictures are averaged down to about this.
        store: its keys are an image and the SHA-256 of a training's weights.
    """
    with needs_extra("train"):
        from deckline_lab.train.pair_views import make_pair_view
    weights = {
        row: ["" if dehazer is None else sha256_of(dehazer.session.path) for dehazer in trained]
        for row, trained in dehazers.items()
    }
    flat = {sha: dehazer for row, shas in weights.items() for sha, dehazer in zip(shas, dehazers[row], strict=True)}
    with progress("measuring", len(source.keys)) as advance:
        for key in source.keys:
            missing = [sha for sha in flat if (key, sha) not in store.rows]
            try:
                view = make_pair_view(source.load(key), long_side_px) if missing else None
            except FrameError as error:
                print_line(f"skipped {error}")
                view = None
            if view is not None:
                for sha in missing:
                    dehazer = flat[sha]
                    image = view.hazy_rgb if dehazer is None else dehazer(view.hazy_rgb)
                    store.add((key, sha), restoration(image, view.clear_rgb, None))
            advance()
    rows = store.rows
    return {
        row: [{key: rows[key, sha] for key in source.keys if (key, sha) in rows} for sha in shas]
        for row, shas in weights.items()
    }


def summarise_rows(scores: Scores) -> list[dict[str, Any]]:
    """Of every row name, count of images, means over images and trainings, each training's mean PSNR, and gains over
    the row above; what does not exist is left out.
    """
    rows: list[dict[str, Any]] = []
    above: list[dict[str, Figures]] = []
    for key, trainings in scores.items():
        images = _common_images(trainings)
        if not images:
            raise ValueError(f"no image could be evaluated for {key}")
        rng, gains, means = np.random.default_rng(0), {}, {}
        for name in FIGURES:
            if (values := _array(trainings, name)).size:
                means[name] = float(values.mean())
            both = _common_images([*trainings, *above], name) if above else []
            if both:
                ours, theirs = (_array(each, name, both) for each in (trainings, above))
                gains[name] = asdict(difference_of_trainings(ours, theirs, rng))
        seeds = _array(trainings, "psnr_db").mean(axis=1).tolist()
        rows.append({"row": key, "images": len(images), **means, "psnr_db_of_trainings": seeds, "gains": gains})
        above = trainings
    return rows


def _common_images(trainings: Sequence[Mapping[str, Figures]], figure: str | None = None) -> list[str]:
    """Images that every training was measured on, and has the figure of, in order."""
    first, *others = trainings
    return [
        image
        for image in first
        if all(image in each and (figure is None or figure in each[image]) for each in (first, *others))
    ]


def _array(
    trainings: Sequence[Mapping[str, Figures]], figure: str, images: Sequence[str] | None = None
) -> NDArray[np.float64]:
    """A figure (T, N) of each training and image; of the images that all have when none are given."""
    chosen = _common_images(trainings, figure) if images is None else images
    return np.array([[each[image][figure] for image in chosen] for each in trainings], np.float64)


def _sizes(dehazer: OnnxDehazer | None) -> dict[str, float]:
    """Parameters, and multiply-accumulates at 256x256, as the network's file states them."""
    cost = None if dehazer is None else dehazer.cost
    return {} if cost is None else {"parameters": float(cost[0]), "macs_256": float(cost[1])}


def _cells(row: Mapping[str, Any], name: str, paper: str) -> list[str]:
    cells, seeds = [name], row["psnr_db_of_trainings"]
    for key, digits in FIGURES.items():
        gain = row["gains"].get(key)
        cells += [number(row.get(key), digits), MISSING if gain is None else Difference(**gain).text(f"+{digits}")]
        if key == "psnr_db":
            cells.append(MISSING if len(seeds) < 2 else f"{min(seeds):.2f} to {max(seeds):.2f}")
    shown = {key: row[key] / unit for key, unit in (("parameters", 1e6), ("macs_256", 1e9)) if key in row}
    cells += [number(shown.get(key), ".3f") for key in ("parameters", "macs_256")]
    return [*cells, number(row.get("steps"), ".0f"), number(row.get("minutes"), ".1f"), paper]
