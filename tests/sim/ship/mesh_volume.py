"""What meshes enclose."""

import numpy as np


def volume(mesh):
    """Volume, m^3, of a closed mesh (N, 9); negative where its normals point inwards."""
    a, b, c = (mesh[k::3, :3].astype(np.float64) - mesh[:, :3].mean(axis=0, dtype=np.float64) for k in range(3))
    return float(np.sum(a * np.cross(b, c)) / 6)
