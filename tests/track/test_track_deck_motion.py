"""A deck in sea state 5: followed without lag, and smoother than measured."""

import pickle

import numpy as np
from steady_view import HEIGHT_M, seen, view

from deckline.track import TrackConfig, Tracker

RATE_HZ = 10.0


def deck_z(time_s):
    """SPEC section 7, sea state 5, at the ramp: pitch 0.82 degrees 166 m aft of the axis, heave 1.09 m."""
    pitching = 166.0 * np.sin(np.deg2rad(0.82)) * np.sin(2 * np.pi * time_s / 12.0)
    return -20.0 + pitching + 1.09 * np.sin(2 * np.pi * time_s / 18.0 + 1.0)


def test_a_pitching_deck_is_followed_within_a_fifth_of_a_second_and_smoothed():
    rng, tracker = np.random.default_rng(1), Tracker(TrackConfig(runway_width_m=15.0).at_sea_state(5.0))
    times = np.arange(0.0, 40.0, 1 / RATE_HZ)
    found, rates, flags = [], [], 0
    for time_s in times:
        track = tracker.update(view(time_s), seen(rng, deck_z(time_s)))
        found.append(track.lines["centre"].height_m)
        rates.append(track.height_rate_m_s.value if track.height_rate_m_s else np.nan)
        flags += bool(track.flags)
    late = times > 3.0
    shifts = np.arange(-0.6, 0.61, 0.02)
    misses = [np.std(np.array(found)[late] - deck_z(times[late] - shift)) for shift in shifts]
    assert abs(shifts[int(np.argmin(misses))]) <= 0.2
    assert np.std(np.array(found)[late] - deck_z(times[late])) < HEIGHT_M
    true_rate = (deck_z(times + 0.05) - deck_z(times - 0.05)) / 0.1
    assert np.nanstd(np.array(rates)[late] - true_rate[late]) < 0.45  # neighbouring heights differ by 1.4 m/s of noise
    assert flags == 0


def test_memory_does_not_grow_with_the_flight():
    rng, tracker = np.random.default_rng(2), Tracker()
    sizes = []
    for index in range(240):
        tracker.update(view(index / RATE_HZ), seen(rng))
        if index in (40, 239):
            sizes.append(len(pickle.dumps(vars(tracker))))
    assert abs(sizes[1] - sizes[0]) < 50  # digits of a frame's name, no more
