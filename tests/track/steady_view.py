"""An aircraft that waits 100 m before the ramp of a runway along x, and lines as a depth camera gives them."""

import re

import numpy as np
from scipy.spatial.transform import RigidTransform

from deckline.config import Deck, RunConfig
from deckline.geometry import Camera
from deckline.track import Tracker
from deckline.track.filter import FilterState, update
from deckline.track.states import States, initial_state
from deckline.types import (
    DepthMode,
    Diagnostic,
    Frame,
    LineVisibility,
    Reason,
    RunwayEstimate,
    RunwayLine,
    Track,
)

CALM = RunConfig(deck=Deck(sea_state=0.0))
KNOWN = RunConfig(deck=Deck(sea_state=0.0, width_m=15.0))
SWELL = RunConfig(deck=Deck(sea_state=4.0, width_m=15.0))
NOTHING = RunwayEstimate(
    LineVisibility.NONE, DepthMode.NONE, {}, {}, diagnostics=(Diagnostic(Reason.NO_LINE, "no line"),)
)

CAMERA = Camera(4, 3, 2.0, 2.0, 1.5, 1.0)
OFFSET_M, TURN_RAD, HEIGHT_M = 0.05, 0.002, 0.1  # 1-sigma of one frame's line


def view(time_s: float, aside_m: float = 0.0) -> Frame:
    pose = RigidTransform.from_translation([-100.0, aside_m, -35.0])
    grain = np.random.default_rng(round(time_s * 1e3)).integers(0, 256, (3, 4, 3), np.uint8)
    return Frame(f"{time_s:.2f}.png", time_s, grain, CAMERA, world_from_body=pose)


def seen(rng, z_m=-20.0, spacing_m=15.0, aside_m=0.0, mode=DepthMode.FINE, noise=1.0) -> RunwayEstimate:
    """Both lines 50 m past the ramp, with noise."""
    # An attitude 0.1 degrees wrong is in what localization states, though it does not differ from frame to frame.
    attitude = np.deg2rad(0.1) * np.array([15.0, 0.0, 150.0])
    covariance = np.diag(np.hypot([OFFSET_M, TURN_RAD, HEIGHT_M], attitude)) ** 2
    height, lines = z_m + noise * rng.normal(0, HEIGHT_M), {}
    for side, sign in (("left", -0.5), ("right", 0.5)):
        y = aside_m + sign * spacing_m + noise * rng.normal(0, OFFSET_M)
        point = np.array([50.0, y, height])
        lines[side] = RunwayLine(point, noise * rng.normal(0, TURN_RAD), 4 * covariance, covariance)
    return RunwayEstimate(LineVisibility.BOTH, mode, {}, lines)


def advance(tracker, frame, estimate, flags=()) -> Track:
    """The track after one more frame."""
    return tracker.update(tracker.predict(frame), estimate, flags)


def advance_all(tracker, shown) -> list[Track]:
    """The tracks after each of several frames with their estimates; what else comes with them is left out."""
    return [advance(tracker, frame, estimate) for frame, estimate, *_ in shown]


def settled(config=CALM, seed=4) -> tuple[Tracker, np.random.Generator]:
    """A tracker that has followed the runway for 2 s, and what draws the lines of the next frames."""
    rng, tracker = np.random.default_rng(seed), Tracker(config)
    advance_all(tracker, ((view(index / 10), seen(rng)) for index in range(20)))
    return tracker, rng


def start(config) -> FilterState:
    """The state of a track that has seen nothing but where a line is."""
    return initial_state(0.0, RunwayLine(np.zeros(3), 0.0, np.eye(3)), None, config)


def measured(state: FilterState, index: int, value: float, sigma: float) -> FilterState:
    """The state after one of its numbers is measured."""
    return update(state, np.array([value]), np.eye(1, States.SIZE, index), np.array([[sigma**2]]))


def numbers_in(message) -> list[float]:
    """All numbers of a text for people."""
    return [float(number) for number in re.findall(r"[-+]?\d+(?:\.\d+)?", message)]


def reasons(diagnostics) -> list[Reason]:
    return [diagnostic.reason for diagnostic in diagnostics]
