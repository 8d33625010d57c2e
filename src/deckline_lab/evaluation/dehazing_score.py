"""Dehazers against clear pictures, and what they do to the lines: per image, summed up by visibility, and as tables."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deckline.dehaze import NOT_DEHAZED
from deckline.flight import FrameResult
from deckline.statistics import (
    DEHAZING_VISIBILITY_M,
    Difference,
    by_band,
    median_and_p95,
    paired_difference,
    share,
)
from deckline.types import SIDES, LineVisibility
from deckline_lab.evaluation.dehazers import Cost
from deckline_lab.evaluation.dehazing_pairs import FILMS, Distances
from deckline_lab.evaluation.metrics import SSIM_WINDOW_PX, psnr_db, ssim
from deckline_lab.evaluation.no_reference import no_reference_table, summarise_no_reference
from deckline_lab.evaluation.tables import MISSING, Figures, Table, number

MOST_PSNR_DB = 60.0  # what an untouched picture counts, so that means are finite
ALL = "all"
FIGURES = ("psnr_db", "psnr_db_surface", "ssim", "visible_range_m")
INTERVALS = (
    "[low, high]: 95 % paired bootstrap interval over images, taken as independent; frames of one flight are not, "
    "theirs is too narrow."
)
MEANING = (
    "PSNR and SSIM are means over images, an untouched image counting 60 dB; below the horizon: sea and ship alone, "
    "as haze hides the sky's true colours."
)
SEEN = (
    "Lines seen to: the farthest range at which a true line has 5 % contrast, 0 where it has less; a mean over images."
)
FILM = "Rain or drops on the lens, or an exposure that takes time: the clear picture is without them as without haze."
LINES = (
    f"Differences to {NOT_DEHAZED}. Asked: images with both lines in view. Found: both lines, in agreement. Points: "
    "normal distance of all detected points to the true lines; its difference: median over the images with points both "
    "ways."
)
LEVELS = {"psnr_db": "PSNR, dB", "psnr_db_surface": "below horizon, dB", "visible_range_m": "lines seen to, m"}
MIB, MS = 2.0**20, 1e3

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
    """FIGURES of a restored picture (H, W, 3): PSNR (dB, at most 60) of all and of the surface's pixels, and SSIM.

    SSIM is left out of pictures smaller than its window. The surface (H, W) is sea and ship, as the sky behind haze can
    only be guessed; it is left out where it is None or nowhere true.
    """
    figures = {"psnr_db": min(psnr_db(image_rgb, clear_rgb), MOST_PSNR_DB)}
    if surface is not None and surface.any():
        figures["psnr_db_surface"] = min(psnr_db(image_rgb, clear_rgb, surface), MOST_PSNR_DB)
    if min(image_rgb.shape[:2]) >= SSIM_WINDOW_PX:
        figures["ssim"] = ssim(image_rgb, clear_rgb)
    return figures


def score_lines(result: FrameResult, lines: Mapping[str, Distances]) -> tuple[bool, list[float]]:
    """Whether both lines are found in agreement, and the distances of all detected points to the true lines, px."""
    distances = [lines[side](getattr(result.detection, side).points_px) for side in SIDES]
    return result.estimate.seen is LineVisibility.BOTH, np.concatenate(distances).tolist()


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


@dataclass(frozen=True)
class DehazingResults:
    """All that was measured."""

    title: str
    reference: str
    summaries: Summaries
    film: Summaries  # one of FILMS -> dehazer; {} without rain and motion blur
    sizes: Mapping[str, tuple[int, int] | None]  # dehazer -> parameters, MACs at 256x256
    costs: Mapping[str, Cost]
    cost_size_px: tuple[int, int]
    failed: Mapping[str, str]  # dehazer -> why its cost could not be measured
    skipped: tuple[tuple[str, str], ...]  # image, reason

    @property
    def levels(self) -> dict[str, str]:
        """Figures with a unit that some image has -> how their column is called."""
        known = {name for summary in self.summaries[ALL].values() for name in summary.means}
        return {name: heading for name, heading in LEVELS.items() if name in known}


def dehazing_tables(results: DehazingResults) -> list[Table]:
    """Restoration with its cost, by visibility and by rain and motion blur, the lines where they were asked for, and
    the figures without a clear picture.
    """
    tables = [_restoration(results)]
    bands = {band: members for band, members in results.summaries.items() if band != ALL}
    if bands and results.levels:
        tables.append(_grouped(results, "visibility", bands))
    if results.film:
        tables.append(_grouped(results, "rain and motion blur", results.film, (FILM,)))
    if any(summary.asked for summary in results.summaries[ALL].values()):
        tables.append(_lines(results))
    no_reference = {name: summary.no_reference for name, summary in results.summaries[ALL].items()}
    return [*tables, no_reference_table(no_reference)]


def _restoration(results: DehazingResults) -> Table:
    columns = ["dehazer", "images", *_level_columns(results), "left as is", "parameters", "MACs 256x256"]
    notes = [MEANING, INTERVALS] if results.levels else []
    notes += [SEEN] if "visible_range_m" in results.levels else []
    if results.costs:
        width, height = results.cost_size_px
        columns += [f"ms at {width}x{height}", "peak MiB"]
        ratio = f"; in brackets the ratio to {results.reference}" if results.reference != NOT_DEHAZED else ""
        notes.append(
            f"Milliseconds and memory beyond the loaded model: medians, each run in a process of its own{ratio}."
        )
    rows = []
    for name, summary in results.summaries[ALL].items():
        size = results.sizes.get(name)
        sizes = [MISSING, MISSING] if size is None else [f"{size[0] / 1e6:.3f} M", f"{size[1] / 1e9:.2f} G"]
        cost = _cost_cells(name, results) if results.costs else ()
        rows.append((name, *_level_cells(summary, results), *sizes, *cost))
    notes += [f"{name}: no cost: {reason}" for name, reason in results.failed.items()]
    return Table("Restoration", columns, rows, notes)


def _grouped(results: DehazingResults, by: str, groups: Summaries, notes: tuple[str, ...] = ()) -> Table:
    rows = [
        (group, name, *_level_cells(summary, results))
        for group, members in groups.items()
        for name, summary in members.items()
    ]
    columns = (by, "dehazer", "images", *_level_columns(results), "left as is")
    return Table(f"Restoration by {by}", columns, rows, notes)


def _lines(results: DehazingResults) -> Table:
    columns = ("visibility", "dehazer", "asked", "PSNR, dB", "found, %", "difference, points", "points, median px")
    rows = []
    for band, members in results.summaries.items():
        rows += [(band, name, *_line_cells(summary)) for name, summary in members.items() if summary.asked]
    worse = [f"{name} ({band})" for band, members in results.summaries.items() for name in worse_lines(members)]
    notes = [LINES, *([f"Higher PSNR, worse lines: {', '.join(worse)}."] if worse else [])]
    return Table("Lines by visibility", (*columns, "95 % px", "difference of medians, px"), rows, notes)


def _level_columns(results: DehazingResults) -> list[str]:
    pairs = ((heading, f"to {results.reference}, {heading.rpartition(' ')[2]}") for heading in results.levels.values())
    return [*(word for pair in pairs for word in pair), *(["SSIM"] if results.levels else [])]


def _level_cells(summary: DehazingSummary, results: DehazingResults) -> list[str]:
    cells = [str(summary.images)]
    for name in results.levels:
        cells += [number(summary.means.get(name), ".2f"), _difference(summary.differences.get(name), "+.2f")]
    cells += [number(summary.means.get("ssim"), ".4f")] if results.levels else []
    return [*cells, str(summary.left_alone)]


def _line_cells(summary: DehazingSummary) -> list[str]:
    lines, differences = summary.lines, summary.line_differences
    return [
        str(summary.asked),
        number(summary.means.get("psnr_db"), ".2f"),
        number(100 * lines["found_rate"], ".1f"),
        _difference(differences.get("found_rate"), "+.1f", 100),
        number(lines.get("point_error_px.median"), ".2f"),
        number(lines.get("point_error_px.p95"), ".1f"),
        _difference(differences.get("point_error_px"), "+.2f"),
    ]


def _cost_cells(name: str, results: DehazingResults) -> tuple[str, str]:
    """Time and memory, with the ratio to the reference unless that is doing nothing."""
    cost, reference = results.costs.get(name), results.costs.get(results.reference)
    if cost is None:
        return MISSING, MISSING
    seconds, peak = f"{MS * cost.seconds:.1f}", number(cost.peak_bytes and cost.peak_bytes / MIB, ".0f")
    if reference is None or results.reference == NOT_DEHAZED:
        return seconds, peak
    if cost.peak_bytes is not None and reference.peak_bytes:
        peak += f" ({cost.peak_bytes / reference.peak_bytes:.2f})"
    return f"{seconds} ({cost.seconds / reference.seconds:.2f})", peak


def _difference(difference: Difference | None, form: str, scale: float = 1.0) -> str:
    return MISSING if difference is None or math.isnan(difference.value) else difference.text(form, scale)


def json_of(results: DehazingResults) -> dict[str, Any]:
    """The numbers of the tables."""
    visibility, film = (
        {group: {name: asdict(one) for name, one in members.items()} for group, members in groups.items()}
        for groups in (results.summaries, results.film)
    )
    return {
        "title": results.title,
        "reference": results.reference,
        "visibility": visibility,
        "film": film,
        "higher_psnr_worse_lines": {band: worse_lines(members) for band, members in results.summaries.items()},
        "size": {
            name: None if size is None else {"parameters": size[0], "macs_256": size[1]}
            for name, size in results.sizes.items()
        },
        "cost": {name: asdict(cost) for name, cost in results.costs.items()},
        "cost_size_px": results.cost_size_px,
        "no_cost": results.failed,
        "skipped": results.skipped,
    }
