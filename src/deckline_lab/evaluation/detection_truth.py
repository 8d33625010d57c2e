"""What should be found in a frame, from its truth or its labels; and runway priors with drawn errors."""

import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.truth import range_to_ramp_m
from deckline.types import SIDES, Frame, RunwayPrior, Segment
from deckline_lab.labels.lines import Labels, Line, interpolate_rows, resample
from deckline_sim.visible_line import VisibleLine, compute_transmission, find_visible_line, measure_contrast

SEEN_SHARE = 0.1  # of each line's length that must be in the image and within the visibility for it to count
SEEN_PX = 4.0  # length of each line in the image, at least
CONTRAST_POINTS = 65  # along a line, at which its contrast is taken

AZIMUTH_SIGMA_RAD = np.deg2rad(2.0)  # of a drawn prior
FALSE_RANGE_M = (300.0, 2000.0)  # to the false runway of a frame without one
FALSE_WIDTH_M, FALSE_LENGTH_M = 24.0, 240.0  # of such a runway
FALSE_HEADING_RAD = np.deg2rad(10.0)  # 1-sigma of its direction about the line of sight
FALSE_BELOW_M = 50.0  # of it below the camera, where the frame knows no deck

Array = NDArray[np.float64]


class SceneKind(StrEnum):
    """What there is to find in a frame."""

    DECK = "deck"  # both lines
    EMPTY = "empty"  # nothing of either line
    UNRATED = "unrated"  # no clear case: a part in the image, hidden in haze, one line, or seen from ahead


@dataclass(frozen=True, eq=False)
class ExpectedLines:
    """What should be found in a frame."""

    scene: SceneKind
    lines_px: Mapping[str, Line | None]  # by side; the part that can be seen
    range_m: float = float("nan")  # aircraft to the ramp; NaN when unknown
    visibility_m: float = float("nan")  # 2 % contrast; NaN when unknown
    light: float = float("nan")  # share of the ramp's light that comes through the air; NaN when unknown
    contrast: float = float("nan")  # of the fainter line in the image, grey levels; NaN without both


def expected_from_truth(frame: Frame) -> ExpectedLines:
    """The lines that a frame shows by its recording's truth.

    Raises:
        ValueError: a frame without truth, or with true lines and no pose.
    """
    truth, pose = frame.truth, frame.true_world_from_camera
    if truth is None:
        raise ValueError("it has no truth to compare with: evaluate a recording with a scene.json")
    visibility = float("nan") if truth.visibility_m is None else truth.visibility_m
    if truth.left is None or truth.right is None:
        return ExpectedLines(SceneKind.EMPTY, dict.fromkeys(SIDES), visibility_m=visibility)
    if pose is None:
        raise ValueError("no pose; true lines cannot be projected into the image")
    segments = (truth.left, truth.right)
    seen = [find_visible_line(frame, segment) for segment in segments]
    lines = {side: None if line is None else line.points_px for side, line in zip(SIDES, seen, strict=True)}
    light = float(compute_transmission(pose.inv().apply(np.stack([line.p0_m for line in segments])), frame).mean())
    contrast = _contrast(frame.image_rgb, lines)
    return ExpectedLines(
        _scene(frame, segments, seen, lines), lines, range_to_ramp_m(frame), visibility, light, contrast
    )


def expected_from_labels(labels: Labels, image_rgb: NDArray[np.uint8]) -> ExpectedLines:
    """What a person labelled in an image (H, W, 3)."""
    count = sum(labels[side] is not None for side in SIDES)
    scene = (SceneKind.EMPTY, SceneKind.UNRATED, SceneKind.DECK)[count]
    return ExpectedLines(scene, labels, contrast=_contrast(image_rgb, labels))


def _scene(
    frame: Frame, segments: tuple[Segment, Segment], seen: list[VisibleLine | None], lines: Mapping[str, Line | None]
) -> SceneKind:
    if all(line is not None and line.share >= SEEN_SHARE and line.length_px >= SEEN_PX for line in seen):
        return SceneKind.DECK if _left_is_left(lines) else SceneKind.UNRATED
    in_image = any(find_visible_line(frame, segment, within_visibility=False) is not None for segment in segments)
    return SceneKind.UNRATED if in_image else SceneKind.EMPTY


def _contrast(image_rgb: NDArray[np.uint8], lines_px: Mapping[str, Line | None]) -> float:
    lines = [resample(line, CONTRAST_POINTS) for line in (lines_px[side] for side in SIDES) if line is not None]
    if len(lines) < len(SIDES):
        return float("nan")
    return min(float(np.median(measure_contrast(image_rgb, *pair))) for pair in (lines, lines[::-1]))


def _left_is_left(lines: Mapping[str, Line | None]) -> bool:
    left, right = (lines[side] for side in SIDES)
    if left is None or right is None:
        return False
    low, high = max(left[:, 1].min(), right[:, 1].min()), min(left[:, 1].max(), right[:, 1].max())
    if high <= low:
        return float(left[:, 0].mean()) < float(right[:, 0].mean())
    middle = [(low + high) / 2]
    return float(interpolate_rows(left, middle)[0]) < float(interpolate_rows(right, middle)[0])


def draw_runway_prior(frame: Frame, sigma_m: float) -> RunwayPrior | None:
    """The true runway with drawn errors of position and azimuth; in a frame without a runway, a false one in view.

    A frame draws the same whatever others do. None without truth or pose. `sigma_m` is of the position along world x
    and y; a quarter of it in height.
    """
    pose = frame.true_world_from_camera
    if frame.truth is None or pose is None:
        return None
    rng = np.random.default_rng([0, zlib.crc32(frame.file.encode())])
    if frame.truth.left is None or frame.truth.right is None:
        left, right = _false_runway(pose, frame, rng)
    else:
        left, right = (np.stack([line.p0_m, line.p1_m]) for line in (frame.truth.left, frame.truth.right))
    shift = rng.normal(0.0, sigma_m, 3) * [1.0, 1.0, 0.25]
    turn = Rotation.from_euler("z", rng.normal(0.0, AZIMUTH_SIGMA_RAD))
    pivot = (left[0] + right[0]) / 2
    lines = [pivot + turn.apply(line - pivot) + shift for line in (left, right)]
    return RunwayPrior(lines[0], lines[1], sigma_m, AZIMUTH_SIGMA_RAD)


def _false_runway(pose: RigidTransform, frame: Frame, rng: np.random.Generator) -> tuple[Array, Array]:
    """Both lines (2, 3), near end first, of a runway somewhere in the camera's field that leads away from it."""
    u = rng.uniform(0.2, 0.8) * frame.camera.width
    ray = pose.rotation.apply(frame.camera.rays([[u, frame.camera.cy]])[0])
    bearing = np.arctan2(ray[1], ray[0])
    heading = bearing + rng.normal(0.0, FALSE_HEADING_RAD)
    range_m = np.exp(rng.uniform(*np.log(FALSE_RANGE_M)))
    ramp = pose.translation + range_m * np.array([np.cos(bearing), np.sin(bearing), 0.0])
    ramp[2] = pose.translation[2] + FALSE_BELOW_M if frame.deck_z_m is None else frame.deck_z_m
    along, right = np.array([np.cos(heading), np.sin(heading), 0.0]), np.array([-np.sin(heading), np.cos(heading), 0.0])
    line = ramp + np.outer([0.0, FALSE_LENGTH_M], along)
    return line - FALSE_WIDTH_M / 2 * right, line + FALSE_WIDTH_M / 2 * right
