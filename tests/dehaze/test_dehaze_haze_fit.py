import numpy as np
import pytest
from sea_scene import AIRLIGHT, CAMERA, SEA, SEA_Z_M, sea_pair, world_from_body

from deckline.dehaze.haze_fit import (
    DARK,
    HazeFit,
    NoFit,
    NotFitted,
    fit_haze,
    hidden_sea_certainty,
    sees_beyond_horizon,
)
from deckline.dehaze.sea_view import SeaView, view_sea
from deckline.geometry import camera_mount
from deckline.haze import beta_from_visibility


def view_from(*at: float) -> SeaView:
    """The sea as seen from a place of `world_from_body`."""
    return view_sea(CAMERA, world_from_body(*at) * camera_mount(), SEA_Z_M)


def grazing(view: SeaView) -> np.ndarray:
    """Share (H, W, 1) of the light that water mirrors, by the angle under which it is seen."""
    return (1 - np.clip(view.down[..., None], 0, 1)) ** 5


def through_haze(view: SeaView, clear: np.ndarray, beta_per_m: float) -> np.ndarray:
    """The water of these levels in even haze, below a sky of the airlight."""
    t = np.where(view.down > 0, np.exp(-beta_per_m * view.range_m), 0)[..., None]
    return np.rint(AIRLIGHT + t * (clear - AIRLIGHT)).astype(np.uint8)


VIEW = view_from()


@pytest.mark.parametrize("visibility_m", [500.0, 1200.0, 3000.0])
def test_a_known_haze_is_found(visibility_m):
    beta = beta_from_visibility(visibility_m)
    fit = fit_haze(sea_pair(beta)[0], VIEW)
    assert isinstance(fit, HazeFit)
    assert fit.beta_per_m == pytest.approx(beta, rel=0.08)  # the grid's step is 7.5 %
    assert 0 < fit.beta_sigma_per_m < 0.5 * beta
    assert fit.bank_per_m == 0
    np.testing.assert_allclose(fit.airlight, AIRLIGHT, atol=0.5)
    straight_below = fit.clear_sea(np.ones((1, 1), np.float32))[:, 0, 0]
    np.testing.assert_allclose(straight_below, SEA, atol=12)


def test_air_that_thickens_with_range_is_distinguished_from_even_air():
    fit = fit_haze(sea_pair(1e-3, bank_per_m=1e-3)[0], VIEW)
    assert fit.bank_per_m == pytest.approx(1e-3, rel=0.25)
    assert fit.optical_depth(np.float32(1000.0)) == pytest.approx(2.0, rel=0.2)


def test_clear_air_comes_out_thin_and_foam_and_a_ship_move_nothing():
    assert fit_haze(sea_pair(0.0)[1], VIEW).beta_per_m < beta_from_visibility(20_000.0)
    beta = beta_from_visibility(1000.0)
    image = sea_pair(beta)[0]
    image[100:180, 20:90] = 225  # wake
    image[70:130, 150:200] = 60  # hull
    assert fit_haze(image, VIEW).beta_per_m == pytest.approx(beta, rel=0.15)


def test_optical_depth_is_the_law_and_visibility_is_where_two_percent_are_left():
    fit = HazeFit(AIRLIGHT, 2e-3, 1e-4, 1e-3, np.zeros((2, 3)))
    depth = fit.optical_depth(np.array([0.0, 500.0, np.inf], np.float32))
    np.testing.assert_allclose(depth[:2], [0.0, 1.0 + 0.5**4], rtol=1e-5)
    assert np.exp(-depth[2]) == 0
    assert np.exp(-fit.optical_depth(np.float32(fit.visibility_m))) == pytest.approx(0.02, rel=1e-3)
    even = HazeFit(AIRLIGHT, beta_from_visibility(1200.0), 0.0, 0.0, np.zeros((2, 3)))
    assert even.visibility_m == pytest.approx(1200.0, rel=1e-3)


@pytest.mark.parametrize("mirror", [0.5, 0.7])
def test_thick_haze_over_usual_water_is_fitted_from_high_up(mirror):
    """The nearest water transmits a seventh; how bright the far water is cannot be seen."""
    beta, view = 2e-3, view_from(-8.0, 0.0, -300.0)
    sea = AIRLIGHT * (1 - DARK * (1 - mirror * grazing(view)))
    waves = np.random.default_rng(5).normal(0, 3, (*view.down.shape, 1))
    fit = fit_haze(through_haze(view, sea + waves, beta), view)
    assert fit.beta_per_m == pytest.approx(beta, rel=0.1)
    found = np.moveaxis(fit.clear_sea(view.down), 0, 2)[view.range_m < 1000]
    assert np.abs(found - sea[view.range_m < 1000]).mean() < 12


def cause(image: np.ndarray, view=VIEW) -> NoFit:
    result = fit_haze(image, view)
    assert isinstance(result, NotFitted)
    return result.cause


