import numpy as np
import pytest

from deckline.sim.mesh import box, disc, frustum, join, rectangle


def test_box_encloses_its_volume_with_outward_normals():
    mesh = box(3.0, -2.0, 0.0, (4.0, 2.0, 5.0), 0.7, (1.0, 1.0, 1.0))
    a, b, c = (mesh[k::3, :3].astype(float) for k in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    # Divergence theorem over walls and lid; the missing floor lies in z = 0 and adds nothing.
    volume = np.sum(area * np.sum((a - [3.0, -2.0, 0.0]) * mesh[::3, 3:6], axis=1)) / 3
    assert volume == pytest.approx(40.0, rel=1e-5)
    assert mesh[:, 2].min() == -5.0  # up is negative z


def test_rectangle_turns_from_x_towards_y():
    np.testing.assert_allclose(np.ptp(rectangle(0, 0, 10, 2, np.pi / 2), axis=0), [2, 10], atol=1e-12)


def test_disc_lies_on_its_circle():
    np.testing.assert_allclose(np.linalg.norm(disc(1.0, 2.0, 3.0) - [1.0, 2.0], axis=1), 3.0)


def test_frustum_names_unequal_polygons():
    with pytest.raises(ValueError, match=r"equal length, got \(4, 2\), \(10, 2\)"):
        frustum(rectangle(0, 0, 1, 1), 0.0, disc(0, 0, 1.0), -1.0, (1, 1, 1))


def test_nothing_joined_is_empty():
    assert join([]).shape == (0, 9)
