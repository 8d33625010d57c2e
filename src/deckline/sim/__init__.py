"""Simulator: renders approaches to a random or given ship, with depth, pose, haze and exact truth."""

from deckline.sim.config import CLEAR, SimConfig
from deckline.sim.opening import frames, open_simulator
from deckline.sim.scene.gl import RendererError
from deckline.sim.sheet import contact_sheet

__all__ = ["CLEAR", "RendererError", "SimConfig", "contact_sheet", "frames", "open_simulator"]
