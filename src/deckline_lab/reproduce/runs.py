"""Commands and folders that the tables share."""

import json
import math
import shlex
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from deckline.config_file import read_config
from deckline.extras import needs_extra
from deckline_lab.labels.lines import LABELS_FILE

SAVED = Path(__file__).parent / "saved"


def make_data(runs: Path) -> Path:
    """`runs`/data, the paper's dataset: a test and a training part; `deckline dataset` goes on where it stopped."""
    run("dataset", runs / "data", "--views", "landing", "--one-scene", "--no-tiles", "--jobs", 0)
    return runs / "data"


def shrink_pairs(recording: Path, folder: Path) -> Path:
    """`folder` with the recording's pairs averaged down by two, as a coarse network sees them: loading takes little."""
    with needs_extra("train"):
        from deckline.report.draw import write_picture
        from deckline_lab.evaluation.dehazing_pairs import open_pairs
        from deckline_lab.train.dehaze import DehazeTrainConfig
        from deckline_lab.train.pair_views import make_pair_view
    if not (folder / LABELS_FILE).exists():
        folder.mkdir(parents=True, exist_ok=True)
        pairs, entries = open_pairs(recording), []
        for key in pairs.keys:
            pair, stem = pairs.load(key), f"{int(key):03d}"
            view = make_pair_view(pair, DehazeTrainConfig.working_long_side_px)
            for name, picture in (("hazy", view.hazy_rgb), ("clear", view.clear_rgb)):
                write_picture(folder / f"{stem}-{name}.png", picture)
            names = {"file": f"{stem}-hazy.png", "pair_of": f"{stem}-clear.png"}
            entries.append(names | ({} if math.isnan(pair.visibility_m) else {"visibility_m": pair.visibility_m}))
        (folder / LABELS_FILE).write_text(json.dumps({"frames": entries}))
    return folder


def train_networks(
    what: Literal["dehaze", "detect"],
    data: Path,
    out: Path,
    networks: Mapping[str, str],
    recipe: str,
    minutes: float,
    threads: int,
) -> dict[str, Path]:
    """Train every network that is not finished in `out`/<name>, in order; the same call goes on.

    Args:
        networks: what `deckline train` calls them, by name.
        recipe: of all of them, TOML.

    Returns:
        The .onnx file of each, by name.
    """
    with needs_extra("train"):
        from deckline_lab.train.dehaze import DehazeTrainConfig
        from deckline_lab.train.detect import DetectTrainConfig
        from deckline_lab.train.loop import is_finished
    out.mkdir(parents=True, exist_ok=True)
    file = out / "recipe.toml"
    file.write_text(recipe)
    base: Any = read_config({"dehaze": DehazeTrainConfig, "detect": DetectTrainConfig}[what], file)
    for k, (name, network) in enumerate(networks.items(), 1):
        print(f"training {k} of {len(networks)}: {name}", flush=True)
        if is_finished(replace(base, network=network, minutes=minutes), out / name, f"{what}.onnx"):
            print("finished before", flush=True)
        else:
            budget = ("--recipe", file, "--minutes", minutes, "--threads", threads)
            run("train", what, data, "--network", network, "--out", out / name, *budget)
    return {name: out / name / f"{what}.onnx" for name in networks}


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
