"""Simulator: renders approaches to a random or given ship, with depth, pose, haze and exact truth."""

from deckline.sim.config import CLEAR, SimConfig
from deckline.sim.scene.gl import RendererError
from deckline.sim.simulate import frames, open_simulator

__all__ = ["CLEAR", "RendererError", "SimConfig", "frames", "open_simulator"]
