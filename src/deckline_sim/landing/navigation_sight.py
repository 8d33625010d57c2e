"""Sight by navigation alone: the aircraft's own pose and the ship's steady pose by datalink, without deck motion."""

from math import sqrt

import numpy as np
from scipy.spatial.transform import RigidTransform
from scipy.stats import norm

from deckline.types import Guidance, Protection, Status
from deckline_sim.camera.measure import CALIBRATION, drift, measure_pose
from deckline_sim.landing.config import LandingConfig
from deckline_sim.landing.deviations import Deviations, deviations, stated_guidance
from deckline_sim.landing.sight import Moment
from deckline_sim.landing.surroundings import surroundings

RATE_SIGMA_M_S = 0.05  # 1-sigma of velocities, of both units together; our choice
DECK_SIGMA_M_S2 = 1.0  # 1-sigma of the deck's acceleration, of which navigation knows nothing; our choice
SHIP = 62  # random stream


class NavigationSight:
    """Subtracts two navigation solutions; a `Sight` whose guidance is always `ok`.

    The ship's unit has the grade of the aircraft's. Its attitude error, seen from the touchdown point, is far below its
    position error and left out. Velocities err by less than a path needs and are exact.

    Args:
        config: what the landing is flown in.
        seed: of the landing.
    """

    def __init__(self, config: LandingConfig, seed: int) -> None:
        self.surroundings = surroundings(config, seed)
        run = self.surroundings.run
        deck = np.random.default_rng([seed, CALIBRATION]).standard_normal()
        self.deck_error_m = run.sensors.deck_z_m * float(deck)
        self.sigma = self._sigma()
        self.protection = self._protection()

    def see(self, moment: Moment) -> Guidance:
        """Guidance from the difference of both poses at the moment."""
        scene, sensors = self.surroundings, self.surroundings.run.sensors
        body = measure_pose(moment.world_from_body, moment.time_s, scene.navigation, scene.seed)
        ship = sensors.position_drift_m * drift(moment.time_s, sensors.drift_s, [scene.seed, SHIP])
        ship[2] = self.deck_error_m
        apart = RigidTransform.from_components(body.translation - ship, body.rotation)
        found = deviations(scene, moment.time_s, apart, moment.velocity_m_s, steady=True)
        return stated_guidance(moment.time_s, found, self.sigma, Status.OK, self.protection, scene.run.approach)

    def _sigma(self) -> Deviations:
        sensors, motion = self.surroundings.run.sensors, self.surroundings.run.deck.motion
        across_m = sqrt(2.0) * sensors.position_m
        height_m = float(np.hypot(np.hypot(sensors.position_m, sensors.deck_z_m), motion.heave_m))
        rate = RATE_SIGMA_M_S
        return Deviations(across_m, height_m, sensors.attitude_rad, across_m, rate, rate, rate, DECK_SIGMA_M_S2)

    def _protection(self) -> Protection:
        sigma, risk = self.sigma, self.surroundings.run.integrity.risk
        factor = float(norm.isf(risk / 2))
        return Protection(
            factor * sigma.lateral_m,
            factor * sigma.height_m,
            factor * sigma.heading_rad,
            factor * sigma.distance_m,
            risk,
        )
