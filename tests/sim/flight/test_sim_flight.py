import numpy as np
import pytest

from deckline.sim.flight.flight import FlightConfig, closing_speed, draw_flight, gust, offset_left, wander

ALONG = np.array([0.6, 0.8])
STILL_AIR = np.zeros(2)


def test_in_still_air_a_still_deck_is_closed_at_the_speed_of_flight():
    assert closing_speed(ALONG, STILL_AIR, STILL_AIR, 65.0) == pytest.approx(65.0)


def test_a_deck_that_sails_away_and_a_headwind_are_subtracted():
    assert closing_speed(ALONG, 12.0 * ALONG, STILL_AIR, 65.0) == pytest.approx(53.0)
    assert closing_speed(ALONG, 12.0 * ALONG, -8.0 * ALONG, 65.0) == pytest.approx(45.0)


def test_a_crosswind_costs_what_pythagoras_says():
    across = np.array([-0.8, 0.6])
    assert closing_speed(ALONG, STILL_AIR, 25.0 * across, 65.0) == pytest.approx(60.0)


def test_too_much_wind_is_named():
    with pytest.raises(ValueError, match=r"an aircraft of 20 m/s cannot approach a deck that moves at 30.0 m/s"):
        closing_speed(ALONG, STILL_AIR, -30.0 * ALONG, 20.0)
    with pytest.raises(ValueError, match="cannot approach"):
        closing_speed(ALONG, STILL_AIR, 30.0 * np.array([-0.8, 0.6]), 20.0)


def test_gusts_have_the_sigma_asked_for_and_move_the_aircraft_as_its_pilot_lets_them():
    times = np.linspace(0.0, 1000.0, 5001)
    both = np.array([gust(t, 1.5, 65.0, np.random.default_rng(2)) for t in times])
    velocity, moved = both.T
    assert np.std(velocity) == pytest.approx(1.5, rel=0.05)
    rate = np.gradient(moved, times)
    np.testing.assert_allclose(rate[1:-1], (velocity - 0.5 * moved)[1:-1], atol=0.2)
    assert np.std(moved) < 1.5 / 0.5


def test_gusts_follow_drydens_spectrum():
    times = np.arange(0.0, 8000.0, 0.8)
    velocity = np.array([gust(t, 1.0, 65.0, np.random.default_rng(5))[0] for t in times])
    power = np.abs(np.fft.rfft(velocity)) ** 2
    frequency = np.fft.rfftfreq(len(times), 0.8)

    def share(low, high):
        return power[(frequency >= low) & (frequency < high)].sum()

    def dryden(low, high):  # integral of 1 / (1 + (L w / V)^2)
        return np.diff(np.arctan(200.0 / 65.0 * 2 * np.pi * np.array([low, high])))[0]

    edges = np.geomspace(0.02, 0.6, 25)
    low, high = edges[12], edges[24]
    assert share(low, high) / share(0.01, 0.7) == pytest.approx(dryden(low, high) / dryden(0.02, 0.6), rel=0.05)


def test_offsets_close_smoothly():
    phases = np.linspace(0.0, 1.0, 1001)
    left = np.array([offset_left(phase) for phase in phases])
    assert left[0] == 1.0
    np.testing.assert_allclose(left[phases >= 0.7], 0.0, atol=1e-12)
    assert (np.diff(left) <= 1e-12).all()
    assert np.abs(np.diff(left, 2)).max() * 1000**2 < 5.78 / 0.7**2  # a quintic's largest curvature
    assert left[350] == pytest.approx(0.5)


def test_wander_is_a_smooth_function_about_one_in_size():
    values = [[wander(t, (0.02, 0.1), np.random.default_rng(seed)) for t in np.arange(0, 200, 5.0)]
              for seed in range(60)]  # fmt: skip
    assert np.std(values) == pytest.approx(1.0, abs=0.15)


def test_named_presets_fly_in_still_air_unless_told():
    rng = np.random.default_rng
    still = draw_flight(FlightConfig(), False, rng(1))
    assert (still.headwind_m_s, still.crosswind_m_s, still.lateral_offset_m, still.turbulence_m_s) == (0, 0, 0, 0)
    told = draw_flight(FlightConfig(crosswind_m_s=-3.0), True, rng(1))
    assert told.crosswind_m_s == -3.0
    assert told.turbulence_m_s > 0
    assert told.headwind_m_s == draw_flight(FlightConfig(), True, rng(1)).headwind_m_s


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"glideslope_deg": 0.0}, "glideslope_deg must lie between 1 and 15, got 0.0"),
        ({"speed_m_s": 500.0}, "speed_m_s must lie between 10 and 150, got 500.0"),
        ({"crosswind_m_s": 41.0}, "crosswind_m_s must lie between -40 and 40, got 41.0"),
        ({"lateral_offset_m": float("nan")}, "lateral_offset_m must lie between -1000 and 1000, got nan"),
        ({"turbulence_m_s": -1.0}, "turbulence_m_s must lie between 0 and 10, got -1.0"),
        ({"pointing": "down"}, r"pointing must be one of \('ahead', 'runway'\), got 'down'"),
    ],
)
def test_wrong_numbers_are_named(wrong, message):
    with pytest.raises(ValueError, match=message):
        FlightConfig(**wrong)
