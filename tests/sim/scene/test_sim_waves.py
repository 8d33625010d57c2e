import numpy as np
import pytest

from deckline_sim.scene.waves import (
    peak_length_m,
    phase_speed_m_s,
    wave_tile,
    waves_from,
    whitecap_cover,
    wind_from_height,
)

TILE = (wave_tile(256).astype(float) / 127.5 - 1.0) * 4.0


def test_published_seas():
    assert wind_from_height(1.875) == pytest.approx(9.36, abs=0.05)
    assert peak_length_m(10.0) == pytest.approx(83.3, abs=0.5)
    assert phase_speed_m_s(100.0) == pytest.approx(12.5, abs=0.05)
    assert whitecap_cover(10.0) == pytest.approx(0.00987, rel=0.01)
    assert whitecap_cover(1000.0) == 1.0


@pytest.mark.parametrize("wind_m_s", [6.0, 10.0, 15.0])
def test_all_slopes_together_are_cox_and_munks(wind_m_s):
    waves = waves_from(0.21 * wind_m_s**2 / 9.81, wind_m_s, 9.0)
    total = waves.wave_slope**2 + waves.ripple_slope**2 + waves.roughness**2
    assert total == pytest.approx(0.003 + 0.00512 * wind_m_s, rel=1e-6)


def test_a_tile_has_unit_slopes_and_height_and_evenly_ranked_foam():
    along, across, height, foam = np.moveaxis(TILE, -1, 0)
    assert along.var() + across.var() == pytest.approx(1.0, rel=0.02)
    assert along.var() > 1.5 * across.var()
    assert height.std() == pytest.approx(1.0, rel=0.02)
    for share in (0.01, 0.1, 0.5):
        assert np.mean(foam > 4.0 * (1.0 - 2.0 * share)) == pytest.approx(share, abs=0.004)


def test_slopes_are_the_heights_own():
    along, across, height, _ = np.moveaxis(TILE, -1, 0)
    for axis, slope in ((1, along), (0, across)):
        rise = np.roll(height, -1, axis) - np.roll(height, 1, axis)
        assert np.corrcoef(rise.ravel(), slope.ravel())[0, 1] > 0.9


def test_the_tiles_longest_waves_are_at_the_spectrums_peak():
    power = np.abs(np.fft.fft2(TILE[..., 2])) ** 2
    number = np.abs(np.fft.fftfreq(256) * 256)
    radius = np.hypot(*np.meshgrid(number, number))
    share = [power[(radius >= k) & (radius < k + 1)].sum() for k in range(1, 40)]
    assert 6 <= int(np.argmax(share)) + 1 <= 10


def test_a_tile_has_no_seam():
    step = np.abs(np.diff(TILE, axis=1)).mean()
    assert np.abs(TILE[:, 0] - TILE[:, -1]).mean() < 1.3 * step
    assert np.abs(TILE[0] - TILE[-1]).mean() < 1.3 * np.abs(np.diff(TILE, axis=0)).mean()
