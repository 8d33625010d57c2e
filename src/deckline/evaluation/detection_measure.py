"""Detected points against the lines that are in an image: one frame's score."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deckline.evaluation.chain import range_to_ramp_m
from deckline.evaluation.detection_lanes import CuLane, TuSimple, culane, tusimple
from deckline.evaluation.labels import distance_px
from deckline.labels.contrast import line_contrast
from deckline.labels.lines import Line, at_rows, resampled
from deckline.labels.own import Labels
from deckline.labels.truth import SeenLine, seen_line, through_air
from deckline.types import SIDES, Detection, Frame, Segment

SEEN_SHARE = 0.1  # of each line's length that must be in the image and within the visibility for it to count
SEEN_PX = 4.0  # length of each line in the image, at least
RIGHT_PX = 3.0  # a point this near to its line, in an image of 1280 px, is right: the marks' 95th percentile
FULL_WIDTH_PX = 1280
LANE_ROWS = 56  # rows that a line is compared on in TuSimple's score; as many as its own files have
LOST_PX = 1e4  # error of a point that no ray of the lens reaches
CONTRAST_POINTS = 65  # along a line, at which its contrast is taken
DIGITS = 5  # significant digits kept of a point's error and confidence


class Scene(StrEnum):
    """What there is to find in a frame."""

    DECK = "deck"  # both lines
    EMPTY = "empty"  # nothing of either line
    UNRATED = "unrated"  # no clear case: a part in the image, hidden in haze, one line, or seen from ahead


@dataclass(frozen=True, eq=False)
class Expected:
    """What should be found in a frame."""

    scene: Scene
    lines_px: Mapping[str, Line | None]  # by side; the part that can be seen
    range_m: float = float("nan")  # aircraft to the ramp; NaN when unknown
    visibility_m: float = float("nan")  # 2 % contrast; NaN when unknown
    light: float = float("nan")  # share of the ramp's light that comes through the air; NaN when unknown
    contrast: float = float("nan")  # of the fainter line in the image, grey levels; NaN without both


@dataclass(frozen=True)
class DetectionScore:
    """How one frame went. Plain values, so that a score can be a line of JSON."""

    source: str
    index: int  # of the frame in its source
    file: str
    ship: str
    scene: Scene
    range_m: float
    visibility_m: float
    width_px: int  # of the image
    extent_px: float  # diagonal of the box around the true lines; 0 without any
    errors_px: dict[str, list[float]]  # by side: of every detected point, normal to the line; inf where there is none
    confidence: dict[str, list[float]]  # by side: of the same points
    tusimple: TuSimple | None  # of a deck
    culane: CuLane | None
    light: float = float("nan")  # share of the ramp's light that comes through the air
    contrast: float = float("nan")  # of the fainter line in the image, grey levels; NaN without both

    @property
    def found(self) -> int:
        """Lines with points, 0 to 2."""
        return sum(bool(self.errors_px[side]) for side in SIDES)

    @property
    def right_px(self) -> float:
        """Distance up to which a point is right, in this image."""
        return RIGHT_PX * self.width_px / FULL_WIDTH_PX

    @property
    def placed(self) -> bool:
        """Both lines are found, half of each one's points or more within `right_px`."""
        return self.found == 2 and all(float(np.median(self.errors_px[side])) <= self.right_px for side in SIDES)


def expected_from_truth(frame: Frame) -> Expected:
    """What a recording's truth says is in a frame.

    Raises:
        ValueError: a frame without truth, or with true lines and no pose.
    """
    truth = frame.truth
    if truth is None:
        raise ValueError(f"{frame.file} has no truth to compare with: evaluate a recording with a scene.json")
    visibility = float("nan") if truth.visibility_m is None else truth.visibility_m
    if truth.left is None or truth.right is None:
        return Expected(Scene.EMPTY, dict.fromkeys(SIDES), visibility_m=visibility)
    if frame.true_world_from_camera is None:
        raise ValueError(f"{frame.file}: no pose; true lines cannot be brought into the image")
    segments = (truth.left, truth.right)
    seen = [seen_line(frame, segment) for segment in segments]
    lines = {side: None if line is None else line.points_px for side, line in zip(SIDES, seen, strict=True)}
    if all(_counts(line) for line in seen):
        scene = Scene.DECK if _left_is_left(lines) else Scene.UNRATED
    else:
        in_image = any(seen_line(frame, segment, within_visibility=False) is not None for segment in segments)
        scene = Scene.UNRATED if in_image else Scene.EMPTY
    light, contrast = _light(frame, segments), _contrast(frame.image_rgb, lines)
    return Expected(scene, lines, range_to_ramp_m(frame), visibility, light, contrast)


