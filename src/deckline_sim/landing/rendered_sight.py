"""Sight by rendered pictures: the simulator's camera, the detector and the whole chain."""

from dataclasses import replace

import numpy as np

from deckline.flight import Flight, FrameResult
from deckline.types import Frame, Guidance
from deckline_sim.camera.measure import miscalibrate
from deckline_sim.config import MotionConfig, SimConfig, WeatherConfig
from deckline_sim.flight.viewpoints import Viewpoint
from deckline_sim.landing.config import LandingConfig
from deckline_sim.landing.sight import Moment
from deckline_sim.landing.surroundings import Surroundings, datalink_prior, frame_name, surroundings, without_position
from deckline_sim.simulate import ShipSimulator


class RenderedSight:
    """Renders each moment's view and flies its picture; a `Sight`.

    Args:
        config: what the landing is flown in.
        seed: of the landing.

    Raises:
        RendererError: no OpenGL through EGL on this machine.
    """

    def __init__(self, config: LandingConfig, seed: int) -> None:
        self.surroundings = surroundings(config, seed)
        self.flight = Flight.from_config(self.surroundings.run)
        self.simulator = open_simulator(sim_config(self.surroundings), self.surroundings)
        self.result: FrameResult | None = None

    def close(self) -> None:
        """Release the OpenGL context and end the flight's threads."""
        self.flight.close()
        self.simulator.close()

    def see(self, moment: Moment) -> Guidance:
        """The guidance of the moment's picture; `result` then holds all that the chain found in it."""
        frame = self.take(moment)
        self.result = self.flight(frame, prior=datalink_prior(self.surroundings, self.flight, frame))
        return self.result.guidance

    def take(self, moment: Moment) -> Frame:
        """The moment's picture, with the pose and the deck height that the aircraft is told."""
        scene = self.surroundings
        view = Viewpoint(
            moment.world_from_body,
            scene.camera,
            moment.time_s,
            scene.body_from_camera,
            np.asarray(moment.velocity_m_s),
            np.asarray(moment.angular_rate_rad_s),
        )
        frame = self.simulator.flown_frame(view, frame_name(scene.seed, moment.time_s))
        frame = miscalibrate(replace(frame, depth_m=None), scene.run.sensors, scene.seed)
        return without_position(frame) if scene.config.guidance == "picture" else frame


def open_simulator(config: SimConfig, scene: Surroundings) -> ShipSimulator:
    """A simulator whose ship moves as that of a landing.

    Args:
        config: of `sim_config`.
        scene: of the landing.

    Raises:
        RendererError: no OpenGL through EGL on this machine.
    """
    simulator = ShipSimulator(config)
    simulator.load(0)
    simulator.motion = scene.deck.motion
    return simulator


def sim_config(scene: Surroundings) -> SimConfig:
    """What the simulator is asked for: ship, weather, air, camera and navigation unit of a landing."""
    config = scene.config
    return SimConfig(
        preset=config.ship,
        visibility_m=(config.visibility_m, config.visibility_m),
        seed=scene.seed,
        width=config.camera.width,
        height=config.camera.height,
        fov_deg=config.camera.fov_deg,
        keep_clear=False,
        weather=WeatherConfig(config.time_of_day, sea_state=round(config.sea_state), wind_m_s=config.wind_m_s),
        motion=MotionConfig(config.sea_state, config.ship_speed_m_s),
        navigation=scene.navigation,
    )
