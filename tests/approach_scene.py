"""A short approach to a runway along world x, and a chain that sees its lines exactly."""

import numpy as np
from scipy.spatial.transform import RigidTransform

from deckline.config import Deck, RunConfig
from deckline.flight import FrameResult
from deckline.geometry import Camera, attitude
from deckline.guide import guidance
from deckline.localize import localize
from deckline.recording import FrameError, Recording
from deckline.types import Detection, Frame, LinePoints, Segment, Truth

CAMERA = Camera.from_fov(320, 180, np.deg2rad(60))
LEFT = Segment(np.array([0.0, -8.0, -20.0]), np.array([200.0, -8.0, -20.0]))
RIGHT = Segment(np.array([0.0, 8.0, -20.0]), np.array([200.0, 8.0, -20.0]))
STILL = RunConfig(deck=Deck(sea_state=0.0, slope_deg=0.0))  # a deck that lies still and level
LATERAL_M, HEIGHT_M = 3.0, 15.0


def frame(index: int = 0, range_m: float = 120.0, pose: bool = True, runway: bool = True) -> Frame:
    """The aircraft `range_m` before the ramp, 3 m right of the centre line, 15 m above deck, nose 0.02 rad right."""
    position = [-range_m, LATERAL_M, -20.0 - HEIGHT_M]
    truth = Truth(LEFT, RIGHT, visibility_m=np.inf) if runway else Truth()
    return Frame(
        f"frame_{index:03d}.png",
        0.25 * index,
        np.full((CAMERA.height, CAMERA.width, 3), 120 + index, dtype=np.uint8),
        CAMERA,
        world_from_body=RigidTransform.from_components(position, attitude(0.0, -0.06, 0.02)) if pose else None,
        deck_z_m=-20.0,
        truth=truth if pose else None,
    )


def points(at: Frame, line: Segment, count: int = 20) -> LinePoints:
    along = line.p0_m + np.linspace(0.0, 1.0, count)[:, None] * (line.p1_m - line.p0_m)
    view = at if at.world_from_body is not None else frame()
    pixels = view.camera.project(view.world_from_camera.inv().apply(along))
    return LinePoints(pixels, np.linspace(1.0, 0.5, count), np.full(count, 0.5))


class Halved:
    """A dehazer that darkens."""

    name = "halved"

    def __call__(self, image_rgb: np.ndarray) -> np.ndarray:
        return image_rgb // 2


class ExactChain:
    """A chain that detects the lines exactly; localization and guidance are the real ones."""

    config, dehazer = STILL, Halved()

    def __call__(self, at: Frame, sides: tuple[str, ...] = ("left", "right")) -> FrameResult:
        """The result of a frame that shows the named sides."""
        lines = {"left": LEFT, "right": RIGHT}
        found = {side: points(at, lines[side]) if side in sides else LinePoints.empty() for side in lines}
        detection = Detection(found["left"], found["right"])
        estimate = localize(at, detection, STILL, np.random.default_rng(0))
        seconds = {"detect": 0.04, "localize": 0.002, "guide": 0.0001}
        return FrameResult(at, detection, estimate, guidance(at, estimate, None, STILL.approach), seconds)


chain = ExactChain()


class Approach(Recording):
    """`count` frames ever nearer; those in `bad` cannot be read."""

    name = "approach"

    def __init__(self, count: int, bad: tuple[int, ...] = ()) -> None:
        self.count = count
        self.bad = bad

    def __len__(self) -> int:
        return self.count

    def times(self) -> np.ndarray:
        return np.array([frame(index, 150.0 - 2 * index).time_s for index in range(self.count)])

    def load(self, index: int) -> Frame:
        if index in self.bad:
            raise FrameError(f"frame_{index:03d}.png", "cut short")
        return frame(index, 150.0 - 2 * index)
