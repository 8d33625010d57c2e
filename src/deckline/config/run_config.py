"""All of a flight's configuration in one, and what follows from several of its parts."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from deckline.config.deck import CALM_HEAVE_M, Approach, Deck, RunwaySurvey
from deckline.config.sensors import Navigation, Sensors
from deckline.config.stages import CPU, Engine, Integrity, Localization, Models, PicturePose, Tracking


@dataclass(frozen=True)
class FrameNoise:
    """1-sigma of one frame's measurements. All but `depth_fraction` is common to all of its points."""

    attitude_rad: float  # about each axis
    position_m: float  # along each axis
    deck_z_m: float  # of the reported deck height, the deck's motion included
    slope_rad: float  # of the deck, along and across the runway
    focal_fraction: float  # share
    depth_fraction: float  # of each depth sample alone, share
    depth_scale: float  # of all depth samples together, share


@dataclass(frozen=True)
class RunConfig:
    """Everything that decides what a flight answers.

    Args:
        sensors: how good navigation, calibration and depth are.
        deck: what is known of deck and lines.
        approach: the wanted approach.
        survey: where the runway is, if that is known.
        models: dehazer and detector.
        engine: what computes their networks.
        localization: its depth mode.
        tracking: the filter over frames.
        integrity: flags and protection levels.
        navigation: how poses are placed on pictures.
        picture: of an aircraft without a pose.
        seed: of RANSAC's draws; every frame has its own generator.
    """

    sensors: Sensors = field(default_factory=Sensors)
    deck: Deck = field(default_factory=Deck)
    approach: Approach = field(default_factory=Approach)
    survey: RunwaySurvey = field(default_factory=RunwaySurvey)
    models: Models = field(default_factory=Models)
    engine: Engine = CPU
    localization: Localization = field(default_factory=Localization)
    tracking: Tracking = field(default_factory=Tracking)
    integrity: Integrity = field(default_factory=Integrity)
    navigation: Navigation = field(default_factory=Navigation)
    picture: PicturePose = field(default_factory=PicturePose)
    seed: int = 0

    @cached_property
    def noise(self) -> FrameNoise:
        """What one frame's measurements err by."""
        sensors = self.sensors
        return FrameNoise(
            attitude_rad=sensors.attitude_rad,
            position_m=sensors.position_m,
            deck_z_m=self.deck_height_sigma_m,
            slope_rad=self.deck.slope_rad,
            focal_fraction=sensors.focal_fraction,
            depth_fraction=sensors.depth_fraction,
            depth_scale=sensors.depth_scale,
        )

    @cached_property
    def frame_deck(self) -> Deck:
        """The deck as one frame's fit knows it: a tracker tests a stated width against the lines, fitted without it."""
        return replace(self.deck, width_m=None) if self.tracking.enabled else self.deck

    @cached_property
    def deck_rest_sigma_m(self) -> float:
        """1-sigma of the reported deck height against the deck at rest."""
        reported = self.sensors.deck_z_m
        return float(np.sqrt(reported**2 - CALM_HEAVE_M**2)) if reported > CALM_HEAVE_M else reported

    @cached_property
    def deck_height_sigma_m(self) -> float:
        """1-sigma of the reported deck height against the deck as one frame sees it, its motion included."""
        return float(np.hypot(self.deck_rest_sigma_m, self.deck.motion.heave_m))
