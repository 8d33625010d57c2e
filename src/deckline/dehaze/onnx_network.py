"""The trained dehazing network as an ONNX file."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deckline.dehaze.base import check_image
from deckline.dehaze.network_io import (
    MIN_SIDE_PX,
    averaged_down,
    image_to_tensor,
    padded,
    reduction_factor,
    tensor_to_image,
)
from deckline.runtime import load_session


class OnnxDehazer:
    """Runs an exported network on images of any size.

    A coarse network has a second input, `working`: the image averaged down to about the size that the network was
    trained on. It estimates there; the result is applied to the full image.

    Args:
        path: file made by `deckline train dehaze`.
        name: for reports; the file's name when not given.
        threads: of ONNX Runtime; None lets it take every core.

    Raises:
        ValueError: no ONNX file, or one that is no dehazing network of deckline.
    """

    def __init__(self, path: Path, name: str | None = None, threads: int | None = None) -> None:
        self.name = name or Path(path).name
        self.session = load_session(path, threads)
        kind = self.session.config.get("kind")
        if kind != "dehaze":
            raise ValueError(f"{path} is no dehazing network: its metadata says kind {kind!r}, expected 'dehaze'")
        self.coarse = "working" in self.session.input_names
        self.working_long_side_px = int(self.session.config["working_long_side_px"])
        self.grid_px = int(self.session.config["network"]["unshuffle"])

    def __call__(self, image_rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        check_image(image_rgb)
        height, width = image_rgb.shape[:2]
        if self.coarse:
            factor = reduction_factor(height, width, self.working_long_side_px)
            image = image_to_tensor(padded(image_rgb, factor * self.grid_px, factor * MIN_SIDE_PX))
            (clear,) = self.session(image=image, working=averaged_down(image, factor))
        else:
            (clear,) = self.session(image=image_to_tensor(padded(image_rgb, 1)))
        return tensor_to_image(clear[:, :, :height, :width])
