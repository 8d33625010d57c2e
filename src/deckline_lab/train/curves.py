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
MARKED = {"marker": "o", "color": "black"}  # held-out figures, which are far apart

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
        """Add a row: step, minutes, lr, the losses, and where they were measured held_out and figures held_out_NAME."""
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
        """Write the picture of the rows: the losses together, every held-out figure below them.

        Raises:
            ImportError: no matplotlib.
        """
        with needs_extra("viz"):
            from matplotlib.figure import Figure
        names = dict.fromkeys(name for row in self.rows for name in row if name not in ABOUT)
        figures = [name for name in names if name.startswith(f"{HELD_OUT}_")]
        figure = Figure(figsize=(8, 4.5 + 2 * len(figures)), dpi=110, layout="constrained")
        panels = figure.subplots(1 + len(figures), 1, squeeze=False, sharex=True)[:, 0]
        for name in names:
            axes = panels[1 + figures.index(name)] if name in figures else panels[0]
            points = [(row["step"], row[name]) for row in self.rows if name in row]
            style = MARKED if name.startswith(HELD_OUT) else {"lw": 2.0 if name == "total" else 0.9}
            axes.plot(*zip(*points, strict=True), label=name.replace("_", " "), **style)
        panels[0].set_ylabel("loss")
        panels[-1].set_xlabel("step")
        for axes in panels:
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
