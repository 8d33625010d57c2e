"""Training curves beside the checkpoint: losses.csv, losses.png, and TensorBoard's events where they are asked for."""

import csv
import io
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from deckline.atomic import write_atomic
from deckline.extras import needs_extra

CSV_FILE, PICTURE_FILE, EVENTS_FOLDER = "losses.csv", "losses.png", "tensorboard"
ABOUT = ("step", "minutes", "lr")  # of a row, what is no loss
HELD_OUT = "held_out"

Row = Mapping[str, float]


class Curves:
    """The losses of a training, in rows.

    Args:
        out: folder of the training.
        step: that it goes on from; rows of later steps, which a killed run left, are dropped.
        tensorboard: write events as well.

    Raises:
        ImportError: no TensorBoard.
    """

    def __init__(self, out: Path, step: int, tensorboard: bool = False) -> None:
        self.out = out
        self.rows: list[Row] = [row for row in read_curves(out) if row["step"] <= step]
        self._events: Any = None
        if tensorboard:
            with needs_extra("tensorboard"):
                from torch.utils.tensorboard import SummaryWriter
            self._events = SummaryWriter(str(out / EVENTS_FOLDER), purge_step=step)

    def add(self, row: Row) -> None:
        """Add a row: step, minutes, lr, the losses, and held_out where it was measured."""
        self.rows.append(row)
        text = io.StringIO()
        columns = dict.fromkeys(name for each in self.rows for name in each)
        writer = csv.DictWriter(text, [*(name for name in columns if name != HELD_OUT), HELD_OUT])
        writer.writeheader()
        writer.writerows({name: f"{value:.6g}" for name, value in each.items()} for each in self.rows)
        write_atomic(self.out / CSV_FILE, text.getvalue().encode())
        if self._events is not None:
            for name, value in row.items():
                if name != "step":
                    self._events.add_scalar(name, value, int(row["step"]))
            self._events.flush()

    def draw(self) -> Path:
        """Write the picture of the rows.

        Raises:
            ImportError: no matplotlib.
        """
        with needs_extra("viz"):
            from matplotlib.figure import Figure
        figure = Figure(figsize=(8, 4.5), dpi=110, layout="constrained")
        axes = figure.subplots()
        names = dict.fromkeys(name for row in self.rows for name in row if name not in ABOUT)
        for name in names:
            points = [(row["step"], row[name]) for row in self.rows if name in row]
            style = {"marker": "o", "color": "black"} if name == HELD_OUT else {"lw": 2.0 if name == "total" else 0.9}
            axes.plot(*zip(*points, strict=True), label=name.replace("_", " "), **style)
        axes.set(xlabel="step", ylabel="loss")
        axes.grid(alpha=0.3)
        axes.legend()
        data = io.BytesIO()
        figure.savefig(data, format="png")
        write_atomic(self.out / PICTURE_FILE, data.getvalue())
        return self.out / PICTURE_FILE


def read_curves(out: Path) -> Iterator[Row]:
    """The rows of a training's losses.csv; none without one."""
    path = out / CSV_FILE
    if path.is_file():
        with path.open(newline="") as file:
            for row in csv.DictReader(file):
                yield {name: float(value) for name, value in row.items() if value}
