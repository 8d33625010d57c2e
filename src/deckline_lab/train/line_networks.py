"""Our line networks: `hybrid`, which flies, and the earlier `ufld` with row anchors alone.

Both read anchors from a feature pyramid on EfficientNet-Lite0 and locate the runway. Anchors that are read from
the pyramid are shift equivariant and have a fortieth of the parameters of the published fully connected heads, so that
they learn from thousands of images instead of a hundred thousand.

Sources: Qin, Wang and Li, "Ultra Fast Structure-aware Deep Lane Detection", 2020 (row anchors); Qin, Zhang and Li,
"Ultra Fast Deep Lane Detection with Hybrid Anchor Driven Ordinal Classification", 2022 (rows for steep lines, columns
for flat ones).
"""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from deckline.detect.anchors import EDGE_OUTPUTS, EDGES, ROW_OUTPUTS, STRIDE, DecodeConfig, RowGrid
from deckline.detect.coarse_to_fine import DetectConfig
from deckline.detect.onnx_detector import ROWS_ALONE
from deckline_lab.train import detect_losses
from deckline_lab.train.backbone import CHANNELS, Lite0Backbone, conv_norm, separable
from deckline_lab.train.detect_losses import DetectTargets, HybridOutput, Losses, LossWeights, UfldOutput

LINES = 2  # left and right
ALL_LINES = 3  # the centre line too
CELL_PX = 4  # of an anchor's cell and between anchors: the pyramid's finest stride


@dataclass(frozen=True)
class NetworkKind:
    """What a network takes, how it is taught and how it is read."""

    search: DetectConfig = field(default_factory=DetectConfig)  # grid, decoding, crops, what counts as seen
    target_grid: RowGrid = field(default_factory=RowGrid)  # of the row anchors that the truth comes in
    output_names: tuple[str, ...] = ROW_OUTPUTS  # of the exported graph
    lines: int = LINES

    @property
    def grid(self) -> RowGrid:
        """Of the points that are decoded."""
        return self.search.grid


class LineNetwork(nn.Module):
    """(B, 3, H, W) normalised views -> a named tuple that begins with the exported outputs, in their order.

    What has ImageNet weights is called `backbone` and learns slower than the rest; what runs in training only is called
    `segmentation`.
    """

    kind: NetworkKind
    rates: ClassVar[Mapping[str, float]] = {}  # learning rates relative to the recipe's, by how parameters begin

    @abstractmethod
    def loss(self, output: Any, targets: DetectTargets, weights: LossWeights, fraction: float) -> Losses:
        """Loss of a batch and its parts by name.

        Args:
            output: of the network in training mode.
            targets: truth of `kind.lines` lines on the row anchors of `kind.target_grid`.
            weights: of the parts that all networks share.
            fraction: of the training that is done.
        """


@dataclass(frozen=True)
class PyramidConfig:
    """Shape of our networks."""

    grid: RowGrid = field(default_factory=RowGrid)
    channels: int = 64  # of the feature pyramid
    pretrained: bool = True  # start from the ImageNet weights
    frozen_blocks: int = 2  # of the backbone, not trained

    def __post_init__(self) -> None:
        grid = self.grid
        if grid.width % 32 or grid.height % 32:
            raise ValueError(f"grid: the network needs sides that 32 divides, got {grid.width}x{grid.height} px")
        if (grid.cells * CELL_PX, grid.rows * CELL_PX) != (grid.width, grid.height):
            raise ValueError(f"grid: cells and rows must be {CELL_PX} px apart, got {grid}")


class PyramidNetwork(LineNetwork):
    """EfficientNet-Lite0 and a feature pyramid at strides 4, 8, 16 and 32."""

    def __init__(self, config: PyramidConfig | None = None) -> None:
        super().__init__()
        self.config = config or PyramidConfig()
        width = self.config.channels
        self.backbone = Lite0Backbone(self.config.pretrained, self.config.frozen_blocks)
        self.lateral = nn.ModuleList(conv_norm(channels, width, 1) for channels in CHANNELS)
        self.smooth = nn.ModuleList(separable(width, width) for _ in CHANNELS)

    def pyramid(self, image: Tensor) -> list[Tensor]:
        """(B, 3, H, W) -> maps of the pyramid's channels at strides 4, 8, 16 and 32."""
        taps = self.backbone(image)
        levels = [self.smooth[3](self.lateral[3](taps[3]))]
        for index in (2, 1, 0):
            level = F.interpolate(levels[0], scale_factor=2.0, mode="nearest") + self.lateral[index](taps[index])
            levels.insert(0, self.smooth[index](level))
        return levels


class Ufld(PyramidNetwork):
    """(B, 3, H, W) normalised views -> row classes and region."""

    def __init__(self, config: PyramidConfig | None = None) -> None:
        super().__init__(config)
        self.kind = NetworkKind(replace(ROWS_ALONE, grid=self.config.grid), self.config.grid)
        width = self.config.channels
        self.rows = RowHead(width)
        self.region = RegionHead(width)
        self.segmentation = nn.Conv2d(width, LINES + 1, 1)

    def forward(self, image: Tensor) -> UfldOutput:
        quarter, eighth, sixteenth, _ = self.pyramid(image)
        region, box = self.region(eighth, sixteenth)
        return UfldOutput(self.rows(quarter), region, box, self.segmentation(eighth) if self.training else None)

    def loss(self, output: Any, targets: DetectTargets, weights: LossWeights, fraction: float) -> Losses:
        return detect_losses.ufld_loss(output, targets, weights)


