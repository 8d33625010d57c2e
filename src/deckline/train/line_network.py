"""What every line network is to training, export and evaluation."""

from abc import abstractmethod
from dataclasses import dataclass, field
from typing import NamedTuple

from torch import Tensor, nn

from deckline.detect.anchors import ROW_OUTPUTS, DecodeConfig, RowGrid
from deckline.train.detect_losses import DetectTargets, LossWeights

LINES = 2  # left and right; a third one is the centre line


@dataclass(frozen=True)
class NetworkKind:
    """What a network takes, how it is taught and how it is read."""

    grid: RowGrid = field(default_factory=RowGrid)  # of the points that are decoded
    target_grid: RowGrid = field(default_factory=RowGrid)  # of the row anchors that the truth comes in
    output_names: tuple[str, ...] = ROW_OUTPUTS  # of the exported graph
    decode: DecodeConfig = field(default_factory=DecodeConfig)
    lines: int = LINES


class LineNetwork(nn.Module):
    """(B, 3, H, W) normalised views -> a named tuple that begins with the exported outputs, in their order.

    What has ImageNet weights is called `backbone` and learns slower than the rest; what runs in training only is called
    `segmentation`.
    """

    kind: NetworkKind

    @abstractmethod
    def loss(
        self, output: NamedTuple, targets: DetectTargets, weights: LossWeights, fraction: float
    ) -> tuple[Tensor, dict[str, float]]:
        """Loss of a batch and its parts by name.

        Args:
            output: of the network in training mode.
            targets: truth of `kind.lines` lines on the row anchors of `kind.target_grid`.
            weights: of the parts that all networks share.
            fraction: of the training that is done.
        """
