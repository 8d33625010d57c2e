"""Side by side: a hazy picture, what every dehazer makes of it, and the clear one; a column for each visibility."""

import math
from collections.abc import Mapping, Sequence

import cv2
import numpy as np

from deckline.dehaze import NOT_DEHAZED, Dehazer, restore
from deckline.evaluation.dehazing_pairs import Pair, PairSource
from deckline.evaluation.dehazing_score import ImageScore, restoration
from deckline.report.draw import Image, draw_tag

TILE_PX = 360  # width
TEXT_PX = 15
INK, PAPER = (255, 255, 255), (20, 26, 34)


def sheet(
    sources: Sequence[PairSource],
    dehazers: Mapping[str, Dehazer],
    scores: Sequence[ImageScore],
    visibilities_m: Sequence[float],
) -> Image:
    """One picture: a column for each visibility, from hazy over every dehazer down to clear; tagged with the PSNR.

    Args:
        sources: where the pairs are.
        dehazers: by the names to show.
        scores: of these pairs; says which of them is nearest in visibility. Those with both lines in view go first.
        visibilities_m: one column each.

    Raises:
        ValueError: no visibilities, or no pair that says its own.
    """
    if not visibilities_m:
        raise ValueError("a sheet needs at least one visibility")
    by_name = {source.name: source for source in sources}
    chosen = [nearest(scores, visibility) for visibility in visibilities_m]
    columns = [_column(by_name[name].load(key), dehazers) for name, key in chosen]
    height = max(len(column) for column in columns)
    return np.concatenate([np.pad(column, ((0, height - len(column)), (0, 0), (0, 0))) for column in columns], axis=1)


def nearest(scores: Sequence[ImageScore], visibility_m: float) -> tuple[str, str]:
    """The image whose visibility is nearest by ratio, among those with both lines in view if there are any."""
    known = {score.image: score for score in scores if score.visibility_m > 0 and math.isfinite(score.visibility_m)}
    if not known:
        raise ValueError("no pair says its visibility, so none can be chosen for the sheet")
    candidates = [score for score in known.values() if score.found is not None] or list(known.values())
    return min(candidates, key=lambda score: abs(math.log(score.visibility_m / visibility_m))).image


def _column(pair: Pair, dehazers: Mapping[str, Dehazer]) -> Image:
    pictures = {f"hazy, {pair.visibility_m:.0f} m": pair.frame.image_rgb}
    pictures |= {
        name: restore(dehazer, pair.frame).image_rgb for name, dehazer in dehazers.items() if name != NOT_DEHAZED
    }
    tiles = []
    for name, image in pictures.items():
        psnr_db = restoration(image, pair.clear_rgb, None)["psnr_db"]
        tiles.append(_tile(image, f"{name}: {psnr_db:.1f} dB"))
    return np.concatenate([*tiles, _tile(pair.clear_rgb, "clear")])


def _tile(image: Image, words: str) -> Image:
    height = round(TILE_PX * image.shape[0] / image.shape[1])
    tile = np.ascontiguousarray(cv2.resize(image, (TILE_PX, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)
    draw_tag(tile, words, (6, 6), TEXT_PX, PAPER, INK)
    return tile
