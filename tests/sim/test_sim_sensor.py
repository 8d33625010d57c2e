import numpy as np

from deckline.sim.sensor import DISPLAY_GAMMA, Sensor, add_noise, develop, random_sensor


def light_of(levels):
    """Linear light that a plain camera shows as these 8-bit levels."""
    return (np.asarray(levels, dtype=np.float32) / 255) ** DISPLAY_GAMMA


GREY = light_of(np.full((32, 48, 3), 100))


def test_develop_follows_gain_and_gamma():
    out = develop(GREY, Sensor(gain=(1.0, 2.0, 0.5), gamma=2.0))
    expected = [255 * (100 / 255) ** 2, 255 * (200 / 255) ** 2, 255 * (50 / 255) ** 2]
    np.testing.assert_array_equal(out[3, 4], np.rint(expected))


def test_default_sensor_changes_nothing():
    rng = np.random.default_rng(0)
    image = rng.integers(0, 256, (20, 30, 3), dtype=np.uint8)
    np.testing.assert_array_equal(develop(light_of(image), Sensor()), image)
    np.testing.assert_array_equal(add_noise(image, Sensor(), rng), image)


def test_blur_keeps_the_mean_and_spreads_an_edge():
    image = np.zeros((32, 64, 3), dtype=np.uint8)
    image[:, 32:] = 200
    out = develop(light_of(image), Sensor(blur_px=1.0)).astype(float)
    assert abs(out.mean() - image.mean()) < 1.0
    assert 10 < out[16, 31, 0] < 100 < out[16, 32, 0] < 190


def test_noise_has_its_sigma():
    noisy = add_noise(np.full((200, 200, 3), 128, np.uint8), Sensor(noise=4.0), np.random.default_rng(1))
    assert abs(noisy.astype(float).std() - 4.0) < 0.1


def test_stronger_sensors_stray_more():
    def spread(strength):
        gains = [random_sensor(strength, 0.8, np.random.default_rng(k)).gain[0] for k in range(80)]
        return np.std(np.log(gains))

    assert spread(0.0) == 0.0
    assert spread(1.0) > 3 * spread(0.2) > 0
