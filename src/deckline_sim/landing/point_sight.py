"""Sight by points: detections drawn from a model, flown through localization, tracking and guidance."""

from dataclasses import replace

import numpy as np

from deckline.config import RunConfig
from deckline.flight import FrameResult
from deckline.types import Detection, Frame, Guidance
from deckline_sim.landing.config import LandingConfig
from deckline_sim.landing.detection_model import DetectionModel, read_detection_model
from deckline_sim.landing.modelled_detector import ModelledDetector, point_flight
from deckline_sim.landing.sight import Moment
from deckline_sim.landing.surroundings import empty_picture, measured_frame, surroundings
from deckline_sim.ship.layout import truth_segments

DETECTIONS, RANSAC = 64, 65  # random streams


class PointSight:
    """Draws each moment's detection and flies it; a `Sight`.

    Args:
        config: what the landing is flown in.
        seed: of the landing.
        model: of the detector; None: the shipped one.
        run: what the aircraft is told in place of the truth; None: what is so.
    """

    def __init__(
        self, config: LandingConfig, seed: int, model: DetectionModel | None = None, run: RunConfig | None = None
    ) -> None:
        self.surroundings = surroundings(config, seed)
        told = run or self.surroundings.run
        told = replace(told, tracking=replace(told.tracking, horizon_s=0.0, paint_s=0.0))  # the picture is black
        self.flight = point_flight(told)
        is_dark = config.time_of_day != "day"
        rng = np.random.default_rng([seed, DETECTIONS])
        self.detector = ModelledDetector(model or read_detection_model(), is_dark, config.visibility_m, rng)
        self.rng = np.random.default_rng([seed, RANSAC])
        self.image_rgb = empty_picture(self.surroundings.camera)
        self.result: FrameResult | None = None

    def close(self) -> None:
        """End the flight's threads."""
        self.flight.close()

    def see(self, moment: Moment) -> Guidance:
        """The guidance of a drawn detection; `result` then holds all that the chain made of it."""
        return self.answer(*self.draw(moment))

    def draw(self, moment: Moment) -> tuple[Frame, Detection]:
        """The moment's frame, and the points that a detector might find in its picture."""
        scene = self.surroundings
        layout = scene.deck.moved_layout(moment.time_s)
        camera_pose = moment.world_from_body * scene.body_from_camera
        detection = self.detector.detect(moment.time_s, truth_segments(layout), camera_pose, scene.camera)
        return measured_frame(scene, moment, self.image_rgb), detection

    def answer(self, frame: Frame, detection: Detection) -> Guidance:
        """The guidance of the flight's next frame."""
        self.result = self.flight(frame, detection=detection, rng=self.rng)
        return self.result.guidance
