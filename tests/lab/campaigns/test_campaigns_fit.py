"""Fits give the parameters back that drew their data; looks survive their file."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from deckline.types import DepthMode, Guidance, Status
from deckline_lab.campaigns.compare import error_table, status_table
from deckline_lab.campaigns.fit_detection import FlightLooks, both_below, fit_detection, fit_presence, read_flight
from deckline_lab.campaigns.fit_guidance import Looks, fit_guidance, fit_transitions
from deckline_lab.campaigns.looks import approach_moments, look_record, looks_json, read_looks
from deckline_sim.flight.viewpoints import ship_pose
from deckline_sim.landing.config import LandingCamera, LandingConfig
from deckline_sim.landing.detection_model import DetectionModel, read_detection_model
from deckline_sim.landing.guidance_model import DEPTHS, GRADES, QUANTITIES, SCORES, STATUSES
from deckline_sim.landing.guidance_sight import GuidanceSight
from deckline_sim.landing.modelled_detector import ModelledDetector, latent_mean
from deckline_sim.landing.navigation_sight import NavigationSight
from deckline_sim.landing.surroundings import surroundings
from deckline_sim.ship.layout import truth_segments

CONFIG = LandingConfig(start_m=400.0, visibility_m=900.0, camera=LandingCamera(rate_hz=5.0), sea_state=0.0)


def drawn_flight(model: DetectionModel, seed: int) -> FlightLooks:
    """One approach whose detections a model draws."""
    scene, looks = surroundings(CONFIG, seed), []
    detector = ModelledDetector(model, False, CONFIG.visibility_m, np.random.default_rng(seed))
    nothing = Guidance(0.0, Status.NOT_SEEN, DepthMode.NONE)
    for moment in approach_moments(scene):
        lines = truth_segments(
            scene.deck.layout.at_pose(ship_pose(scene.deck.layout, scene.deck.motion, moment.time_s))
        )
        pose = moment.world_from_body * scene.body_from_camera
        detection = detector.detect(moment.time_s, lines, pose, scene.camera)
        looks.append(look_record(scene, moment, nothing, detection))
    return read_flight(seed, scene, looks)


def test_the_fit_gives_the_errors_back_that_drew_its_lines() -> None:
    shipped = read_detection_model()
    model = replace(shipped, errors=replace(shipped.errors, slow_share=0.0))  # every look tells anew
    found = fit_detection([drawn_flight(model, seed) for seed in range(3)], 5.0)
    at = slice(1, 3)  # distances with many looks
    np.testing.assert_allclose(found.errors.log_sigma[at], model.errors.log_sigma[at], atol=0.4)
    np.testing.assert_allclose(found.errors.offset[at], model.errors.offset[at], rtol=0.25)
    np.testing.assert_allclose(found.errors.slope[at], model.errors.slope[at], rtol=0.25)
    np.testing.assert_allclose(found.errors.white[at], model.errors.white[at], rtol=0.15)
    assert found.false_lines.per_s == 0.0


def test_presence_gives_its_threshold_back() -> None:
    rng, model = np.random.default_rng(3), read_detection_model().presence
    true = replace(model, intercept=9.0, per_visibility=-9.0, per_size=0.0, dusk=0.0, one_line=0.5)
    flights = []
    for _ in range(20):
        depth, width_px = np.linspace(1.5, 0.5, 60), np.full(60, 30.0)
        latent = np.asarray(latent_mean(true, depth, width_px, False)) + rng.standard_normal(60)
        lines = np.where(latent > 0, 2, np.where(latent > -0.5, 1, 0))
        flights.append(FlightLooks(np.arange(60) / 5.0, depth, 1000 * depth, width_px, lines, [], False))
    found = fit_presence(flights)
    threshold = (found.intercept + found.per_size * np.log(1.5)) / -found.per_visibility
    assert threshold == pytest.approx(1.0, abs=0.03)
    assert found.one_line == pytest.approx(0.5, rel=0.3)
    assert found.flight_share == 0.0


def test_pairs_have_the_chance_of_the_normal_distribution() -> None:
    h, k, rho = np.array([0.3, -1.2, 0.0]), np.array([-0.7, 0.4, 1.0]), np.array([0.5, -0.3, 0.8])
    cases = zip(h, k, rho, strict=True)
    exact = [multivariate_normal.cdf([a, b], cov=[[1.0, r], [r, 1.0]]) for a, b, r in cases]
    np.testing.assert_allclose(both_below(h, k, rho), exact, atol=1e-6)


def guidance_looks(rng: np.random.Generator) -> Looks:
    """Looks of every condition whose errors are normal with 1-sigma 0.5 and new in every look."""
    count, flights = 400, 6
    size = count * flights
    condition = np.array([(g, s) for g in range(len(GRADES)) for s in range(2)])
    ranges = np.tile(np.linspace(1200.0, 0.0, count), flights)
    status = np.full(size, STATUSES.index(Status.OK))
    errors = 0.5 * rng.standard_normal((size, len(QUANTITIES)))
    return Looks(
        np.repeat(np.arange(flights), count),
        np.tile(np.arange(count) / 10.0, flights),
        ranges,
        ranges / 1000.0,
        np.repeat(condition, count, axis=0),
        status,
        errors,
        np.full((size, len(QUANTITIES)), 0.5),
        np.full((size, 4), 3.0),
    )


def test_guidance_fit_has_the_quantiles_and_levels_of_its_looks() -> None:
    model = fit_guidance(guidance_looks(np.random.default_rng(3)), 10.0)
    np.testing.assert_allclose(model.errors.mean(axis=(0, 1, 2, 3, 4))[1:-1], 0.5 * np.array(SCORES)[1:-1], atol=0.06)
    np.testing.assert_allclose(model.levels, 3.0)
    np.testing.assert_allclose(model.mixing, np.eye(len(QUANTITIES)), atol=0.15)
    assert model.level_spread == pytest.approx(0.0, abs=1e-9)
    assert (model.correlation_s < 0.2).all()


def test_guidance_fit_refuses_a_condition_without_looks() -> None:
    looks = guidance_looks(np.random.default_rng(3))
    with pytest.raises(ValueError, match=r"tactical.*0"):
        fit_guidance(replace(looks, condition=np.where(looks.condition == 2, 0, looks.condition)), 10.0)


def test_transitions_are_the_shares_of_what_follows() -> None:
    looks = guidance_looks(np.random.default_rng(3))
    chances = np.diff(fit_transitions(looks), axis=-1, prepend=0.0)
    ok = STATUSES.index(Status.OK)
    np.testing.assert_allclose(chances.sum(axis=-1), 1.0)
    assert chances[..., ok, ok] == pytest.approx(1.0)
    lost = replace(
        looks, status=np.where((looks.flight < 2) & (looks.depth > 1.0), STATUSES.index(Status.NOT_SEEN), ok)
    )
    chances = np.diff(fit_transitions(lost), axis=-1, prepend=0.0)
    far, near = (int(np.searchsorted(DEPTHS, depth, "right")) - 1 for depth in (1.1, 0.4))
    unseen = STATUSES.index(Status.NOT_SEEN)
    assert chances[0, far, unseen, unseen] > 0.95  # of the first grade's two flights
    assert chances[0, near, unseen, ok] > 0.95  # as whatever is seen there


def test_looks_survive_their_file(tmp_path: Path) -> None:
    scene = surroundings(CONFIG, 3)
    moment, sight = approach_moments(scene)[5], NavigationSight(CONFIG, 3)
    looks = [look_record(scene, moment, sight.see(moment), None)]
    (tmp_path / "one.json").write_bytes(looks_json(scene, looks))
    again, read = read_looks(tmp_path / "one.json")
    assert again.config == CONFIG and again.seed == 3
    assert read == looks


def test_tables_of_equal_flights_agree() -> None:
    scene = surroundings(CONFIG, 3)
    sight = GuidanceSight(CONFIG, 3)
    flight = scene, [look_record(scene, moment, sight.see(moment), None) for moment in approach_moments(scene)]
    errors = error_table([flight] * 4, [flight] * 4, ("one", "same"), ("lateral",))
    assert errors.rows and all(row[-2:] == ("0.00", "1.000") for row in errors.rows)
    statuses = status_table([flight], [flight], ("one", "same"))
    assert all(row[1:4] == row[4:7] for row in statuses.rows)
