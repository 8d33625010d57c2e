"""GridDehazeNet: a grid of dense blocks, three sizes by six columns, joined by weights for every channel.

Source: Liu, Ma, Shi and Chen, "GridDehazeNet: Attention-Based Multi-Scale Network for Image Dehazing", ICCV 2019.
Published: 0.956 M parameters, 21.5 GMACs at 256x256. Counted here: 0.956 M and 18.7 G. The published count charges the
transposed convolutions' weights at every pixel of their output; with stride 2 each output pixel uses a quarter of them.
Counted that way this network has 21.4 GMACs.
"""

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from deckline_lab.rivals.dehazers.common import pad_to_multiple

ROWS = 3  # sizes; each row down has half the size and twice the channels; published
COLUMNS = 6  # features flow down through the first half of them and up through the other; published
CHANNELS = 16  # of the first row; published
LAYERS, GROWTH = 4, 16  # of a dense block, and channels that each adds; published


class ResidualDenseBlock(nn.Module):
    """3x3 convolutions that each see all before them, a 1x1 convolution back to the channels, plus the input."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.layers = nn.ModuleList(nn.Conv2d(channels + k * GROWTH, GROWTH, 3, padding=1) for k in range(LAYERS))
        self.fuse = nn.Conv2d(channels + LAYERS * GROWTH, channels, 1)

    def forward(self, x: Tensor) -> Tensor:
        seen = x
        for layer in self.layers:
            seen = torch.cat([seen, F.relu(layer(seen))], 1)
        return self.fuse(seen) + x


def grid_down(channels: int) -> nn.Sequential:
    """Half the size, then twice the channels."""
    halve, widen = nn.Conv2d(channels, channels, 3, 2, 1), nn.Conv2d(channels, 2 * channels, 3, padding=1)
    return nn.Sequential(halve, nn.ReLU(), widen, nn.ReLU())


def grid_up(channels: int) -> nn.Sequential:
    """Twice the size, then half the channels."""
    double = nn.ConvTranspose2d(channels, channels, 3, 2, 1, output_padding=1)
    return nn.Sequential(double, nn.ReLU(), nn.Conv2d(channels, channels // 2, 3, padding=1), nn.ReLU())


class GridColumn(nn.Module):
    """One column: every row through a dense block, plus what comes from the row before, weighted for every channel.

    `channels` are of the first row; features flow `downwards`, from larger to smaller rows, or the other way.
    """

    def __init__(self, channels: int, downwards: bool) -> None:
        super().__init__()
        self.downwards = downwards
        widths = [channels * 2**row for row in (range(ROWS) if downwards else reversed(range(ROWS)))]
        link = grid_down if downwards else grid_up
        self.dense = nn.ModuleList(ResidualDenseBlock(width) for width in widths)
        self.links = nn.ModuleList(link(width) for width in widths[:-1])
        self.joints = nn.ParameterList(nn.Parameter(torch.ones(2, width, 1, 1)) for width in widths[1:])

    def forward(self, nodes: list[Tensor]) -> list[Tensor]:
        """Features of every row, largest first, and the same of the next column."""
        before = nodes if self.downwards else nodes[::-1]
        after = [dense(node) for dense, node in zip(self.dense, before, strict=True)]
        for row, (link, joint) in enumerate(zip(self.links, self.joints, strict=True), start=1):
            after[row] = joint[0] * after[row] + joint[1] * link(after[row - 1])
        return after if self.downwards else after[::-1]


class GridDehazeNet(nn.Module):
    """The paper's network; its last rectifier is left out, whoever makes an image of the output clips it."""

    def __init__(self, inputs: int = 3, outputs: int = 3) -> None:
        super().__init__()
        self.intro = nn.Sequential(nn.Conv2d(inputs, CHANNELS, 3, padding=1), ResidualDenseBlock(CHANNELS))
        self.first_column = nn.ModuleList(grid_down(CHANNELS * 2**row) for row in range(ROWS - 1))
        self.columns = nn.ModuleList(GridColumn(CHANNELS, column < COLUMNS // 2) for column in range(1, COLUMNS))
        self.outro = nn.Sequential(ResidualDenseBlock(CHANNELS), nn.Conv2d(CHANNELS, outputs, 3, padding=1))

    def forward(self, image: Tensor) -> Tensor:
        """(N, 3, H, W) RGB in 0..1 to the same shape, not clipped."""
        return self.estimate(image)

    def estimate(self, image: Tensor) -> Tensor:
        """What the last convolution gives, (N, outputs, H, W)."""
        nodes = [self.intro(2 * pad_to_multiple(image, 2 ** (ROWS - 1)) - 1)]
        for link in self.first_column:
            nodes.append(link(nodes[-1]))
        for column in self.columns:
            nodes = column(nodes)
        return self.outro(nodes[0])[:, :, : image.shape[2], : image.shape[3]]
