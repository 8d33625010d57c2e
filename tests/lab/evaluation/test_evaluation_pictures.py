"""The pictures of evaluations."""

from collections.abc import Sequence

import numpy as np
import pytest

from deckline.dehaze.base import IdentityDehazer
from deckline.geometry import Camera
from deckline.types import Frame
from deckline_lab.evaluation.dehazing_pairs import Pair, PairSource
from deckline_lab.evaluation.dehazing_score import ImageScore
from deckline_lab.evaluation.pictures import TILE_PX, nearest, sheet

VISIBILITIES = {"a": 300.0, "b": 900.0, "c": 2000.0}


def score(key: str, lines: bool = True) -> ImageScore:
    return ImageScore("s", key, "none", VISIBILITIES.get(key, float("nan")), {}, found=True if lines else None)


def load(key: str) -> Pair:
    level = {"a": 40, "b": 120, "c": 200}[key]
    image = np.full((90, 160, 3), level, np.uint8)
    frame = Frame(key, 0.0, image, Camera.from_fov(160, 90, 1.0))
    return Pair(frame, image + np.uint8(20), None, VISIBILITIES[key], None)


def middles(picture: np.ndarray, columns: int, rows: int) -> list[list[int]]:
    height = len(picture) // rows
    return [[int(picture[r * height + height // 2, c * TILE_PX + 300, 0]) for c in range(columns)] for r in range(rows)]


def test_the_nearest_visibility_by_ratio_is_taken_and_views_of_the_lines_first() -> None:
    scores = [score("a"), score("b"), score("c"), score("unknown")]
    assert nearest(scores, 500.0) == ("s", "a")
    assert nearest(scores, 560.0) == ("s", "b")
    assert nearest([score("a"), score("b", lines=False)], 900.0) == ("s", "a")
    with pytest.raises(ValueError, match="visibility"):
        nearest([score("unknown")], 900.0)


@pytest.mark.parametrize("visibilities", [(2000.0,), (300.0, 2000.0)])
def test_columns_go_from_hazy_to_clear(visibilities: Sequence[float]) -> None:
    source = PairSource("s", tuple(VISIBILITIES), load)
    dehazers = {"none": IdentityDehazer(), "same": IdentityDehazer()}
    picture = sheet([source], dehazers, [score(key) for key in VISIBILITIES], visibilities)
    levels = [{300.0: 40, 2000.0: 200}[visibility] for visibility in visibilities]
    assert picture.shape[1] == TILE_PX * len(visibilities)
    assert middles(picture, len(visibilities), 3) == [levels, levels, [level + 20 for level in levels]]
    with pytest.raises(ValueError, match="visibility"):
        sheet([source], dehazers, [score("a")], ())
