"""Commands and folders that the tables share."""

import json
import shlex
import subprocess
import sys
from pathlib import Path

from deckline.extras import needs_extra
from deckline_lab.labels.lines import LABELS_FILE


def make_data(runs: Path) -> Path:
    """`runs`/data, the paper's dataset: a test and a training part; `deckline dataset` goes on where it stopped."""
    run("dataset", runs / "data", "--views", "landing", "--one-scene", "--no-tiles", "--jobs", 0)
    return runs / "data"


def shrink_pairs(recording: Path, folder: Path) -> Path:
    """`folder` with the recording's pairs at the size that they are trained at: loading them anew takes little time."""
    with needs_extra("train"):
        from deckline.report.draw import write_picture
        from deckline_lab.train.dehaze import DehazeTrainConfig
        from deckline_lab.train.pair_views import open_clear_views
    if not (folder / LABELS_FILE).exists():
        folder.mkdir(exist_ok=True)
        views, entries = open_clear_views([recording], DehazeTrainConfig.working_long_side_px, held_out=0.0), []
        for index in range(len(views)):
            view, names = views[index], {"file": f"{index:03d}-hazy.png", "pair_of": f"{index:03d}-clear.png"}
            if view.hazy_rgb is None:
                raise ValueError(f"{recording}: picture {index} has no hazy one; write it with `deckline dataset`")
            for name, picture in zip(names.values(), (view.hazy_rgb, view.clear_rgb), strict=True):
                write_picture(folder / name, picture)
            entries.append(names)
        (folder / LABELS_FILE).write_text(json.dumps({"frames": entries}))
    return folder


def run(*words: object, quiet: bool = False) -> None:
    """Print and run a deckline command; `quiet` drops its tables.

    Raises:
        SystemExit: its exit code, where it fails; it has printed the reason.
    """
    command = ["deckline", *map(str, words)]
    print(shlex.join(command), flush=True)
    output = subprocess.DEVNULL if quiet else None
    if code := subprocess.run([sys.executable, "-m", *command], check=False, stdout=output).returncode:
        raise SystemExit(code)