def _light(frame: Frame, segments: tuple[Segment, Segment]) -> float:
    pose = frame.true_world_from_camera
    if pose is None:
        return float("nan")
    return float(through_air(pose.inv().apply(np.stack([line.p0_m for line in segments])), frame).mean())


def _contrast(image_rgb: NDArray[np.uint8], lines_px: Mapping[str, Line | None]) -> float:
    lines = [resampled(line, CONTRAST_POINTS) for line in (lines_px[side] for side in SIDES) if line is not None]
    if len(lines) < len(SIDES):
        return float("nan")
    return min(float(np.median(line_contrast(image_rgb, *pair))) for pair in (lines, lines[::-1]))


def expected_from_labels(labels: Labels, image_rgb: NDArray[np.uint8]) -> Expected:
    """What a person labelled in an image (H, W, 3)."""
    there = sum(labels[side] is not None for side in SIDES)
    return Expected((Scene.EMPTY, Scene.UNRATED, Scene.DECK)[there], labels, contrast=_contrast(image_rgb, labels))


def _counts(line: SeenLine | None) -> bool:
    return line is not None and line.share >= SEEN_SHARE and line.length_px >= SEEN_PX


def _left_is_left(lines: Mapping[str, Line | None]) -> bool:
    left, right = (lines[side] for side in SIDES)
    if left is None or right is None:
        return False
    low, high = max(left[:, 1].min(), right[:, 1].min()), min(left[:, 1].max(), right[:, 1].max())
    if high <= low:
        return float(left[:, 0].mean()) < float(right[:, 0].mean())
    middle = [(low + high) / 2]
    return float(at_rows(left, middle)[0]) < float(at_rows(right, middle)[0])


def score_detection(
    frame: Frame, detection: Detection, expected: Expected, source: str = "", index: int = 0, ship: str = ""
) -> DetectionScore:
    """Compare one frame's detected points with what should be found in it."""
    size = (frame.camera.width, frame.camera.height)
    errors, confidence, predicted = {}, {}, []
    for side in SIDES:
        points, line = getattr(detection, side), expected.lines_px[side]
        far = np.full(len(points), np.inf)
        if len(points) and line is not None:
            far = np.nan_to_num(distance_px(points.points_px, line, frame.camera), nan=LOST_PX)
        errors[side], confidence[side] = _short(far), _short(points.confidence)
        if len(points) >= 2:
            predicted.append(points.points_px[np.argsort(points.points_px[:, 1], kind="stable")])
    true = [line for line in expected.lines_px.values() if line is not None]
    deck = expected.scene is Scene.DECK
    rated = expected.scene is not Scene.UNRATED
    return DetectionScore(
        source,
        index,
        frame.file,
        ship,
        expected.scene,
        expected.range_m,
        expected.visibility_m,
        size[0],
        float(np.linalg.norm(np.ptp(np.concatenate(true), axis=0))) if true else 0.0,
        errors,
        confidence,
        _tusimple(predicted, true, size[0]) if deck else None,
        culane(predicted, true if deck else [], size) if rated else None,
        expected.light,
        expected.contrast,
    )


def _tusimple(predicted: list[Line], true: list[Line], width_px: int) -> TuSimple:
    """On rows evenly spread over those that the true lines have: rows without any line would all count as right."""
    v = np.concatenate([line[:, 1] for line in true])
    rows = np.linspace(v.min(), v.max(), LANE_ROWS)
    return tusimple([at_rows(line, rows) for line in predicted], [at_rows(line, rows) for line in true], rows, width_px)


def _short(values: NDArray[np.float64]) -> list[float]:
    return [float(f"{value:.{DIGITS}g}") for value in values]


def score_to_mapping(score: DetectionScore) -> dict[str, Any]:
    """Plain JSON values; infinity and NaN as text."""
    values: dict[str, Any] = asdict(score)
    values["errors_px"] = {side: [_text(value) for value in errors] for side, errors in score.errors_px.items()}
    return {name: _text(value) for name, value in values.items()}


def score_from_mapping(values: Mapping[str, Any]) -> DetectionScore:
    """The score that `score_to_mapping` wrote."""
    lanes = values["tusimple"], values["culane"]
    return DetectionScore(
        **{
            **values,
            "scene": Scene(values["scene"]),
            "range_m": float(values["range_m"]),
            "visibility_m": float(values["visibility_m"]),
            "light": float(values.get("light", "nan")),
            "contrast": float(values.get("contrast", "nan")),
            "errors_px": {side: [float(value) for value in errors] for side, errors in values["errors_px"].items()},
            "tusimple": None if lanes[0] is None else TuSimple(**lanes[0]),
            "culane": None if lanes[1] is None else CuLane(**lanes[1]),
        }
    )


def _text(value: Any) -> Any:
    return str(value) if isinstance(value, float) and not np.isfinite(value) else value
