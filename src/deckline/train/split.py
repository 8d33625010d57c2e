"""Which frames of recordings are for training and which are held out; the same for every network."""

from collections.abc import Mapping, Sized
from pathlib import Path


def split_views(
    recordings: list[Path], sources: Mapping[Path, Sized], held_out: float, train: bool
) -> list[tuple[Path, int]]:
    """Frames as (recording, index).

    Args:
        recordings: one given twice counts twice in training, once among the held-out.
        sources: the opened recordings.
        held_out: share of every recording, at its end, that training does not see.
        train: the training part; False gives the held-out part.

    Raises:
        ValueError: no frames are left.
    """
    items: list[tuple[Path, int]] = []
    for path in recordings if train else sources:
        count = len(sources[path])
        first_held_out = count - round(held_out * count)
        part = range(first_held_out) if train else range(first_held_out, count)
        items += [(path, index) for index in part]
    if not items:
        raise ValueError(f"no {'training' if train else 'held-out'} views in {[str(path) for path in recordings]}")
    return items
