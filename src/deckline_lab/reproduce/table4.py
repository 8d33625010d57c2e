"""The paper's Table 4: dehazing networks in print and behind one coarse grid, trained with one budget."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from deckline.dehaze import NOT_DEHAZED
from deckline_lab.evaluation.tables import MISSING, Table, number, write_json
from deckline_lab.reproduce.figures import draw_sequences, draw_training
from deckline_lab.reproduce.runs import make_data, run, shrink_pairs, train_networks
from deckline_lab.statistics import Difference

RIVALS = ("aod-net", "gca-net", "grid-dehaze-net", "g-unet-t", "dehaze-former-t")
FORMS = {  # ours comes first, DehazeFormer last
    "printed": ("full-t", *RIVALS),
    "coarse": ("coarse-t", *(f"{name}-coarse" for name in RIVALS)),
}
WEIGHTS_FILE = "dehaze.onnx"
RECIPE = """batch = 2
crop_height = 256
crop_width = 256
sub_images = true
lr = 1e-3
visible_share = 0.0
held_out = 0.02
cpu_minutes = true

[haze]
noise_share = 0.0
flip_vertical = 0.5
"""
EVERY = 3  # test pairs
COST_SIZE, COST_RUNS = (1280, 720), 3  # px, of a process each
MIB, MS = 2.0**20, 1e3

# Of Li et al. 2024, Table 4 and section 4.1. The table of its text is lost but for these.
PAPER = {"full-t": ("30.18", "0.972"), "dehaze-former-t": ("29.11", MISSING)}  # PSNR, dB, SSIM
PAPER_SAVES = {"memory": 26.27, "parameters": 29.44}  # %, ours against DehazeFormer
COLUMNS = (
    "form", "network", "PSNR, dB", "to ours [95 %], dB", "SSIM", "parameters", "GMACs 256x256", "GMACs 1280x720",
    "peak MiB", "ms", "steps", "paper, dB", "paper, SSIM",
)  # fmt: skip
NOTES = (
    "Printed: at full resolution. Coarse: the same layers between our 4x4 pixel-unshuffle and our guided filter; of a "
    "picture of 1280x720 they see one of 640x360. To ours: of the same form, paired over images, one training each; "
    "frames of one flight resemble each other, the intervals are too narrow.",
    "Peak memory beyond the loaded model, and time of one picture of 1280x720: ONNX Runtime on the processor, medians "
    f"of {COST_RUNS} processes.",
)
DIFFERS = """\
What differs: the paper trains on pictures of its own, 600,000 steps of 16 on an RTX 4090. Here all see the same
simulated pairs, averaged down by two and cut into eight squares of 256x256, for the same time of one core. The paper's
text does not name its five rivals; DehazeFormer's figure is ours less the lead that it states."""


def make_table4(runs: Path, path: Path, minutes: float, threads: int) -> None:
    """Ours and its five rivals in both forms, trained on the same pairs with the same budget; with Figures 11 to 13."""
    data, out = make_data(runs), runs / "table4"
    pairs, test = (shrink_pairs(data / split, runs / "pairs" / split) for split in ("train", "test"))
    names = [name for form in FORMS.values() for name in form]
    train_networks("dehaze", pairs, out, {name: name for name in names}, RECIPE, minutes, threads)
    measured = {form: measure_form(form, test, out, minutes) for form in FORMS}
    write_json(path, *tabulate(measured, out, minutes), {"forms": measured})
    figures = runs / "figures"
    draw_training({form: [out / name for name in names] for form, names in FORMS.items()}, figures / "figure11.png")
    files = {form: [out / name / WEIGHTS_FILE for name in names] for form, names in FORMS.items()}
    draw_sequences(test, files, (figures / "figure12.jpg", figures / "figure13.jpg"))


