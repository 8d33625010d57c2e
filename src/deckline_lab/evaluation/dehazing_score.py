"""Dehazers against clear pictures, and what they do to the lines: per image, and summed up by visibility."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from deckline.dehaze import NOT_DEHAZED
from deckline.flight import FrameResult
from deckline.report.bands import by_band, share
from deckline.types import SIDES, Detection, LineVisibility
from deckline_lab.evaluation.dehazing_pairs import FILMS, Distances, Pair
from deckline_lab.evaluation.false_content import false_edges
from deckline_lab.evaluation.metrics import SSIM_WINDOW_PX, psnr_db, ssim
from deckline_lab.evaluation.no_reference import summarise_no_reference
from deckline_lab.evaluation.tables import Figures
from deckline_lab.evaluation.visible_distance import (
    ApproachFrame,
    are_right,
    near_width_px,
    tolerance_px,
    visible_distance,
)
from deckline_lab.statistics import DEHAZING_VISIBILITY_M, Difference, median_and_p95, paired_difference

MOST_PSNR_DB = 60.0  # what an untouched picture counts, so that means are finite
ALL = "all"
FIGURES = ("psnr_db", "psnr_db_surface", "ssim", "visible_range_m", "false_edges_per_mille")

Summaries = Mapping[str, Mapping[str, "DehazingSummary"]]  # band -> dehazer


@dataclass(frozen=True)
class ImageScore:
    """One image through one dehazer. Plain values: a score is a line of JSON."""

    source: str
    key: str  # of the image in its source
    dehazer: str
    visibility_m: float  # 2 % contrast; NaN when unknown
    figures: Figures  # of FIGURES those that exist
    note: str = ""  # why the dehazer left the image as it was
    film: str | None = None  # of FILMS; None: not known
    found: bool | None = None  # both lines, in agreement with each other; None: not both lines are in view
    distances_px: Sequence[float] = ()  # normal distance of every detected point to its true line
    time_s: float = math.nan
    range_m: float = math.nan  # aircraft to the ramp, horizontal; NaN when unknown
    is_right: bool = False  # both lines, as `visible_distance` counts

    @property
    def image(self) -> tuple[str, str]:
        return self.source, self.key


@dataclass(frozen=True)
class DehazingSummary:
    """One dehazer over a group of images. What does not exist is left out of the mappings."""

    images: int
    left_alone: int  # images that the dehazer gave back with a note
    means: Figures  # by FIGURES; arithmetic means of the images' values
    differences: dict[str, Difference]  # by FIGURES, to the reference dehazer
    asked: int  # images with both lines in view
    lines: Figures  # found_rate, point_error_px.median, point_error_px.p95
    line_differences: dict[str, Difference]  # found_rate, point_error_px; to hazy
    no_reference: Figures  # see summarise_no_reference


def restoration(
    image_rgb: NDArray[np.uint8], clear_rgb: NDArray[np.uint8], surface: NDArray[np.bool_] | None
) -> Figures:
    """FIGURES of a restored picture (H, W, 3): PSNR (dB, at most 60) of all and of the surface's pixels, SSIM, and the
    edges that the clear picture lacks.

    SSIM is left out of pictures smaller than its window. The surface (H, W) is sea and ship, as the sky behind haze can
    only be guessed; it is left out where it is None or nowhere true.
    """
    figures = {"psnr_db": min(psnr_db(image_rgb, clear_rgb), MOST_PSNR_DB)}
    if surface is not None and surface.any():
        figures["psnr_db_surface"] = min(psnr_db(image_rgb, clear_rgb, surface), MOST_PSNR_DB)
    if min(image_rgb.shape[:2]) >= SSIM_WINDOW_PX:
        figures["ssim"] = ssim(image_rgb, clear_rgb)
    figures["false_edges_per_mille"] = 1e3 * false_edges(image_rgb, clear_rgb)
    return figures


def score_lines(result: FrameResult, lines: Mapping[str, Distances]) -> tuple[bool, list[float]]:
    """Whether both lines are found in agreement, and the distances of all detected points to the true lines, px."""
    distances = [lines[side](getattr(result.detection, side).points_px) for side in SIDES]
    return result.estimate.seen is LineVisibility.BOTH, np.concatenate(distances).tolist()


def lines_are_right(detection: Detection, pair: Pair) -> bool:
    """Whether both lines are where a recorded pair's truth has them; False where it does not show both."""
    if pair.lines is None or not pair.in_view:
        return False
    allowed = tolerance_px(pair.frame.camera.width, near_width_px(*(line.points_px for line in pair.in_view)))
    points = {side: getattr(detection, side).points_px for side in SIDES}
    return are_right([pair.lines[side](px) for side, px in points.items()], allowed)


