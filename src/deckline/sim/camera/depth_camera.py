"""What a depth camera measures of the true depth: finite range, noise, drop-outs, steps, half precision."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

HALF_FAR_M = 65504.0  # largest half-precision number, AirSim's "nothing seen"
EDGE_RATIO = 1.05  # of neighbouring depths, from which there is an edge between them


@dataclass(frozen=True)
class DepthConfig:
    """The depth camera. The defaults measure exactly, up to a range.

    A stereo camera with a base of 0.3 m, a focal length of 700 px and matches good to 0.1 px has
    noise_per_m 0.1 / (700 * 0.3) = 0.0005.

    Args:
        range_m: nothing is seen farther away than this, along the optical axis.
        noise_m: 1-sigma that does not depend on depth.
        noise_per_m: 1-sigma that grows with the depth's square: sigma = noise_m + noise_per_m * z^2.
        dropout: share of the pixels that see nothing, at random.
        edge_dropout: share of the pixels at the edges of things that see nothing.
        step_m: depths come in multiples of this; 0: they do not.
        half_precision: depths pass through 16-bit floating point numbers, as AirSim's can.

    Raises:
        ValueError: a number out of its range.
    """

    range_m: float = 200.0
    noise_m: float = 0.0
    noise_per_m: float = 0.0
    dropout: float = 0.0
    edge_dropout: float = 0.0
    step_m: float = 0.0
    half_precision: bool = False

    def __post_init__(self) -> None:
        if not self.range_m > 0:
            raise ValueError(f"range_m must be positive, got {self.range_m}")
        for name in ("noise_m", "noise_per_m", "step_m"):
            if not 0 <= getattr(self, name) < np.inf:
                raise ValueError(f"{name} must not be negative, got {getattr(self, name)}")
        for name in ("dropout", "edge_dropout"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} must lie between 0 and 1, got {getattr(self, name)}")


def measure_depth(depth_m: NDArray[np.float32], config: DepthConfig, rng: np.random.Generator) -> NDArray[np.float32]:
    """Measured depth (H, W), m along the optical axis, NaN where nothing is seen, of the true one."""
    with np.errstate(invalid="ignore"):
        measured = np.where(depth_m <= config.range_m, depth_m, np.float32(np.nan))
    if config.edge_dropout > 0:
        measured[at_edges(depth_m) & (rng.random(depth_m.shape, np.float32) < config.edge_dropout)] = np.nan
    if config.dropout > 0:
        measured[rng.random(depth_m.shape, np.float32) < config.dropout] = np.nan
    if config.noise_m > 0 or config.noise_per_m > 0:
        sigma = np.float32(config.noise_m) + np.float32(config.noise_per_m) * measured**2
        measured = measured + sigma * rng.standard_normal(depth_m.shape, np.float32)
    if config.step_m > 0:
        measured = np.rint(measured / np.float32(config.step_m)) * np.float32(config.step_m)
    if config.half_precision:
        measured = np.minimum(measured, np.float32(HALF_FAR_M)).astype(np.float16).astype(np.float32)
        measured[measured >= HALF_FAR_M] = np.nan
    with np.errstate(invalid="ignore"):
        return np.where(measured > 0, measured, np.float32(np.nan)).astype(np.float32)


def at_edges(depth_m: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Which pixels (H, W) have a neighbour above, below, left or right on another thing or in the sky."""
    near = 1.0 / np.where(np.isnan(depth_m), np.float32(np.inf), depth_m)
    edges = np.zeros(depth_m.shape, dtype=bool)
    for axis in (0, 1):
        a, b = np.moveaxis(near, axis, 0)[:-1], np.moveaxis(near, axis, 0)[1:]
        apart = np.maximum(a, b) > np.float32(EDGE_RATIO) * np.minimum(a, b)
        swapped = np.moveaxis(edges, axis, 0)
        swapped[:-1] |= apart
        swapped[1:] |= apart
    return edges
