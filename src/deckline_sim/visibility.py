"""A scene's visibility, or the range it is drawn from: metres at which 2 % of a contrast is left."""

from math import inf, isinf

import numpy as np


def draw_visibility(limits_m: tuple[float, float], rng: np.random.Generator) -> float:
    """Uniform between two visibilities, m; infinite if the larger one is."""
    low, high = limits_m
    return high if low == high or isinf(high) else float(rng.uniform(low, high))


def parse_visibility(text: str) -> tuple[float, float]:
    """'clear' -> (inf, inf); '800' -> (800, 800); '300..3000' -> (300, 3000). Metres at 2 % contrast.

    Raises:
        ValueError: anything else, or a range that is empty or not positive.
    """
    if text == "clear":
        return inf, inf
    low, _, high = text.partition("..")
    try:
        bounds = float(low), float(high or low)
    except ValueError:
        raise ValueError(f"visibility must be metres, LOW..HIGH or clear, got {text!r}") from None
    if not 0 < bounds[0] <= bounds[1]:
        raise ValueError(f"visibility needs 0 < LOW <= HIGH, got {text!r}")
    return bounds


def visibility_text(visibility_m: tuple[float, float]) -> str:
    """What `parse_visibility` reads back."""
    if isinf(visibility_m[0]):
        return "clear"
    low, high = (str(value).removesuffix(".0") for value in visibility_m)
    return low if low == high else f"{low}..{high}"
