import numpy as np
import pytest
from sea_scene import frame_of, sea_pair

from deckline.dehaze import OnnxDehazer
from deckline.dehaze.geometry import GeometryDehazer, Solved
from deckline.dehaze.haze_fit import HazeFit
from deckline.dehaze.joining import CLEAR_M, clear_air, joined, kept, mixed
from deckline.evaluation.metrics import psnr_db
from deckline.haze import beta_from_visibility
from deckline.runtime import shipped_weights


def fitted(visibility_m: float, horizon_sea: float = 0.5) -> HazeFit:
    """`horizon_sea`: how bright the water at the horizon is, of the airlight."""
    sea = np.stack([np.full(3, -100.0), np.full(3, 150.0 * horizon_sea - 50.0)])
    return HazeFit(np.full(3, 150.0), beta_from_visibility(visibility_m), 0.0, 0.0, sea)


def solved(level: int, visibility_m: float, known: float) -> Solved:
    haze = fitted(visibility_m)
    return Solved(np.full((40, 64, 3), level, np.uint8), haze, np.full((40, 64), known, np.float32))


def network(level: int) -> np.ndarray:
    return np.full((40, 64, 3), level, np.uint8)


@pytest.mark.parametrize(
    ("visibility_m", "known", "expected"),
    [
        (1000.0, 1.0, 103),  # as many levels apart as halve geometry's share
        (1000.0, 0.0, 100),
        (CLEAR_M[1], 1.0, 110),
        (CLEAR_M[1], 0.0, 100),  # the sky must be twice as clear
        (2 * CLEAR_M[1], 0.0, 110),
        (1e6, 0.5, 110),
    ],
)
def test_in_haze_both_count_and_in_clear_air_geometry(visibility_m: float, known: float, expected: float) -> None:
    result = joined(network(100), solved(110, visibility_m, known))
    assert result.dtype == np.uint8
    np.testing.assert_allclose(result, expected, atol=0.5)


def test_what_geometry_gets_far_wrong_hardly_counts() -> None:
    assert joined(network(100), solved(250, 1000.0, 1.0)).max() <= 102


def test_neither_picture_is_changed() -> None:
    ours, theirs = network(100), solved(110, 1000.0, 1.0)
    joined(ours, theirs)
    assert (ours == 100).all()
    assert (theirs.image_rgb == 110).all()


def test_clear_air_begins_and_ends_where_it_is_said() -> None:
    low, high = CLEAR_M
    assert clear_air(fitted(low), 1.0) == pytest.approx(0, abs=1e-6)
    assert clear_air(fitted(float(np.sqrt(low * high))), 1.0) == pytest.approx(0.5)
    assert clear_air(fitted(high), 1.0) == pytest.approx(1)
    assert clear_air(fitted(high), 2.0) == pytest.approx(0, abs=1e-6)


def test_air_is_not_called_clear_over_water_brighter_than_itself() -> None:
    certain = [clear_air(fitted(30_000.0, horizon_sea), 1.0) for horizon_sea in (0.8, 0.95, 1.1)]
    np.testing.assert_allclose(certain, [1, 0.5, 0])


@pytest.mark.parametrize(("change", "done"), [(5, 0), (6, 0), (7, 7 / 3), (8, 8 * 2 / 3), (9, 9), (60, 60)])
def test_a_small_change_is_not_made(change: int, done: float) -> None:
    image = network(100)
    np.testing.assert_allclose(kept(image, image + np.uint8(change)), 100 + done, atol=0.5)
    np.testing.assert_allclose(kept(image, image - np.uint8(change)), 100 - done, atol=0.5)


def test_mixing_is_exact_and_never_wraps() -> None:
    rng = np.random.default_rng(3)
    first, second = rng.integers(0, 256, (2, 41, 67, 3), dtype=np.uint8)
    first[:5], second[:5] = 0, 255
    share = rng.uniform(0, 1, (41, 67)).astype(np.float32)
    exact = first + share[..., None] * (second.astype(float) - first)
    assert np.abs(mixed(first, second, share) - exact).max() <= 0.51
    np.testing.assert_array_equal(mixed(first, second, np.zeros_like(share)), first)
    np.testing.assert_array_equal(mixed(first, second, np.ones_like(share)), second)


def test_visibility_is_where_two_percent_are_left() -> None:
    fit = solved(0, 1200.0, 1.0).haze
    assert fit.visibility_m == pytest.approx(1200.0, rel=1e-3)
    banked = HazeFit(fit.airlight, 4e-4, 0.0, 4e-4, fit.sea)
    assert banked.visibility_m < 0.5 * 3.912 / 4e-4
    depth = float(banked.optical_depth(np.float32(banked.visibility_m)))
    assert np.exp(-depth) == pytest.approx(0.02, rel=1e-3)


def test_a_clear_sea_is_kept_that_the_network_alone_takes_for_a_hazy_one() -> None:
    """Bright grey water under a sky like it: only the pose tells that it does not fade."""
    _, clear = sea_pair(beta_from_visibility(1200.0))
    image = np.rint(0.35 * clear + 0.65 * np.array([150.0, 165.0, 180.0])).astype(np.uint8)
    frame = frame_of(image)
    assert isinstance(GeometryDehazer().solve(frame), Solved)
    results = [OnnxDehazer(shipped_weights("dehaze"), threads=1, alone=alone).restore(frame) for alone in (True, False)]
    alone, both = (psnr_db(result.image_rgb, image) for result in results)
    assert alone < 28
    assert both > 32
