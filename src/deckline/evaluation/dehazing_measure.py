"""Dehazers against clear pictures, and what they do to the lines: per image, and summed up by visibility."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deckline.evaluation.metrics import SSIM_WINDOW_PX, distance_px, normal_pixel_error, psnr_db, ssim
from deckline.evaluation.statistics import Difference, paired_difference
from deckline.geometry import Camera
from deckline.labels.lines import Labels
from deckline.pipeline import FrameResult
from deckline.types import SIDES, Frame, Segment, Status

MOST_PSNR_DB = 60.0  # what an untouched picture counts, so that means are finite
BANDS_M = ((0.0, 150.0), (150.0, 300.0), (300.0, 500.0), (500.0, 1000.0), (1000.0, 3000.0), (3000.0, np.inf))
ALL = "all"
FILMS = ("dry and sharp", "rain", "motion blur", "rain and motion blur")
LEAST_LINE_PX = 5.0  # of both lines inside the picture, end to end: shorter ones are not in view
LINE_SAMPLES = 400  # points along a line that say which part of it is in view
FIGURES = ("psnr_db", "psnr_db_surface", "ssim")
QUANTILES = (("median", 50.0), ("p95", 95.0))

Distances = Callable[[NDArray[np.float64]], NDArray[np.float64]]  # points (N, 2), px -> (N,) off the true line, px


@dataclass(frozen=True, eq=False)
class LineScore:
    """What the detector made of one picture in which both lines are in view."""

    found: bool  # both lines, in agreement with each other
    distances_px: NDArray[np.float64]  # (N,) normal distance of every detected point to its true line; N may be 0


@dataclass(frozen=True, eq=False)
class ImageScore:
    """One image through one dehazer."""

    image: tuple[str, str]  # source, name in it
    dehazer: str
    visibility_m: float  # 2 % contrast; NaN when unknown
    figures: Mapping[str, float]  # of FIGURES those that exist
    note: str = ""  # why the image was left as it was
    lines: LineScore | None = None  # None: not asked for
    film: str | None = None  # of FILMS; None: not known


Scores = Mapping[tuple[str, str], ImageScore]  # of one dehazer, by image


@dataclass(frozen=True, eq=False)
class Summary:
    """One dehazer over a group of images. What does not exist is left out of the mappings."""

    images: int
    left_alone: int  # images that the dehazer gave back with a note
    means: Mapping[str, float]  # by FIGURES; arithmetic means of the images' values
    differences: Mapping[str, Difference]  # by FIGURES, to the reference dehazer
    asked: int = 0  # images with both lines in view
    lines: Mapping[str, float] = field(default_factory=dict)  # found_rate, point_error_px.median, point_error_px.p95
    line_differences: Mapping[str, Difference] = field(default_factory=dict)  # found_rate, point_error_px; to hazy


def restoration(
    image_rgb: NDArray[np.uint8], clear_rgb: NDArray[np.uint8], surface: NDArray[np.bool_] | None
) -> dict[str, float]:
    """FIGURES of a restored picture (H, W, 3): PSNR (dB, at most 60) of all and of the surface's pixels, and SSIM.

    Args:
        surface: (H, W) sea and ship; None or nowhere true: no figure for it. The sky behind haze can only be guessed.

    SSIM is left out of pictures smaller than its window.
    """
    figures = {"psnr_db": min(psnr_db(image_rgb, clear_rgb), MOST_PSNR_DB)}
    if surface is not None and surface.any():
        figures["psnr_db_surface"] = min(psnr_db(image_rgb, clear_rgb, surface), MOST_PSNR_DB)
    if min(image_rgb.shape[:2]) >= SSIM_WINDOW_PX:
        figures["ssim"] = ssim(image_rgb, clear_rgb)
    return figures


def true_lines(frame: Frame) -> dict[str, Distances] | None:
    """For each side the distance of points to the true line; None when not both lines are in view, or not known."""
    truth, world_from_camera = frame.truth, frame.true_world_from_camera
    if truth is None or truth.left is None or truth.right is None or world_from_camera is None:
        return None
    optical_from_world, camera = world_from_camera.inv(), frame.camera
    lines: dict[str, Distances] = {}
    for side, segment in zip(SIDES, (truth.left, truth.right), strict=True):
        if seen_length_px(camera.project(optical_from_world.apply(_along(segment))), camera) < LEAST_LINE_PX:
            return None
        ends = optical_from_world.apply(np.stack([segment.p0_m, segment.p1_m]))
        lines[side] = partial(normal_pixel_error, ends_optical_m=ends, camera=camera)
    return lines


def labelled_lines(labels: Labels, camera: Camera) -> dict[str, Distances] | None:
    """The same for lines labelled in the image; None when not both are labelled and in view."""
    lines: dict[str, Distances] = {}
    for side in SIDES:
        line = labels[side]
        if line is None:
            return None
        at = np.linspace(0, len(line) - 1, LINE_SAMPLES)
        samples = np.stack([np.interp(at, np.arange(len(line)), line[:, axis]) for axis in (0, 1)], axis=1)
        if seen_length_px(samples, camera) < LEAST_LINE_PX:
            return None
        lines[side] = partial(distance_px, line_px=line, camera=camera)
    return lines


def seen_length_px(samples_px: ArrayLike, camera: Camera) -> float:
    """Distance between the ends of that part of a line, given as points (N, 2) along it, that is inside the image."""
    samples = np.asarray(samples_px, dtype=np.float64)
    size = [camera.width - 1, camera.height - 1]
    inside = samples[np.all((samples >= 0) & (samples <= size), axis=1)]  # NaN, behind the camera, is not inside
    return float(np.linalg.norm(inside[-1] - inside[0])) if len(inside) > 1 else 0.0


def score_lines(result: FrameResult, lines: Mapping[str, Distances]) -> LineScore:
    """Compare the detected points with the true lines."""
    distances = [lines[side](getattr(result.detection, side).points_px) for side in SIDES]
    return LineScore(result.estimate.status is Status.OK, np.concatenate(distances))


def summarise(scores: Iterable[ImageScore], reference: str, hazy: str, seed: int = 0) -> dict[str, dict[str, Summary]]:
    """Band of visibility -> dehazer -> its summary; ALL comes first, bands without an image are left out.

    Args:
        scores: of all dehazers, in any order.
        reference: dehazer that restoration is compared with.
        hazy: the dehazer that does nothing, which lines are compared with.
        seed: of the intervals.

    Raises:
        ValueError: no score.
    """
    everything = list(scores)
    if not everything:
        raise ValueError("no image could be evaluated")
    groups = {ALL: everything}
    for low, high in BANDS_M:
        groups[band_name(low, high)] = [score for score in everything if _within(score.visibility_m, low, high)]
    return {band: _summaries(members, reference, hazy, seed) for band, members in groups.items() if members}


def summarise_film(
    scores: Iterable[ImageScore], reference: str, hazy: str, seed: int = 0
) -> dict[str, dict[str, Summary]]:
    """The same by rain and motion blur: one of FILMS -> dehazer -> its summary; {} where no image is known to have any.

    Args are those of `summarise`.
    """
    groups: dict[str, list[ImageScore]] = {film: [] for film in FILMS}
    for score in scores:
        if score.film is not None:
            groups[score.film].append(score)
    if not any(groups[film] for film in FILMS[1:]):
        return {}
    return {film: _summaries(members, reference, hazy, seed) for film, members in groups.items() if members}


def film_of(conditions: Mapping[str, Any]) -> str | None:
    """Which of FILMS a picture is, from what its truth says of exposure, rain and drops on the lens; None: nothing."""
    exposure = conditions.get("exposure")
    if not isinstance(exposure, Mapping):
        return None
    found = [exposure.get(name) for name in ("rain_mm_h", "lens_drops", "exposure_s")]
    values = [value for value in found if isinstance(value, int | float)]
    if len(values) < len(found):
        return None
    rain, drops, exposure_s = values
    return FILMS[(rain > 0 or drops > 0) + 2 * (exposure_s > 0)]


def band_name(low_m: float, high_m: float) -> str:
    """A band of visibility, for people."""
    return f"{low_m:.0f}+ m" if np.isinf(high_m) else f"{low_m:.0f}-{high_m:.0f} m"


def _within(visibility_m: float, low_m: float, high_m: float) -> bool:
    return low_m <= visibility_m < high_m or (np.isinf(high_m) and visibility_m == high_m)


def _summaries(scores: list[ImageScore], reference: str, hazy: str, seed: int) -> dict[str, Summary]:
    by_dehazer: dict[str, dict[tuple[str, str], ImageScore]] = {}
    for score in scores:
        by_dehazer.setdefault(score.dehazer, {})[score.image] = score
    return {
        name: _summary(members, by_dehazer.get(reference, {}), by_dehazer.get(hazy, {}), np.random.default_rng(seed))
        for name, members in by_dehazer.items()
    }


def _summary(scores: Scores, reference: Scores, hazy: Scores, rng: np.random.Generator) -> Summary:
    means, differences = {}, {}
    for name in FIGURES:
        values = [score.figures[name] for score in scores.values() if name in score.figures]
        if values:
            means[name] = float(np.mean(values))
        both = _differences(scores, reference, partial(_figure, name))
        if both and scores is not reference:
            differences[name] = paired_difference(both, rng)
    asked = [score.lines for score in scores.values() if score.lines is not None]
    return Summary(
        images=len(scores),
        left_alone=sum(bool(score.note) for score in scores.values()),
        means=means,
        differences=differences,
        asked=len(asked),
        lines=_line_figures(asked),
        line_differences={} if scores is hazy else _line_differences(scores, hazy, rng),
    )


def _line_figures(asked: list[LineScore]) -> dict[str, float]:
    if not asked:
        return {}
    figures = {"found_rate": sum(score.found for score in asked) / len(asked)}
    distances = np.concatenate([score.distances_px for score in asked])
    if len(distances):
        figures |= {f"point_error_px.{name}": float(np.percentile(distances, q)) for name, q in QUANTILES}
    return figures


def _line_differences(scores: Scores, hazy: Scores, rng: np.random.Generator) -> dict[str, Difference]:
    """Found-rate; and the images' median distances, on the images where points are seen both ways."""
    found = _differences(scores, hazy, lambda score: None if score.lines is None else float(score.lines.found))
    distances = _differences(scores, hazy, _median_distance)
    differences = {}
    if found:
        differences["found_rate"] = paired_difference(found, rng)
    if distances:
        differences["point_error_px"] = paired_difference(distances, rng, "median")
    return differences


