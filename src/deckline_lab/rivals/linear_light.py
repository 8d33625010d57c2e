"""The geometry dehazer in linear light: haze adds to sRGB's light instead of the picture's levels."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from deckline.dehaze import GeometryDehazer
from deckline.dehaze.by_pose import GeometrySolution
from deckline.dehaze.haze_fit import NotFitted, WaterPrior
from deckline.dehaze.pixel_map import PixelMap, display_levels, linear_levels, luma
from deckline.types import Frame

LIGHT_TABLE = linear_levels(np.arange(256, dtype=np.float32))  # light, 0..255, of display levels


class LinearGeometryDehazer(GeometryDehazer):
    """`GeometryDehazer` whose fit, noise and inversion are those of linear light."""

    name = "geometry-linear"
    water = WaterPrior(0.95, 0.03, 0.43, 0.45)  # `haze_fit.DISPLAY_WATER` in sRGB's light

    def to_levels(self, image_rgb: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Light (H, W, 3), 0..255, of an image."""
        return LIGHT_TABLE[image_rgb]

    def solve(self, frame: Frame) -> GeometrySolution | NotFitted:
        """As `GeometryDehazer.solve`; the map that removes the haze works on light."""
        solution = super().solve(frame)
        if isinstance(solution, NotFitted):
            return solution
        remove = solution.remove
        return replace(solution, remove=LightMap(remove.gain, remove.chroma, remove.offset))


class LightMap(PixelMap):
    """A `PixelMap` of light, 0..255; its images are of display levels."""

    def __call__(self, image_rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The map of an image (H, W, 3) of any resolution."""
        import cv2

        size = image_rgb.shape[1], image_rgb.shape[0]
        chroma, shared = (cv2.resize(part, size) for part in (self.chroma, self.gain - self.chroma))
        light = [cv2.LUT(channel, LIGHT_TABLE) for channel in cv2.split(image_rgb)]
        shared = shared * luma(np.stack(light))
        scene = [
            channel * chroma + shared + cv2.resize(offset, size)
            for channel, offset in zip(light, self.offset, strict=True)
        ]
        return np.asarray(cv2.merge([cv2.convertScaleAbs(display_levels(part)) for part in scene]), dtype=np.uint8)
