"""Both lines of a level deck as a camera 20 m above it sees them, and what is detected of them."""

from dataclasses import replace

import numpy as np

from approach_scene import STILL
from deckline.dehaze import DehazeResult
from deckline.flight import FrameResult
from deckline.geometry import Camera, attitude, pose
from deckline.guide import guidance
from deckline.localize import localize
from deckline.types import Detection, Frame, LinePoints, Segment, Truth
from deckline_lab.evaluation.detection_score import DetectionScore
from deckline_lab.evaluation.detection_truth import SceneKind
from deckline_lab.evaluation.lane_scores import CuLane, TuSimple

LEFT = Segment(np.array([0.0, -10.0, 0.0]), np.array([200.0, -10.0, 0.0]))
RIGHT = Segment(np.array([0.0, 10.0, 0.0]), np.array([200.0, 10.0, 0.0]))
CAMERA = Camera.from_fov(640, 360, np.pi / 2)
GREY = np.full((360, 640, 3), 128, np.uint8)


def frame_at(
    x_m: float = -100.0, yaw_rad: float = 0.0, camera: Camera = CAMERA, deck_z_m: float | None = 0.0, **truth
) -> Frame:
    """A frame `-x_m` before the ramp; `truth` replaces what is known of it."""
    at = pose([x_m, 0.0, -20.0], attitude(0.0, 0.0, yaw_rad).as_quat(scalar_first=True))
    known = Truth(**({"left": LEFT, "right": RIGHT, "visibility_m": 800.0} | truth))
    return Frame("a.png", 0.0, GREY, camera, world_from_body=at, deck_z_m=deck_z_m, truth=known)


def points(pixels, confidence: float = 1.0, sigma_px: float = 0.3) -> LinePoints:
    pixels = np.asarray(pixels, dtype=float).reshape(-1, 2)
    return LinePoints(pixels, np.full(len(pixels), confidence), np.full(len(pixels), sigma_px))


def pixels_of(frame: Frame, segment: Segment, shift_m: float = 0.0) -> np.ndarray:
    """Pixels (30, 2) of a line, moved sideways in the world."""
    steps = np.linspace(0.05, 0.95, 30)[:, None]
    world = segment.p0_m + steps * (segment.p1_m - segment.p0_m) + [0.0, shift_m, 0.0]
    return frame.camera.project(frame.world_from_camera.inv().apply(world))


def result_of(frame: Frame, left_px, right_px) -> FrameResult:
    detection = Detection(points(left_px), points(right_px))
    estimate = localize(frame, detection, STILL, np.random.default_rng(0))
    steered = guidance(frame, estimate, None, STILL.approach)
    dehazed = DehazeResult(frame.image_rgb.copy())
    return FrameResult(frame, detection, estimate, steered, {"detect": 0.5}, dehazed=dehazed)


def deck(left=(1.0,), right=(1.0,), confidence=0.9, **changes) -> DetectionScore:
    """The score of a frame with both lines in view, by the errors of its points, px."""
    errors = {"left": list(left), "right": list(right)}
    sure = {side: [confidence] * len(values) for side, values in errors.items()}
    lanes = TuSimple(0.9, 0.0, 0.0), CuLane(2, 0, 0)
    where = ("data", 0, "a.png", "paper", SceneKind.DECK, 150.0, 800.0, 1280, 100.0)
    return replace(DetectionScore(*where, errors, sure, *lanes, light=np.nan, contrast=np.nan), **changes)