def measure_form(form: str, test: Path, out: Path, minutes: float) -> dict[str, Any]:
    """What `eval dehazing` measures of a form's networks, ours as reference; made once for each budget."""
    scores = out / f"{form}-{minutes:g}min"
    file = scores / "dehazing.json"
    if not file.is_file():
        files = [out / name / WEIGHTS_FILE for name in FORMS[form]]
        cost = ("--full-size", "--cost", "--cost-size", *COST_SIZE, "--cost-runs", COST_RUNS)
        options = ("--reference", files[0], "--detector", "none", "--every", EVERY, *cost)
        run("eval", "dehazing", test, "--dehazer", *files, *options, "--out", scores, "--json", file, quiet=True)
    return json.loads(file.read_text())


def tabulate(measured: Mapping[str, dict[str, Any]], out: Path, minutes: float) -> tuple[str, Sequence[Table]]:
    """Title and table of what `measure_form` gives, by form."""
    first = next(iter(measured.values()))
    untouched = first["visibility"]["all"][NOT_DEHAZED]
    rows = [(MISSING, "hazy", *_restoration_cells(untouched), *[MISSING] * (len(COLUMNS) - 5))]
    for form, names in FORMS.items():
        rows += [(form, *_cells(name, form, measured[form], out / name)) for name in names]
    notes = [*NOTES, *(_savings(form, measured[form]) for form in FORMS)]
    title = f"{untouched['images']} test pairs of 640x360; {minutes:g} CPU minutes for each network"
    return title, [Table("Table 4", COLUMNS, rows, notes)]


def _cells(name: str, form: str, measured: Mapping[str, Any], folder: Path) -> tuple[str, ...]:
    from deckline_lab.train.checkpoint import read_progress

    size, cost, progress = measured["size"][name], measured["cost"].get(name), read_progress(folder)
    peak = None if cost is None or cost["peak_bytes"] is None else cost["peak_bytes"] / MIB
    return (
        name,
        *_restoration_cells(measured["visibility"]["all"][name]),
        f"{size['parameters'] / 1e6:.3f} M",
        f"{size['macs_256'] / 1e9:.2f}",
        f"{macs_of_large(name, form) / 1e9:.1f}",
        number(peak, ".0f"),
        number(None if cost is None else MS * cost["seconds"], ".0f"),
        number(None if progress is None else progress["step"], "d"),
        *PAPER.get(name, (MISSING, MISSING)),
    )


def _restoration_cells(summary: Mapping[str, Any]) -> tuple[str, str, str]:
    means, difference = summary["means"], summary["differences"].get("psnr_db")
    lead = MISSING if difference is None else Difference(**difference).text("+.2f")
    return number(means["psnr_db"], ".2f"), lead, number(means.get("ssim"), ".4f")


def macs_of_large(name: str, form: str) -> int:
    """Multiply-accumulates of a picture of 1280x720, of which a coarse network's layers see one of 640x360."""
    from deckline_lab.rivals.dehazers import DEHAZERS
    from deckline_lab.train.dehaze import NETWORKS, DehazeTrainConfig
    from deckline_lab.train.export import network_cost

    network = (NETWORKS | DEHAZERS)[name](DehazeTrainConfig(network=name))
    return network_cost(network, (360, 640) if form == "coarse" else (720, 1280)).macs


def _savings(form: str, measured: Mapping[str, Any]) -> str:
    """Ours against DehazeFormer, as the paper states it."""
    ours, other = FORMS[form][0], FORMS[form][-1]
    pairs = {"parameters": [measured["size"][name]["parameters"] for name in (ours, other)]}
    peaks = [measured["cost"].get(name, {}).get("peak_bytes") for name in (ours, other)]
    if None not in peaks:
        pairs["memory"] = peaks
    parts = [
        f"{what} {100 * (a / b - 1):+.2f} % (the paper -{PAPER_SAVES[what]:.2f} %)" for what, (a, b) in pairs.items()
    ]
    return f"{form}: {ours} against {other}: {', '.join(parts)}."
