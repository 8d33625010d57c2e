"""Row-anchor network for two lines, with a head that says where the runway is.

Two heads for the rows. `fc` is the published one (Qin et al., 2020): everything flattened into fully connected layers.
`row-conv` reads every row's classes from a feature pyramid at the row anchors' own resolution: the same classes, shift
equivariant, a fortieth of the parameters, so that it learns from thousands of images instead of a hundred thousand.
"""

from dataclasses import dataclass, field
from typing import Literal

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from deckline.detect.anchors import STRIDE, RowGrid
from deckline.train.backbone import CHANNELS, Lite0Backbone, depthwise
from deckline.train.detect_losses import DetectTargets, LossWeights, UfldOutput, detect_loss
from deckline.train.line_network import LINES, LineNetwork, NetworkKind

FC_SQUEEZE = 8  # channels before flattening; published


@dataclass(frozen=True)
class UfldConfig:
    """Shape of the network."""

    head: Literal["row-conv", "fc"] = "row-conv"
    grid: RowGrid = field(default_factory=RowGrid)
    channels: int = 64  # of the feature pyramid
    fc_hidden: int = 2048  # of the fc head; published
    pretrained: bool = True
    frozen_blocks: int = 2

    def __post_init__(self) -> None:
        if self.head not in ("row-conv", "fc"):
            raise ValueError(f'head must be "row-conv" or "fc", got {self.head!r}')
        if self.grid.width % 32 or self.grid.height % 32:
            raise ValueError(f"the network needs sides that 32 divides, got {self.grid.width}x{self.grid.height} px")
        if self.head == "row-conv" and (self.grid.cells * 4, self.grid.rows * 4) != (self.grid.width, self.grid.height):
            raise ValueError("the row-conv head has cells and rows of 4 px; use the fc head for other grids")


class Ufld(LineNetwork):
    """(B, 3, H, W) normalised views -> row classes and region."""

    def __init__(self, config: UfldConfig | None = None) -> None:
        super().__init__()
        self.config = config or UfldConfig()
        self.kind = NetworkKind(self.config.grid, self.config.grid)
        width = self.config.channels
        self.backbone = Lite0Backbone(self.config.pretrained, self.config.frozen_blocks)
        self.lateral = nn.ModuleList(conv_norm(channels, width, 1) for channels in CHANNELS)
        self.smooth = nn.ModuleList(separable(width, width) for _ in CHANNELS)
        self.rows = _FcRows(self.config) if self.config.head == "fc" else _RowConv(width)
        self.region = RegionHead(width)
        self.segmentation = nn.Conv2d(width, LINES + 1, 1)

    def forward(self, image: Tensor) -> UfldOutput:
        taps = self.backbone(image)
        level = self.lateral[3](taps[3])
        pyramid = [self.smooth[3](level)]
        last = 1 if self.config.head == "fc" else 0
        for index in range(2, last - 1, -1):
            level = F.interpolate(pyramid[0], scale_factor=2.0, mode="nearest") + self.lateral[index](taps[index])
            pyramid.insert(0, self.smooth[index](level))
        eighth, sixteenth = pyramid[-3], pyramid[-2]
        region, box = self.region(eighth, sixteenth)
        rows = self.rows(taps[3] if self.config.head == "fc" else pyramid[0])
        return UfldOutput(rows, region, box, self.segmentation(eighth) if self.training else None)

    def loss(  # type: ignore[override]  # the output is its own
        self, output: UfldOutput, targets: DetectTargets, weights: LossWeights, fraction: float
    ) -> tuple[Tensor, dict[str, float]]:
        return detect_loss(output, targets, weights)


class _RowConv(nn.Module):
    """Cells of every row from the pyramid's stride-4 map; "no line" from the whole row."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.blocks = nn.Sequential(separable(width, width, 5), separable(width, width, 5))
        self.cells = nn.Conv2d(width, LINES, 1)
        self.none = nn.Sequential(
            nn.Conv1d(2 * width, width, 5, padding=2), nn.ReLU(), nn.Conv1d(width, LINES, 5, padding=2)
        )

    def forward(self, features: Tensor) -> Tensor:
        features = self.blocks(features)
        pooled = torch.cat([features.mean(3), features.amax(3)], dim=1)
        return torch.cat([self.cells(features), self.none(pooled)[..., None]], dim=3)


class _FcRows(nn.Module):
    """The published head."""

    def __init__(self, config: UfldConfig) -> None:
        super().__init__()
        grid = config.grid
        self.shape = (LINES, grid.rows, grid.cells + 1)
        self.squeeze = nn.Conv2d(CHANNELS[3], FC_SQUEEZE, 1)
        flat = FC_SQUEEZE * (grid.width // 32) * (grid.height // 32)
        outputs = LINES * grid.rows * (grid.cells + 1)
        self.fc = nn.Sequential(nn.Linear(flat, config.fc_hidden), nn.ReLU(), nn.Linear(config.fc_hidden, outputs))

    def forward(self, features: Tensor) -> Tensor:
        return self.fc(self.squeeze(features).flatten(1)).unflatten(1, self.shape)


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
        none = self.none(torch.cat([hidden.mean((2, 3)), hidden.amax((2, 3))], dim=1))
        return torch.cat([cells[:, 0].flatten(1), none], dim=1), cells[:, 1:]


class DepthwiseConv2d(nn.Conv2d):
    """Each channel with its own kernel; the size is kept."""

    def __init__(self, channels: int, kernel: int) -> None:
        super().__init__(channels, channels, kernel, padding=kernel // 2, groups=channels, bias=False)

    def forward(self, x: Tensor) -> Tensor:
        return depthwise(x, self.weight, None, padding=(self.kernel_size[0] // 2, self.kernel_size[1] // 2))


def conv_norm(channels_in: int, channels_out: int, kernel: int) -> nn.Sequential:
    """Convolution that keeps the size, and batch norm."""
    conv = nn.Conv2d(channels_in, channels_out, kernel, padding=kernel // 2, bias=False)
    return nn.Sequential(conv, nn.BatchNorm2d(channels_out))


def separable(channels_in: int, channels_out: int, kernel: int = 3) -> nn.Sequential:
    """Depthwise convolution that keeps the size, then one over channels, each with batch norm and ReLU."""
    return nn.Sequential(
        nn.Sequential(DepthwiseConv2d(channels_in, kernel), nn.BatchNorm2d(channels_in)),
        nn.ReLU(),
        conv_norm(channels_in, channels_out, 1),
        nn.ReLU(),
    )
