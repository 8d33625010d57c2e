"""A developed picture back to light, from what a frame records of its sensor."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deckline_sim.camera.sensor import LUMINANCE, Sensor, light_of_levels


def recorded_sensor(values: Mapping[str, Any]) -> Sensor:
    """The sensor of a frame's conditions, as JSON holds them."""
    return Sensor(**{**values, "gain": tuple(values["gain"])})


def undo_sensor(rgb: NDArray[np.uint8], sensor: Sensor) -> NDArray[np.float32]:
    """Linear light (H, W, 3) that `develop` shows as an image, but for clipping, vignetting and blur."""
    light = light_of_levels(sensor.curve)[rgb]
    grey = (light @ LUMINANCE)[..., None]
    light = grey + (light - grey) / np.float32(sensor.saturation)
    return np.asarray(light / np.asarray(sensor.gain, np.float32), np.float32)
