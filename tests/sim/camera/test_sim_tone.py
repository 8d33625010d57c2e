import numpy as np
import pytest

from deckline.sim.camera.tone import DISPLAY_GAMMA, STEPS, WHITE, level_of, light_of_levels, table

CURVES = [("gamma", 1.0, 0.0, 0.0), ("srgb", 0.8, 0.4, 0.05), ("filmic", 1.2, -0.5, 0.0)]


def test_known_values():
    assert level_of(np.array(0.25), CURVES[0]) == pytest.approx(0.25 ** (1 / DISPLAY_GAMMA))
    # IEC 61966-2-1: 18 % grey is level 0.4614 of sRGB, 0.1 % lies in the linear toe.
    np.testing.assert_allclose(level_of(np.array([0.18, 0.001]), ("srgb", 1.0, 0.0, 0.0)), [0.4614, 0.01292], atol=1e-4)
    filmic = level_of(np.array([1.0, 7.3]), ("filmic", 1.0, 0.0, 0.0))
    np.testing.assert_allclose(filmic, [(2.54 / 3.16) ** (1 / DISPLAY_GAMMA), 1.0], atol=1e-3)


@pytest.mark.parametrize("curve", CURVES)
def test_curves_rise_from_black_to_white_and_can_be_undone(curve):
    light = np.linspace(0.0, WHITE[curve[0]], 5000)
    level = level_of(light, curve)
    assert np.all(np.diff(level) > 0)
    np.testing.assert_allclose([level[0], level[-1]], [curve[3], 1.0], atol=1e-4)
    shown = np.arange(int(np.ceil(255 * curve[3])), 256)
    np.testing.assert_allclose(255 * level_of(light_of_levels(curve)[shown], curve), shown, atol=0.02)


@pytest.mark.parametrize("curve", CURVES)
def test_the_table_is_the_rounded_curve(curve):
    index = np.arange(0, STEPS, 37)
    exact = 255 * level_of(WHITE[curve[0]] * (index / (STEPS - 1)) ** 2, curve)
    np.testing.assert_array_equal(table(curve)[index], np.rint(exact))
