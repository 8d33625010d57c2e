"""The trained dehazing network as an ONNX file."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deckline.dehaze.base import Restored, check_image
from deckline.dehaze.geometry import GeometryDehazer, Solved
from deckline.dehaze.joining import joined, kept
from deckline.dehaze.network_io import (
    MIN_SIDE_PX,
    averaged_down,
    brought_up,
    image_to_tensor,
    padded,
    reduction_factor,
    tensor_to_image,
)
from deckline.runtime import load_session
from deckline.types import Frame


class OnnxDehazer:
    """Runs an exported network on images of any size.

    Every network sees an image averaged down to about the size that it was trained on, and the result is brought to
    full size: a coarse network's K and B by the network itself, which takes both images, that of a network without a
    coarse grid along the image's edges by `brought_up`. A network with a prior goes on from the picture that the
    geometry dehazer makes of a frame with a pose, and from the image itself where there is none.

    Args:
        path: file made by `deckline train dehaze`.
        name: for reports; the file's name when not given.
        threads: of ONNX Runtime; None lets it take every core.
        working_long_side_px: what larger images are averaged down to; None: the size that the network was trained on.
        alone: give what the network gives. Otherwise the result of one with a prior is joined with geometry's picture,
            and changes too small to be haze are not made: see `joining`.

    Raises:
        ValueError: no ONNX file, or one that is no dehazing network of deckline.
    """

    def __init__(
        self,
        path: Path,
        name: str | None = None,
        threads: int | None = None,
        working_long_side_px: int | None = None,
        alone: bool = False,
    ) -> None:
        self.name = name or Path(path).name
        self.session = load_session(path, threads)
        kind = self.session.config.get("kind")
        if kind != "dehaze":
            raise ValueError(f"{path} is no dehazing network: its metadata says kind {kind!r}, expected 'dehaze'")
        self.coarse = "working" in self.session.input_names
        self.geometry = GeometryDehazer() if self.session.config["network"].get("prior") else None
        self.alone = alone or self.geometry is None
        trained_px = int(self.session.config["working_long_side_px"])
        self.working_long_side_px = trained_px if working_long_side_px is None else working_long_side_px
        self.grid_px = int(self.session.config["network"]["unshuffle"])

    @property
    def cost(self) -> tuple[int, int] | None:
        """Parameters, and multiply-accumulates at 256x256; None for a file that does not say."""
        config = self.session.config
        return (config["parameters"], config["macs_256"]) if "macs_256" in config else None

    def __call__(self, image_rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        check_image(image_rgb)
        clear = self._run(image_rgb, image_rgb)
        return clear if self.alone else kept(image_rgb, clear)

    def restore(self, frame: Frame) -> Restored:
        solved = None if self.geometry is None else self.geometry.solve(frame)
        if not isinstance(solved, Solved):
            return Restored(self(frame.image_rgb))
        clear = self._run(frame.image_rgb, solved.image_rgb)
        return Restored(clear if self.alone else joined(clear, solved))

    def _run(self, image_rgb: NDArray[np.uint8], prior_rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        height, width = image_rgb.shape[:2]
        factor = reduction_factor(height, width, self.working_long_side_px)
        image = self._tensor(image_rgb, factor)
        working = averaged_down(image, factor)
        if not self.coarse:
            (clear,) = self.session(image=working)
            clear = brought_up(image, working, clear, factor)
        elif self.geometry is None:
            (clear,) = self.session(image=image, working=working)
        else:
            prior = image if prior_rgb is image_rgb else self._tensor(prior_rgb, factor)
            both = np.concatenate([working, averaged_down(prior, factor)], axis=1)
            (clear,) = self.session(image=prior, working=both)
        return tensor_to_image(clear[:, :, :height, :width])

    def _tensor(self, image_rgb: NDArray[np.uint8], factor: int) -> NDArray[np.float32]:
        return image_to_tensor(padded(image_rgb, factor * self.grid_px, factor * MIN_SIDE_PX))
