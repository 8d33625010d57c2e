"""AOD-Net: five small convolutions estimate K of the reformulated scattering model, J = K I - K + 1.

Source: Li, Peng, Wang, Xu and Feng, "AOD-Net: All-in-One Dehazing Network", ICCV 2017.
Published: 0.0018 M parameters, 0.115 GMACs at 256x256. Counted here: 1761 and 0.1144 G.
"""

import torch
import torch.nn.functional as F
from torch import Tensor, nn

CONSTANT_BIAS = 1.0  # b of the paper's equation 4


class AodNet(nn.Module):
    """The paper's network.

    It starts at K = 1, which returns the image: K of 0, the usual start, lies at the rectifier's edge, where a colour
    may never begin to learn. The paper's last rectifier is left out; whoever makes an image of the output clips it.
    """

    def __init__(self, inputs: int = 3, outputs: int = 3) -> None:
        super().__init__()
        self.first = nn.Conv2d(inputs, 3, 1)
        self.second = nn.Conv2d(3, 3, 3, padding=1)
        self.third = nn.Conv2d(6, 3, 5, padding=2)
        self.fourth = nn.Conv2d(6, 3, 7, padding=3)
        self.fifth = nn.Conv2d(12, outputs, 3, padding=1)
        nn.init.zeros_(self.fifth.weight)
        self.fifth.bias = nn.Parameter(torch.ones(outputs))

    def forward(self, image: Tensor) -> Tensor:
        """(N, 3, H, W) RGB in 0..1 to the same shape, not clipped."""
        k = F.relu(self.estimate(image))
        return k * image - k + CONSTANT_BIAS

    def estimate(self, image: Tensor) -> Tensor:
        """What the last convolution gives, (N, outputs, H, W)."""
        first = F.relu(self.first(image))
        second = F.relu(self.second(first))
        third = F.relu(self.third(torch.cat([first, second], 1)))
        fourth = F.relu(self.fourth(torch.cat([second, third], 1)))
        return self.fifth(torch.cat([first, second, third, fourth], 1))
