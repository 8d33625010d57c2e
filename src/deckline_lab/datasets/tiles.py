"""The eight overlapping squares that the paper cuts every picture into.

Source: Li et al. 2024, section 4.1.1.
"""

import numpy as np

COLUMNS, ROWS = 4, 2


def tile_corners(width: int, height: int, tile_px: int) -> list[tuple[int, int]]:
    """Left and top of every tile, px, row by row: spread evenly, the outer ones at the image's borders.

    Raises:
        ValueError: the image is smaller than a tile.
    """
    if not 1 <= tile_px <= min(width, height):
        raise ValueError(f"a tile of {tile_px} px does not fit into an image of {width}x{height} px")
    lefts = np.rint(np.linspace(0, width - tile_px, COLUMNS)).astype(int).tolist()
    tops = np.rint(np.linspace(0, height - tile_px, ROWS)).astype(int).tolist()
    return [(left, top) for top in tops for left in lefts]