def test_what_cannot_be_fitted_has_its_cause():
    image = sea_pair(2e-3)[0]
    assert cause(image, view_from(-60.0)) is cause(image, view_from(25.0)) is NoFit.NO_HORIZON  # down, up
    assert cause(image // 10) is NoFit.DARK
    assert cause(np.full_like(image, 150)) is NoFit.NO_CONTRAST
    mist = sea_pair(1.5e-2)[0]
    mist[VIEW.range_m < 260] = 20  # a deck hides all water that is not hidden by the mist
    assert cause(mist) is NoFit.VAGUE
    striped = np.repeat(np.where(np.arange(len(image)) // 9 % 2, 60, 130), image.shape[1])  # fields, say
    land = np.where(VIEW.is_sea[..., None], striped.reshape(*VIEW.is_sea.shape, 1), image).astype(np.uint8)
    assert cause(land) is NoFit.NO_FADING
    sliver = view_from(16.8, 0.0)
    assert sliver.is_sea.any()
    assert cause(image, sliver) is NoFit.LITTLE_SEA


def test_a_deck_just_ahead_hides_the_sea_and_the_sides_are_fitted():
    """A dark deck in the middle three fifths, all the way up to the horizon, in clear air: it does not fade."""
    beta = beta_from_visibility(1500.0)
    image = sea_pair(beta)[0]
    ahead = VIEW.is_sea.copy()
    ahead[:, :64] = ahead[:, -64:] = False
    image[ahead] = np.random.default_rng(6).integers(50, 75, (ahead.sum(), 1))
    fit = fit_haze(image, VIEW)
    assert isinstance(fit, HazeFit)
    assert fit.beta_per_m == pytest.approx(beta, rel=0.15)


@pytest.mark.parametrize(("far", "is_sea"), [(60.0, True), (-60.0, False)])
def test_water_darker_than_black_is_no_sea(far: float, is_sea: bool) -> None:
    """A law through what gets darker than black with range, as a deck may seem to, is refused however well it fits."""
    image = through_haze(VIEW, 60 + (far - 60) * grazing(VIEW), beta_from_visibility(1500.0))
    assert isinstance(fit_haze(image, VIEW), HazeFit) == is_sea


def test_noise_does_not_thin_the_haze():
    beta, sigma = beta_from_visibility(1200.0), 5.0
    image = sea_pair(beta)[0].astype(np.float32)
    noisy = image + np.random.default_rng(7).normal(0, sigma, image.shape).astype(np.float32)
    assert fit_haze(noisy, VIEW, noise_sigma=sigma).beta_per_m == pytest.approx(beta, rel=0.1)
    assert fit_haze(noisy, VIEW).beta_per_m < 0.8 * beta  # what a quantile below the median makes of it


@pytest.mark.parametrize("pitch_deg", [-8.0, -22.0])
def test_haze_that_hides_the_far_sea_is_certain_with_and_without_a_horizon(pitch_deg):
    """From 60 m up; with the camera pitched down by 22 degrees, the farthest water in view is 400 m away."""
    view = view_from(pitch_deg, 0.0)
    assert view.is_sea.all() == (pitch_deg == -22.0)
    clear = SEA + 0.6 * (AIRLIGHT - SEA) * grazing(view)
    for visibility_m, certainty in ((300.0, 1), (20_000.0, 0)):
        image = through_haze(view, clear, beta_from_visibility(visibility_m))
        assert hidden_sea_certainty(image, view) == certainty
    hazy = through_haze(view, clear, 0.013)
    hazy[-20:] = 255  # a deck, say: what is brighter than the farthest sea is not hidden by haze
    assert hidden_sea_certainty(hazy, view) == 0
    hardly_in_view = view_from(25.0)
    assert hidden_sea_certainty(np.full_like(image, 150), hardly_in_view) == 0


def test_a_coast_or_clouds_beyond_the_horizon_are_no_haze():
    hazy, _ = sea_pair(beta_from_visibility(3000.0))
    column = np.arange(CAMERA.width)
    coast_top = -0.012 - 0.006 * np.sin(column / 40)
    coast = hazy.copy()
    coast[(VIEW.down < 0) & (VIEW.down > coast_top)] = AIRLIGHT - 40
    clouds = hazy.astype(float)
    clouds[VIEW.down < 0] += np.broadcast_to(8 * np.sin(column / 9)[:, None], (*hazy.shape[:2], 3))[VIEW.down < 0]
    for image in (coast, np.rint(clouds.clip(0, 255)).astype(np.uint8)):
        found = fit_haze(image, VIEW)
        assert isinstance(found, NotFitted) and found.cause is NoFit.FAR_SEEN


def test_a_near_ship_before_the_horizon_hides_no_haze():
    hazy, _ = sea_pair(beta_from_visibility(1200.0))
    ship = hazy.copy()
    on_ship = (VIEW.down > -0.03) & (VIEW.down < 0.06) & (np.arange(CAMERA.width) % 160 < 64)
    ship[on_ship] = 40
    assert not sees_beyond_horizon(ship, VIEW)


def test_a_sky_that_brightens_slowly_towards_the_horizon_hides_no_haze():
    hazy = sea_pair(beta_from_visibility(1200.0))[0].astype(float)
    hazy[VIEW.down < 0] -= (250 * -VIEW.down[VIEW.down < 0])[:, None]  # 6 levels over the band
    assert isinstance(fit_haze(np.rint(hazy.clip(0, 255)).astype(np.uint8), VIEW), HazeFit)
