"""A view with two lines and an empty one, and their truth on anchors one pixel apart, for the painting networks."""

import numpy as np
import torch

from deckline.detect.anchors import encode_region
from deckline.train.detect_losses import DetectTargets


def painted_batch(width: int, height: int) -> tuple[torch.Tensor, DetectTargets]:
    """Views (2, 3, height, width) and targets; the lines stand upright at a third and at two thirds."""
    image, cell = torch.zeros(2, 3, height, width), torch.full((2, 2, height), float("nan"))
    for line, u in enumerate((width // 3, 2 * width // 3)):
        image[0, :, :, u - 1 : u + 2] = 3.0
        cell[0, line] = u
    cells = (width // 16, height // 16)
    box = [width / 3, 1.0, 2 * width / 3, height - 2.0]
    pairs = zip(encode_region(box, cells), encode_region(None, cells), strict=True)
    return image, DetectTargets(
        cell, torch.ones(2, 2, dtype=torch.bool), *(torch.from_numpy(np.stack(pair)) for pair in pairs)
    )