def visible_figures(scores: Iterable[ImageScore]) -> dict[str, Figures]:
    """By dehazer, where the detector behind it first holds both lines on the recordings that are approaches."""
    frames: dict[str, list[ApproachFrame]] = {}
    for score in scores:
        frame = ApproachFrame(score.source, score.time_s, score.range_m, score.visibility_m, score.is_right)
        frames.setdefault(score.dehazer, []).append(frame)
    return {name: visible_distance(each) for name, each in frames.items()}


def summarise(scores: Sequence[ImageScore], reference: str) -> dict[str, dict[str, DehazingSummary]]:
    """Band of visibility -> dehazer -> its summary; ALL comes first, bands without an image are left out.

    Args:
        scores: of all dehazers, in any order.
        reference: dehazer that restoration is compared with; lines are compared with those of the hazy picture.

    Raises:
        ValueError: no score.
    """
    if not scores:
        raise ValueError("no image could be evaluated")
    groups = {ALL: list(scores)} | by_band(scores, lambda one: one.visibility_m, DEHAZING_VISIBILITY_M, short=True)
    return {band: _summarise_group(members, reference) for band, members in groups.items()}


def summarise_film(scores: Sequence[ImageScore], reference: str) -> dict[str, dict[str, DehazingSummary]]:
    """The same by one of FILMS, rain and motion blur; {} where no image is known to have any."""
    groups = {film: [score for score in scores if score.film == film] for film in FILMS}
    if not any(groups[film] for film in FILMS[1:]):
        return {}
    return {film: _summarise_group(members, reference) for film, members in groups.items() if members}


def _summarise_group(scores: Sequence[ImageScore], reference: str) -> dict[str, DehazingSummary]:
    by_dehazer: dict[str, dict[tuple[str, str], ImageScore]] = {}
    for score in scores:
        by_dehazer.setdefault(score.dehazer, {})[score.image] = score
    theirs, untouched = by_dehazer.get(reference, {}), by_dehazer.get(NOT_DEHAZED, {})
    summaries = {}
    for name, ours in by_dehazer.items():
        rng = np.random.default_rng(0)
        means, differences, line_differences = {}, {}, {}
        for figure in FIGURES:
            values = [score.figures[figure] for score in ours.values() if figure in score.figures]
            if values:
                means[figure] = float(np.mean(values))
            pairs = _paired(ours, theirs, partial(_figure, figure))
            if pairs and name != reference:
                differences[figure] = paired_difference(pairs, rng)
        if name != NOT_DEHAZED:
            if pairs := _paired(ours, untouched, lambda score: None if score.found is None else float(score.found)):
                line_differences["found_rate"] = paired_difference(pairs, rng)
            if pairs := _paired(ours, untouched, _median_distance):
                line_differences["point_error_px"] = paired_difference(pairs, rng, "median")
        asked = [score for score in ours.values() if score.found is not None]
        lines: Figures = {}
        if asked:
            distances = np.concatenate([score.distances_px for score in asked])
            lines = {"found_rate": share(asked, lambda score: bool(score.found))}
            lines |= median_and_p95(distances, "point_error_px")
        left_alone = sum(bool(score.note) for score in ours.values())
        no_reference = summarise_no_reference([score.figures for score in ours.values()])
        summaries[name] = DehazingSummary(
            len(ours), left_alone, means, differences, len(asked), lines, line_differences, no_reference
        )
    return summaries


def _figure(name: str, score: ImageScore) -> float | None:
    return score.figures.get(name)


def _median_distance(score: ImageScore) -> float | None:
    return float(np.median(score.distances_px)) if len(score.distances_px) else None


def _paired(
    ours: Mapping[tuple[str, str], ImageScore],
    theirs: Mapping[tuple[str, str], ImageScore],
    value: Callable[[ImageScore], float | None],
) -> list[float]:
    """Our values minus theirs, on the images that have both."""
    pairs = ((value(score), value(theirs[image])) for image, score in ours.items() if image in theirs)
    return [mine - other for mine, other in pairs if mine is not None and other is not None]


def worse_lines(summaries: Mapping[str, DehazingSummary]) -> list[str]:
    """Dehazers of one band whose pictures are surely closer to the clear ones while the lines are surely worse.

    Surely means beyond the 95 % interval: fewer lines found, or points farther off.
    """
    bar = summaries[NOT_DEHAZED].means.get("psnr_db", np.inf) if NOT_DEHAZED in summaries else np.inf
    worse = []
    for name, summary in summaries.items():
        fewer, farther = (summary.line_differences.get(key) for key in ("found_rate", "point_error_px"))
        lines_are_worse = (fewer is not None and fewer.high < 0) or (farther is not None and farther.low > 0)
        if summary.means.get("psnr_db", -np.inf) > bar and lines_are_worse:
            worse.append(name)
    return worse
