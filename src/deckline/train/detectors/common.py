"""What several line networks share: the region branch, the "is there this line" branch, and the upright stripe."""

import torch.nn.functional as F
from torch import Tensor, nn

from deckline.train.ufld import RegionHead, conv_norm, separable

REGION_WIDTH = 64  # channels, as in our own network


class RegionBranch(nn.Module):
    """Where the runway is. No part of the published networks: with it all of them look twice, as ours does.

    Args:
        eighth: channels of the features at stride 8.
        sixteenth: channels of those at stride 16; None where a network has none.
    """

    def __init__(self, eighth: int, sixteenth: int | None = None) -> None:
        super().__init__()
        self.eighth = conv_norm(eighth, REGION_WIDTH, 1)
        self.sixteenth = (
            separable(REGION_WIDTH, REGION_WIDTH) if sixteenth is None else conv_norm(sixteenth, REGION_WIDTH, 1)
        )
        self.head = RegionHead(REGION_WIDTH)

    def forward(self, eighth: Tensor, sixteenth: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """Class logits (B, cells + 1) and box offsets (B, 4, rows, columns) on the stride-16 grid."""
        near = self.eighth(eighth)
        return self.head(near, self.sixteenth(F.max_pool2d(near, 2) if sixteenth is None else sixteenth))


class LineExistence(nn.Module):
    """Which lines are in the view, from features at stride 8: the branch that SCNN introduced.

    Args:
        channels: of the features.
        hidden: channels of a first 3x3 convolution; None goes straight to the class maps.
        lines: how many.
        grid_size: width and height of the features; the fully connected layer fixes them.

    Source: Pan et al., "Spatial As Deep: Spatial CNN for Traffic Scene Understanding", 2018.
    """

    FC_WIDTH = 128  # published

    def __init__(self, channels: int, hidden: int | None, lines: int, grid_size: tuple[int, int]) -> None:
        super().__init__()
        self.hidden: nn.Module = nn.Identity()
        if hidden is not None:
            conv = nn.Conv2d(channels, hidden, 3, padding=4, dilation=4, bias=False)
            self.hidden = nn.Sequential(conv, nn.BatchNorm2d(hidden), nn.ReLU())
        self.classes = nn.Sequential(nn.Dropout2d(0.1), nn.Conv2d(hidden or channels, lines + 1, 1))
        flat = (lines + 1) * (grid_size[0] // 2) * (grid_size[1] // 2)
        self.fc = nn.Sequential(nn.Linear(flat, self.FC_WIDTH), nn.ReLU(), nn.Linear(self.FC_WIDTH, lines))

    def forward(self, features: Tensor) -> Tensor:
        """(B, lines) logits."""
        shares = self.classes(self.hidden(features)).softmax(1)
        return self.fc(F.avg_pool2d(shares, 2).flatten(1))
