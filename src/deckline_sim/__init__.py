"""Simulator: renders approaches to a random or given ship, with depth, pose, haze and exact truth."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from deckline_sim.config import CLEAR, SimConfig
    from deckline_sim.scene.gl import RendererError
    from deckline_sim.simulate import frames, open_simulator

__all__ = ["CLEAR", "RendererError", "SimConfig", "frames", "open_simulator"]

_MODULES = {
    "deckline_sim.config": ("CLEAR", "SimConfig"),
    "deckline_sim.scene.gl": ("RendererError",),
    "deckline_sim.simulate": ("frames", "open_simulator"),
}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used (PEP 562): most modules need no renderer."""
    for module, names in _MODULES.items():
        if name in names:
            return getattr(import_module(module), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
