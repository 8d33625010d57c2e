"""What the tracker assumes: refused where it cannot be, and told of the sea."""

import numpy as np
import pytest

from deckline.track import ErrorConfig, IntegrityConfig, MotionConfig, TrackConfig
from deckline.track.config import deck_sway


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: TrackConfig(runway_width_m=0.0), "runway_width_m must be positive, got 0.0"),
        (lambda: TrackConfig(gate=0.0), "the gate must be positive"),
        (lambda: TrackConfig(noise_correlation_s=-1.0), "must be positive"),
        (lambda: TrackConfig().at_sea_state(7.0), "sea_state must lie between 0 and 6, got 7.0"),
        (lambda: MotionConfig(drift_m_s=-1.0), "motion must not be negative"),
        (lambda: ErrorConfig(position_m=0.0), "errors and time constants must be positive"),
        (lambda: IntegrityConfig(risk=1.0), "risk must lie between 0 and 1"),
    ],
)
def test_what_cannot_be_is_refused(build, message):
    with pytest.raises(ValueError, match=message):
        build()


def test_a_sea_state_is_that_of_single_sines_between_ramp_and_touchdown():
    sway = deck_sway(5.0)
    times = np.linspace(0.0, 396.0, 39600, endpoint=False)  # whole periods of roll, pitch and heave
    pitch = np.deg2rad(0.82) * np.sin(2 * np.pi * times / 12.0)
    rise = (166.0 + 96.0) / 2 * pitch + 1.09 * np.sin(2 * np.pi * times / 18.0)
    assert np.std(rise) == pytest.approx(sway.rise_m, rel=0.01)
    assert np.std(pitch) == pytest.approx(sway.tilt_rad, rel=1e-6)
    assert np.std(np.deg2rad(0.98) * np.sin(2 * np.pi * times / 22.0)) == pytest.approx(sway.bank_rad, rel=1e-6)


def test_a_rough_sea_makes_the_reported_deck_height_worth_less_but_not_the_height_at_rest():
    calm, rough = TrackConfig().at_sea_state(0.0), TrackConfig().at_sea_state(5.0)
    assert calm.errors.deck_z_m == pytest.approx(TrackConfig().errors.deck_z_m)
    assert rough.errors.deck_z_m == pytest.approx(np.hypot(0.1, deck_sway(5.0).rise_m), rel=1e-3)
    assert rough.rest_z_m == pytest.approx(calm.rest_z_m)
    assert rough.at_sea_state(0.0).errors.deck_z_m == pytest.approx(calm.errors.deck_z_m)
    assert rough.motion.tilt_rad > 10 * calm.motion.tilt_rad
