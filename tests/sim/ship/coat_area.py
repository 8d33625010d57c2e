"""Area of a coat of paint."""

import numpy as np


def area_and_middle(coat):
    """Area of a coat without overlaps, and its centroid (2,)."""
    corners = coat[:, :2].astype(float).reshape(-1, 3, 2)
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    areas = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2
    return areas.sum(), areas @ corners.mean(axis=1) / areas.sum()
