"""Items grouped by bands of a value, and shares of them."""

from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from typing import TypeVar

import numpy as np

RANGE_M = (0.0, 100.0, 200.0, 400.0, 800.0, np.inf)  # to the ramp, of unrelated frames

T = TypeVar("T")


def by_band(
    items: Iterable[T], value: Callable[[T], float], edges: Sequence[float], unit: str = "m", short: bool = False
) -> dict[str, list[T]]:
    """Items by the band that their value lies in; bands without items are left out.

    Args:
        items: what to group.
        value: of an item; one that is NaN is in no band.
        edges: of the bands, in order. Infinity is in the last band when that is open.
        unit: of the value.
        short: name bands `0-100 m` instead of `0 to 100 m`.
    """
    valued = [(value(item), item) for item in items]
    groups = {}
    for low, high in pairwise(edges):
        members = [item for number, item in valued if low <= number < high or number == high == np.inf]
        if members and short:
            groups[f"{low:g}+ {unit}" if np.isinf(high) else f"{low:g}-{high:g} {unit}"] = members
        elif members:
            groups[f"{low:g} {unit} and more" if np.isinf(high) else f"{low:g} to {high:g} {unit}"] = members
    return groups


def share(items: Sequence[T], test: Callable[[T], bool]) -> float:
    """Part of the items, 0..1, that pass a test."""
    return sum(map(test, items)) / len(items)