class Hybrid(PyramidNetwork):
    """(B, 3, H, W) normalised views -> row and column classes of left, right and centre, region, kind of edge."""

    def __init__(self, config: PyramidConfig | None = None) -> None:
        super().__init__(config)
        grid, width = self.config.grid, self.config.channels
        self.kind = NetworkKind(
            DetectConfig(grid, DecodeConfig(min_line_share=0.5)),
            target_grid=RowGrid(grid.width, grid.height, grid.width, grid.height),  # anchors one pixel apart
            output_names=EDGE_OUTPUTS,
            lines=ALL_LINES,
        )
        self.anchors = nn.Sequential(separable(width, width, 5), separable(width, width, 5))
        self.row_cells = nn.Conv2d(width, ALL_LINES, 1)
        self.column_cells = nn.Conv2d(width, ALL_LINES, 1)
        self.row_crossed = CrossingHead(width)
        self.column_crossed = CrossingHead(width)
        self.region = RegionHead(width)
        self.edge = nn.Sequential(nn.Linear(2 * width, width), nn.ReLU(), nn.Linear(width, len(EDGES)))
        self.segmentation = nn.Conv2d(width, ALL_LINES + 1, 1)

    def forward(self, image: Tensor) -> HybridOutput:
        quarter, eighth, sixteenth, _ = self.pyramid(image)
        features = self.anchors(quarter)
        rows = join_classes(self.row_cells(features), self.row_crossed(features, 3))
        columns = join_classes(self.column_cells(features).transpose(2, 3), self.column_crossed(features, 2))
        region, box = self.region(eighth, sixteenth)
        edge = self.edge(pool(features, (2, 3)))
        return HybridOutput(rows, columns, region, box, edge, self.segmentation(eighth) if self.training else None)

    def loss(self, output: Any, targets: DetectTargets, weights: LossWeights, fraction: float) -> Losses:
        anchors = detect_losses.anchor_targets(targets.cell, self.kind.grid)
        return detect_losses.hybrid_loss(output, targets, anchors, weights)


class RowHead(nn.Module):
    """Cells of every row from the pyramid's stride-4 map; "no line" from the whole row."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.blocks = nn.Sequential(separable(width, width, 5), separable(width, width, 5))
        self.cells = nn.Conv2d(width, LINES, 1)
        self.none = anchor_layers(width, LINES)

    def forward(self, features: Tensor) -> Tensor:
        features = self.blocks(features)
        return torch.cat([self.cells(features), self.none(pool(features, 3))[..., None]], dim=3)


def anchor_layers(width: int, lines: int) -> nn.Sequential:
    """(B, 2 width, anchors) -> (B, lines, anchors)."""
    return nn.Sequential(nn.Conv1d(2 * width, width, 5, padding=2), nn.ReLU(), nn.Conv1d(width, lines, 5, padding=2))


def pool(features: Tensor, axis: int | tuple[int, int]) -> Tensor:
    """Mean and maximum along an axis, twice the channels."""
    return torch.cat([features.mean(axis), features.amax(axis)], dim=1)


class CrossingHead(nn.Module):
    """Whether the lines cross each row (or column): from the mean and maximum along it."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.layers = anchor_layers(width, ALL_LINES)

    def forward(self, features: Tensor, along: int) -> Tensor:
        """(B, C, h, w) -> (B, 3, anchors) logits; `along` is the axis that is pooled."""
        return self.layers(pool(features, along))


def join_classes(cells: Tensor, crossed: Tensor) -> Tensor:
    """Cell logits (..., cells) and "crossed" logits (...) as one softmax of cells + 1 classes.

    Its last class gets the probability that the anchor is not crossed, exactly: 1 - sigmoid(crossed).
    """
    shares = cells.float().log_softmax(-1) + crossed.float()[..., None]
    return torch.cat([shares, torch.zeros_like(shares[..., :1])], dim=-1)


class RegionHead(nn.Module):
    """Where the runway is, on the stride-16 grid, from maps of `width` channels at strides 8 and 16."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.hidden = nn.Sequential(separable(2 * width, width, 5), separable(width, width, 5))
        self.cells = nn.Conv2d(width, 5, 1)
        self.none = nn.Sequential(nn.Linear(2 * width, width), nn.ReLU(), nn.Linear(width, 1))

    def forward(self, eighth: Tensor, sixteenth: Tensor) -> tuple[Tensor, Tensor]:
        hidden = self.hidden(torch.cat([F.max_pool2d(eighth, STRIDE // 8), sixteenth], dim=1))
        cells = self.cells(hidden)
        none = self.none(pool(hidden, (2, 3)))
        return torch.cat([cells[:, 0].flatten(1), none], dim=1), cells[:, 1:]