def _figure(name: str, score: ImageScore) -> float | None:
    return score.figures.get(name)


def _median_distance(score: ImageScore) -> float | None:
    if score.lines is None or len(score.lines.distances_px) == 0:
        return None
    return float(np.median(score.lines.distances_px))


def _differences(scores: Scores, reference: Scores, value: Callable[[ImageScore], float | None]) -> list[float]:
    """Values minus the reference's, on the images that have both."""
    pairs = ((value(score), value(reference[image])) for image, score in scores.items() if image in reference)
    return [ours - theirs for ours, theirs in pairs if ours is not None and theirs is not None]


def worse_lines(summaries: Mapping[str, Summary], hazy: str) -> list[str]:
    """Dehazers of one band whose pictures are surely closer to the clear ones while the lines are surely worse.

    Surely means beyond the 95 % interval: fewer lines found, or points farther off.
    """
    bar = summaries[hazy].means["psnr_db"] if hazy in summaries else np.inf
    return [
        name
        for name, summary in summaries.items()
        if summary.means["psnr_db"] > bar and _lines_are_worse(summary.line_differences)
    ]


def _lines_are_worse(differences: Mapping[str, Difference]) -> bool:
    fewer, farther = differences.get("found_rate"), differences.get("point_error_px")
    return (fewer is not None and fewer.high < 0) or (farther is not None and farther.low > 0)


def _along(segment: Segment) -> NDArray[np.float64]:
    return segment.p0_m + np.linspace(0.0, 1.0, LINE_SAMPLES)[:, None] * (segment.p1_m - segment.p0_m)
