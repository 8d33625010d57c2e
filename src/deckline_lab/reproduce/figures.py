"""The paper's Figures 11 to 13: restoration over the steps of training, and two sequences side by side."""

import io
from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path

import numpy as np

from deckline.atomic import write_atomic
from deckline.dehaze import OnnxDehazer
from deckline.extras import needs_extra
from deckline.report.draw import write_picture
from deckline_lab.evaluation.dehazing_pairs import PairSource, open_pairs, read_pairs
from deckline_lab.evaluation.pictures import tiles_of
from deckline_lab.labels.lines import LABELS_FILE
from deckline_lab.train.curves import read_curves

PANELS = {
    "held_out_psnr_db": "PSNR of held-out crops, dB",
    "held_out_ssim": "SSIM of held-out crops",
    "total": "loss (PSNRLoss), dB",
}
SHOWN = 3  # frames of a sequence, of its last two thirds: in the first one no ship is in sight
AT = (0.25, 0.75)  # of the flights, from the densest haze to the thinnest: the two that are shown


def draw_training(folders: Mapping[str, Sequence[Path]], path: Path) -> None:
    """Figure 11: PSNR and SSIM on held-out crops and the loss over the steps, a column for each form.

    Args:
        folders: of the trainings, by form; each with its losses.csv.
        path: of the picture (.png).
    """
    with needs_extra("viz"):
        from matplotlib.figure import Figure
    figure = Figure(figsize=(10, 8), dpi=100, layout="constrained")
    grid = figure.subplots(len(PANELS), len(folders), squeeze=False, sharey="row", sharex="col")
    for column, (form, trainings) in zip(grid.T, folders.items(), strict=True):
        for folder in trainings:
            rows = list(read_curves(folder))
            for axes, name in zip(column, PANELS, strict=True):
                points = [(row["step"], row[name]) for row in rows if name in row]
                axes.plot(*np.transpose(points).reshape(2, -1), marker="." if "held" in name else "", label=folder.name)
        column[0].set_title(form)
        column[-1].set(xlabel="step", xscale="log")
        column[-1].legend(fontsize="small")
    for axes, label in zip(grid[:, 0], PANELS.values(), strict=True):
        axes.set_ylabel(label)
    for axes in grid.ravel():
        axes.grid(alpha=0.3)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(path, buffer.getvalue())
    print(path)


def draw_sequences(folder: Path, files: Mapping[str, Sequence[Path]], paths: tuple[Path, Path]) -> None:
    """Figures 12 and 13: frames of one flight from above, hazy, of every network and clear from the left.

    Args:
        folder: of labelled pairs in the order of their flights; those of one flight have one visibility.
        files: of the networks, by form; each form has its own rows.
        paths: of the two pictures (.jpg).
    """
    pairs = open_pairs(folder)
    flights = find_flights(folder, pairs)
    dehazers = {form: {file.parent.name: OnnxDehazer(file) for file in these} for form, these in files.items()}
    for share, path in zip(AT, paths, strict=True):
        flight = flights[round(share * (len(flights) - 1))]
        keys = [flight[k] for k in np.linspace(len(flight) // 3, len(flight) - 1, SHOWN).round().astype(int)]
        rows = [np.concatenate(tiles_of(pairs.load(key), form), axis=1) for form in dehazers.values() for key in keys]
        path.parent.mkdir(parents=True, exist_ok=True)
        write_picture(path, np.concatenate(rows))
        print(path)


def find_flights(folder: Path, pairs: PairSource) -> list[list[str]]:
    """Keys of each flight's pairs, the flight in the densest haze first: neighbours of one visibility."""
    entries = read_pairs(folder / LABELS_FILE)
    flights = [(visibility, list(keys)) for visibility, keys in groupby(pairs.keys, lambda key: entries[key][1])]
    return [keys for _, keys in sorted(flights, key=lambda flight: flight[0])]
