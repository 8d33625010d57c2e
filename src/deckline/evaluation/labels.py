"""Detected points against lines labelled in the images: for pictures that nobody here rendered."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deckline.geometry import Camera
from deckline.labels.own import Labels
from deckline.pipeline import FrameResult
from deckline.types import SIDES, Status


@dataclass(frozen=True, eq=False)
class LabelScore:
    """One labelled frame's errors."""

    file: str
    status: Status
    labelled: bool  # both lines are labelled
    errors_px: dict[str, NDArray[np.float64]]  # side -> (N,) normal distance of every detected point; found lines only

    @property
    def found(self) -> bool:
        """Points on both lines."""
        return all(side in self.errors_px for side in SIDES)


def score_labels(result: FrameResult, labels: Labels) -> LabelScore:
    """Compare one frame's detected points with its labels. Points where no line is labelled are infinitely wrong."""
    errors = {}
    for side in SIDES:
        points, line = getattr(result.detection, side).points_px, labels[side]
        if len(points):
            errors[side] = (
                np.full(len(points), np.inf) if line is None else distance_px(points, line, result.frame.camera)
            )
    labelled = all(labels[side] is not None for side in SIDES)
    return LabelScore(result.frame.file, result.estimate.status, labelled, errors)


def distance_px(points_px: ArrayLike, line_px: NDArray[np.float64], camera: Camera) -> NDArray[np.float64]:
    """Distance (N,), px, of points (N, 2) to the unbounded straight line that fits labelled points (M, 2) best.

    Both are compared with the lens distortion removed.
    """
    points, line = (camera.rays(pixels)[:, :2] * [camera.fx, camera.fy] for pixels in (points_px, line_px))
    middle = line.mean(axis=0)
    normal = np.linalg.svd(line - middle)[2][1]
    return np.abs((points - middle) @ normal)


def summarise_labels(scores: list[LabelScore]) -> dict[str, float]:
    """Found-rate, false lines and pixel errors under dotted names.

    Raises:
        ValueError: no frames.
    """
    if not scores:
        raise ValueError("no labelled frame could be evaluated")
    figures = {"frames": float(len(scores))}
    runway = [score for score in scores if score.labelled]
    empty = [score for score in scores if not score.labelled]
    if runway:
        figures["found_rate"] = sum(score.found for score in runway) / len(runway)
        figures["ok_rate"] = sum(score.status is Status.OK for score in runway) / len(runway)
        pooled = [score.errors_px[side] for score in runway for side in SIDES if side in score.errors_px]
        if pooled:
            errors = np.concatenate(pooled)
            figures |= {"error_px.median": float(np.median(errors)), "error_px.p95": float(np.percentile(errors, 95))}
            figures["worst_line_median_px"] = max(float(np.median(line)) for line in pooled)
    if empty:
        figures["false_line_rate"] = sum(bool(score.errors_px) for score in empty) / len(empty)
    return figures
