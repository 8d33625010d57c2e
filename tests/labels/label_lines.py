"""Labelled images for the formats' round trips."""

import numpy as np
from hypothesis import strategies as st

from deckline.labels import LabelledImage

SIZE = (640, 360)


def distance_px(points, line) -> np.ndarray:
    """Distance of points (N, 2) to the nearest spot of a polyline (M, 2), by projection onto its segments."""
    start, along = line[:-1], np.diff(line, axis=0)
    share = ((points[:, None] - start) * along).sum(axis=2) / np.maximum((along**2).sum(axis=1), 1e-30)
    nearest = start + np.clip(share, 0, 1)[..., None] * along
    return np.linalg.norm(points[:, None] - nearest, axis=2).min(axis=1)


@st.composite
def labelled_images(draw) -> LabelledImage:
    """Left of u = 300 and right of 340: straight or bent lines, at least 20 rows high, or none."""
    lines = []
    for low_u, high_u in ((0.0, 300.0), (340.0, 639.0)):
        if draw(st.booleans()):
            v = sorted(draw(st.lists(st.floats(0.0, 359.0), min_size=2, max_size=6, unique=True)), reverse=True)
            v[0], v[-1] = max(v[0], 200.0), min(v[-1], 180.0)
            u = draw(st.lists(st.floats(low_u, high_u), min_size=len(v), max_size=len(v)))
            lines.append(np.stack([u, v], axis=1))
        else:
            lines.append(None)
    return LabelledImage("images/a.png", *lines, SIZE)
