"""The paper's Table 4 behind one coarse grid: ours and its five rivals, trained on the same pairs with the same budget.

    deckline dataset data --one-scene --no-tiles
    python scripts/table4.py data --out runs/table4 [--steps 500 1000 2000 | --minutes 3 6 12] [--threads 2]

In every round each network goes on to the round's budget, in turn, and all are compared: a stop leaves equal budgets.
The learning rate falls to its end in every round; budgets that double make it rise to half its peak in the next one.
The same command resumes after a stop. The deckline commands are printed before they run.
"""

import argparse
import json
from pathlib import Path
from typing import Any

from table6 import run

from deckline.labels.lines import LABELS_FILE
from deckline.report.draw import write_picture
from deckline.statistics import Difference
from deckline.train.checkpoint import read_progress
from deckline.train.dehaze import DehazeTrainConfig
from deckline.train.views import open_clear_views

OURS = "coarse-t"
RIVALS = ("aod-net", "gca-net", "grid-dehaze-net", "g-unet-t", "dehaze-former-t")
RECIPE = """batch = 2
crop_height = 256
crop_width = 256
lr = 1e-3
visible_share = 0.0
held_out = 0.01
cpu_minutes = true

[haze]
noise_share = 0.0
"""
COLUMNS = "| network | steps | CPU minutes | PSNR, dB | to ours [95 %] | below horizon, dB | SSIM | M | GMACs | ms |"


def shrink_pairs(recording: Path, folder: Path) -> Path:
    """`folder` with the recording's pairs at the size that they are trained at: loading them anew takes little time."""
    if not (folder / LABELS_FILE).exists():
        folder.mkdir(exist_ok=True)
        views, entries = open_clear_views([recording], DehazeTrainConfig.working_long_side_px, held_out=0.0), []
        for index in range(len(views)):
            names, view = (f"{index:03d}-hazy.png", f"{index:03d}-clear.png"), views[index]
            for name, picture in zip(names, (view.hazy_rgb, view.clear_rgb), strict=True):
                write_picture(folder / name, picture)
            entries.append({"file": names[0], "pair_of": names[1]})
        (folder / LABELS_FILE).write_text(json.dumps({"frames": entries}))
    return folder


def rows(results: dict[str, Any], spent: dict[str, tuple[int, float]]) -> list[str]:
    """The table of a round, as Markdown: ours and its rivals by PSNR, then the hazy pictures."""
    summaries = results["visibility"]["all"]
    lines = [COLUMNS, "|---" * COLUMNS.count(" | ") + "|---|"]
    for name, one in sorted(summaries.items(), key=lambda item: -item[1]["means"]["psnr_db"]):
        means, apart = one["means"], one["differences"].get("psnr_db")
        gain = Difference(**apart).text("+.2f") if apart else ""
        figures = [f"{means['psnr_db']:.2f}", gain, f"{means['psnr_db_surface']:.2f}", f"{means['ssim']:.3f}"]
        steps, minutes = spent.get(name, ("", None))
        size, cost = results["size"].get(name), results["cost"].get(name)
        figures += [f"{size['parameters'] / 1e6:.3f}", f"{size['macs_256'] / 1e9:.2f}"] if size else ["", ""]
        figures += [f"{1e3 * cost['seconds']:.0f}" if cost else ""]
        lines.append(f"| {' | '.join([name, str(steps), f'{minutes:.1f}' if minutes else '', *figures])} |")
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, help="dataset with train and test")
    parser.add_argument("--out", type=Path, required=True, help="folder of the trainings and results")
    parser.add_argument("--network", nargs="+", default=[OURS, *(f"{name}-coarse" for name in RIVALS)])
    budgets = parser.add_mutually_exclusive_group()
    budgets.add_argument("--steps", type=int, nargs="+", default=[500, 1000, 2000], help="of each network, by round")
    budgets.add_argument("--minutes", type=float, nargs="+", help="of each network's computing, by round")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--every", type=int, default=1, help="compare on every so many of the test pairs")
    parser.add_argument("--cost", action="store_true", help="measure time as well")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    recipe = given.out / "recipe.toml"
    recipe.write_text(RECIPE)
    flag, rounds = ("--minutes", given.minutes) if given.minutes else ("--steps", given.steps)
    pairs = shrink_pairs(given.data / "train", given.out / "pairs")
    folders = {name: given.out / name for name in given.network}
    for budget in rounds:
        figures = given.out / f"round-{budget:g}.json"
        if not figures.exists():
            for name, folder in folders.items():
                words = ["--network", name, "--out", folder, "--recipe", recipe, flag, budget]
                run("train", "dehaze", pairs, *words, "--threads", given.threads)
            first, *others = (folder / "dehaze.onnx" for folder in folders.values())
            words = ["--dehazer", first, *others, "--reference", first, "--detector", "none", "--every", given.every]
            run("eval", "dehazing", given.data / "test", *words, *(["--cost"] if given.cost else []), "--json", figures)
            results = json.loads(figures.read_text())
            progress = {name: read_progress(folder) or {} for name, folder in folders.items()}
            results["spent"] = {name: (one["step"], one["seconds"] / 60) for name, one in progress.items()}
            figures.write_text(json.dumps(results, indent=1) + "\n")
        results = json.loads(figures.read_text())
        print("\n".join(rows(results, results["spent"])), flush=True)


if __name__ == "__main__":
    main()
