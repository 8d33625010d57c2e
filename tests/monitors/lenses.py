"""Pictures through a lens, for monitors."""

from dataclasses import replace

import cv2
import numpy as np

from deckline.geometry import Camera
from deckline.types import Frame

LENSES = {
    "barrel": {"distortion": (-0.12, 0.02, 0.001, -0.001, 0.0)},
    "pincushion": {"distortion": (0.08, 0.01, 0.0, 0.0, 0.0)},
    "fisheye": {"distortion": (-0.02, 0.004, 0.0, 0.0), "fisheye": True},
}.values()


def through_lens(frame: Frame, lens: dict) -> Frame:
    """A frame of a pinhole camera as one with this lens and the same focal length takes it."""
    camera: Camera = replace(frame.camera, **lens)
    v, u = np.mgrid[: camera.height, : camera.width]
    ideal = (camera.rays(np.column_stack([u.ravel(), v.ravel()])) @ camera.matrix.T)[:, :2]
    columns, rows = ideal.T.reshape(2, *u.shape).astype(np.float32)
    image = cv2.remap(frame.image_rgb, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return replace(frame, image_rgb=image, camera=camera)
