"""Average a detector's training with the file that it started from: what it learned, with what it would forget.

    python scripts/average_weights.py RUN START.onnx RECORDING... --share 0.7 --out hybrid.onnx

The start's batch norms are given the statistics of the recordings' views, as at the beginning of the training. With
--norms the mean's are measured anew: those of neither fit it.
Source: Wortsman et al., "Robust fine-tuning of zero-shot models", 2022.
"""

import argparse
from pathlib import Path

import torch
from torch import Tensor, nn

from deckline_lab.train.checkpoint import read_progress, read_tensors
from deckline_lab.train.detect import START_VIEWS, export_detect
from deckline_lab.train.detect_samples import DetectAugmentation, make_batch
from deckline_lab.train.line_networks import Hybrid
from deckline_lab.train.line_views import open_line_views
from deckline_lab.train.start import recalibrate_batch_norm, start_detector

BATCH = 16


@torch.no_grad()
def measure_norms(model: Hybrid, batches: list[Tensor]) -> None:
    """Give the batch norms that training uses the mean statistics of batches (B, 3, H, W); none: they stay."""
    norms = [
        part
        for name, part in model.named_modules()
        if isinstance(part, nn.BatchNorm2d) and not name.startswith("backbone.") and batches
    ]
    for norm in norms:
        norm.reset_running_stats()
        norm.momentum = None  # the mean of all batches
        norm.train()
    for batch in batches:
        model(batch)


def main() -> None:
    parser = argparse.ArgumentParser(description="Average a detector's training with the file that it started from.")
    parser.add_argument("run", type=Path, help="folder of a training of network hybrid")
    parser.add_argument("start", type=Path, help="the .onnx file that it started from")
    parser.add_argument("recordings", type=Path, nargs="+", help="some of the training's recordings")
    parser.add_argument("--share", type=float, required=True, help="of the trained weights, 0 to 1")
    parser.add_argument(
        "--norms", type=int, default=0, help="views from which the mean's batch norms are measured anew"
    )
    parser.add_argument("--out", type=Path, required=True, help="the file to write")
    given = parser.parse_args()
    progress = read_progress(given.run)
    if progress is None or not 0 <= given.share <= 1:
        parser.error(f"{given.run} must hold a checkpoint and --share lie in 0 to 1, got {given.share}")
    model = Hybrid().eval()
    start_detector(model, given.start)
    views = open_line_views(given.recordings, held_out=0.02)
    seed = [progress["recipe"]["seed"]]
    recalibrate_batch_norm(model, make_batch(views, START_VIEWS, model.kind.target_grid, DetectAugmentation(), seed)[0])
    trained, mean = read_tensors(given.run, "ema"), {}
    for name, first in model.state_dict().items():
        new = name.startswith("edge.") or not first.dtype.is_floating_point  # the start has no such head
        mean[name] = trained[name] if new else first.lerp(trained[name], given.share)
    model.load_state_dict(mean)
    grid, augment = model.kind.target_grid, DetectAugmentation()
    measure_norms(model, [make_batch(views, BATCH, grid, augment, [*seed, n])[0] for n in range(given.norms // BATCH)])
    print(export_detect(model.eval(), given.out, progress["recipe"], progress["step"]))


if __name__ == "__main__":
    main()
