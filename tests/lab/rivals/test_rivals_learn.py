"""What every rival must be able to do: learn a deck's lines in 40 steps, from features of a frozen backbone."""

import tomllib
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from deckline.config_file import config_from_table
from deckline.detect.anchors import RowGrid
from deckline.detect.coarse_to_fine import decode_lines
from deckline.detect.crop import Crop
from deckline_lab.reproduce import table6
from deckline_lab.rivals.detectors import DETECTORS
from deckline_lab.train.backbone import BLOCKS
from deckline_lab.train.detect import DetectTrainConfig, make_optimizer, torch_infer
from deckline_lab.train.detect_losses import DetectTargets
from deckline_lab.train.detect_samples import make_batch
from deckline_lab.train.line_networks import PyramidConfig
from deckline_lab.train.line_views import make_line_view
from deckline_lab.train.loop import RATE
from deckline_lab.train.view_sets import Views
from deckline_sim import SimConfig
from deckline_sim.config import DepthConfig
from deckline_sim.simulate import ShipSimulator

SHAPE = PyramidConfig(RowGrid(224, 128, 56, 32), frozen_blocks=BLOCKS)
RECIPE = replace(config_from_table(DetectTrainConfig, tomllib.loads(table6.RECIPE)), shape=SHAPE)
CLOSE = replace(RECIPE.augment, close_share=1.0, empty_share=0.1)
DECKS, BATCH, TRAINING, HELD_OUT, STEPS = 36, 8, 12, 4, 40  # decks, views a batch, batches
BOUND = {"ufld-lite0": 4.5, "sad-lite0": 2.5, "resa-lite0": 3.0}  # of the loss on held-out views
FOUND = 0.6  # of held-out decks, both lines


class Cached(nn.Module):
    """A frozen backbone whose features are known."""

    taps: list[Tensor]

    def forward(self, image: Tensor) -> list[Tensor]:
        return self.taps


@pytest.fixture(scope="module")
def views():
    """Training and held-out views of the paper's ship: other frames of one recording."""
    config = SimConfig(trajectory="random", frames=DECKS, width=640, height=360, depth=DepthConfig(float("inf")))
    with ShipSimulator(config) as simulator:
        frames = [make_line_view(simulator.frame(index)) for index in range(DECKS)]
    parts = {"decks": (DECKS, frames.__getitem__)}
    return [Views(parts, ["decks"], 0.25, train) for train in (True, False)]


@pytest.mark.parametrize("name", list(BOUND))
def test_a_rival_soon_finds_the_lines(name, views):
    torch.manual_seed(0)
    model = DETECTORS[name](RECIPE)
    batches = [
        [make_batch(part, BATCH, model.kind.target_grid, CLOSE, [1, k]) for k in range(count)]
        for part, count in zip(views, (TRAINING, HELD_OUT), strict=True)
    ]
    backbone, model.backbone = model.backbone, Cached()
    with torch.no_grad():
        features = [[backbone(image) for image, _ in part] for part in batches]
    optimizer = make_optimizer(RECIPE, model)
    for group in optimizer.param_groups:
        group["lr"] = RECIPE.lr * group[RATE]

    def loss(part: int, k: int) -> Tensor:
        model.backbone.taps, (image, targets) = features[part][k], batches[part][k]
        return model.loss(model(image), targets.first(model.kind.lines), RECIPE.losses, fraction=0.0)[0]

    def held_out() -> float:
        model.eval()
        with torch.no_grad():
            return float(np.mean([float(loss(1, k)) for k in range(HELD_OUT)]))

    before = held_out()
    model.train()
    for step in range(STEPS):
        optimizer.zero_grad()
        loss(0, step % TRAINING).backward()
        optimizer.step()
    after = held_out()
    assert after < BOUND[name] < before
    model.backbone = backbone
    found = [find_both(model, image, targets, k) for image, targets in batches[1] for k in range(BATCH)]
    decks = [both for both in found if both is not None]
    assert len(decks) > 20
    assert np.mean(decks) > FOUND


def find_both(model: nn.Module, image: Tensor, targets: DetectTargets, k: int) -> bool | None:
    """Whether the published rule accepts both lines of view `k` of a batch; None for one that does not show both."""
    if not (~torch.isnan(targets.cell[k, :2])).any(1).all():
        return None
    lines = decode_lines(torch_infer(model)(image[k].numpy()), Crop(0.0, 0.0, 1.0), model.kind.search)
    return len(lines.left) > 0 and len(lines.right) > 0
