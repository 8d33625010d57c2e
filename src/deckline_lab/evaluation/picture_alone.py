"""`deckline eval picture`: where the aircraft is by its pictures alone, against truth."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
import tyro

from deckline.config import RunConfig
from deckline.flight import Flight, FrameResult
from deckline.options import DEFAULTS, FlightOptions, RunOptions
from deckline.recording import open_recording
from deckline.report.bands import by_band
from deckline.truth import range_to_ramp_m, true_guidance, true_width_m
from deckline.types import Frame, Guidance, Reason, Status, Value
from deckline_lab.evaluation.tables import MISSING, TO_TERMINAL, Figures, Output, Table, number, publish
from deckline_lab.rivals.catalog import flight_from_config
from deckline_sim.progress import progress

BANDS_M = (0.0, 150.0, 300.0, 800.0, np.inf)  # to the ramp: errors grow with its square
NORMAL_95 = 1.96
QUANTITIES = ("heading, deg", "lateral, m", "height, m", "distance, m")
ERRORS = 51  # random stream


@dataclass(frozen=True)
class PictureScore:
    """One frame: errors and 1-sigmas by `QUANTITIES`, degrees and metres."""

    range_m: float
    age_s: float  # of the track; 0: the frame alone
    status: Status | None  # None: no pose
    has_horizon: bool
    errors: dict[str, tuple[float, float]]
    is_beyond: bool  # an error is larger than its protection level


def picture(
    recordings: tyro.conf.Positional[tuple[Path, ...]],
    frames: Literal["single", "tracked"] = "tracked",
    width: Literal["known", "unknown"] = "known",
    error: float = 0.0,
    seed: int = 0,
    options: FlightOptions = DEFAULTS,
    output: Output = TO_TERMINAL,
) -> int:
    """Fly recordings with truth as if they had no poses, and print how wrong the picture's own answer is.

    Args:
        recordings: folders that `deckline sim` wrote.
        frames: every frame for itself, or each recording as one flight.
        width: whether the runway's true width is stated; of an unknown one, widths are compared in true widths.
        error: 1-sigma of what is stated of width and focal length, as a share, drawn for each recording or
            single frame.
        seed: of that draw.
        options: of the configuration that flies.
        output: files of the results.

    Raises:
        ValueError: a recording without truth.
    """
    scores: list[PictureScore] = []
    rng = np.random.default_rng([seed, ERRORS])
    with progress("recordings", len(recordings)) as advance:
        for path in recordings:
            scores += score_recording(path, frames == "single", width == "known", error, options, rng)
            advance()
    if not scores:
        raise ValueError("no frame could be evaluated")
    title = f"{len(scores)} frames without their poses, {frames}, width {width}, stated to {100 * error:g} %"
    settled = [score for score in scores if score.age_s >= 1.0]
    groups = {"alone, horizon seen": [score for score in scores if score.has_horizon], "all": scores}
    if frames == "tracked":
        groups = {"tracked for 1 s and more": settled, "all": scores}
    tables = [_error_table(name, members) for name, members in groups.items() if members]
    publish(title, [*tables, _status_table(scores)], _figures(groups), output)
    return 0


def score_recording(
    path: Path, single: bool, knows_width: bool, error: float, options: RunOptions, rng: np.random.Generator
) -> list[PictureScore]:
    """The scores of a recording's frames; see `picture`."""
    source = open_recording(path)
    base, flight, scores = options.run_config(source.base_config), None, []
    with ExitStack() as flights:
        for frame in source:
            if frame.truth is None:
                raise ValueError(f"{path}: frames without truth; record with deckline sim")
            truth, width_m = true_guidance(frame, base.approach), true_width_m(frame.truth)
            if truth is None or width_m is None:
                continue
            if flight is None or single:
                wrong, true_m = error * rng.standard_normal(2), width_m
                config = _config(base, single, true_m if knows_width else None, error, wrong)
                flight = Flight(config, flight.dehazer, flight.detector) if flight else flight_from_config(config)
                flights.enter_context(flight)
            result = flight(without_pose(frame, error, float(wrong[1])))
            scores.append(score(result, truth, range_to_ramp_m(frame), true_m))
    return scores


def without_pose(frame: Frame, focal_sigma: float = 0.0, focal_error: float = 0.0) -> Frame:
    """The frame as a video has it, its focal length stated wrong by a share, with the 1-sigma of that."""
    camera = frame.camera
    camera = replace(
        camera,
        fx=camera.fx * (1 + focal_error),
        fy=camera.fy * (1 + focal_error),
        focal_sigma=focal_sigma or None,
    )
    return replace(frame, camera=camera, world_from_body=None, depth_m=None, deck_z_m=None, sea_z_m=None)


def _config(config: RunConfig, single: bool, width_m: float | None, error: float, wrong: np.ndarray) -> RunConfig:
    deck = replace(config.deck, width_m=None)
    if width_m is not None:
        sigma_m = max(config.deck.width_sigma_m, error * width_m)
        deck = replace(config.deck, width_m=width_m * (1 + float(wrong[0])), width_sigma_m=sigma_m)
    return replace(config, deck=deck, tracking=replace(config.tracking, enabled=not single))


def score(result: FrameResult, truth: Guidance, range_m: float, width_m: float) -> PictureScore:
    """A result against true guidance; lengths in runway widths count in true ones."""
    found, track = result.guidance, result.track
    heading = found.heading_error_rad
    if heading is None:
        return PictureScore(range_m, 0.0, None, False, {}, False)
    if found.in_widths is not None:
        known = found.in_widths
        lengths = [
            _metres(v, width_m) for v in (known.lateral_deviation, known.height_above_deck, known.distance_to_ramp)
        ]
    else:
        lengths = [found.lateral_deviation_m, found.height_above_deck_m, found.distance_to_ramp_m]
    true = [truth.lateral_deviation_m, truth.height_above_deck_m, truth.distance_to_ramp_m]
    errors = {}
    if truth.heading_error_rad is not None:
        turn = float(np.rad2deg(heading.value - truth.heading_error_rad.value))
        errors[QUANTITIES[0]] = turn, float(np.rad2deg(heading.sigma))
    for name, value, exact in zip(QUANTITIES[1:], lengths, true, strict=True):
        if value is not None and exact is not None:
            errors[name] = value.value - exact.value, value.sigma
    has_horizon = all(d.reason is not Reason.NO_HORIZON for d in found.diagnostics)
    age_s = 0.0 if track is None else track.age_s
    return PictureScore(range_m, age_s, found.status, has_horizon, errors, _is_beyond(found, errors))


def _metres(value: Value | None, width_m: float) -> Value | None:
    return None if value is None else Value(value.value * width_m, value.sigma * width_m)


def _is_beyond(found: Guidance, errors: dict[str, tuple[float, float]]) -> bool:
    """Whether any error is beyond its protection level."""
    levels = found.protection
    if levels is None:
        return False
    heading = None if levels.heading_rad is None else float(np.rad2deg(levels.heading_rad))
    limits = dict(zip(QUANTITIES, (heading, levels.lateral_m, levels.vertical_m, levels.distance_m), strict=True))
    return any((limit := limits[name]) is not None and abs(error) > limit for name, (error, _) in errors.items())


def _error_table(name: str, scores: Sequence[PictureScore]) -> Table:
    rows = []
    for band, members in by_band(scores, lambda score: score.range_m, BANDS_M, short=True).items():
        cells = []
        for quantity in QUANTITIES:
            found = _size_and_coverage(members, quantity)
            cells += [MISSING, MISSING] if found is None else [number(found[0], ".2f"), f"{100 * found[1]:.0f} %"]
        rows.append((band, str(len(members)), *cells))
    columns = [column for quantity in QUANTITIES for column in (f"{quantity}, 90 %", "in its 95 %")]
    return Table(
        f"{name}: error at 90 % of the frames, and share inside the stated 95 % interval",
        ("range to the ramp", "frames", *columns),
        rows,
    )


def _size_and_coverage(scores: Sequence[PictureScore], quantity: str) -> tuple[float, float] | None:
    """The error at 90 % of the frames, and the share inside the stated 95 % interval; None without any error."""
    found = np.array([score.errors[quantity] for score in scores if quantity in score.errors])
    if not len(found):
        return None
    sizes = np.abs(found[:, 0])
    return float(np.percentile(sizes, 90)), float((sizes <= NORMAL_95 * found[:, 1]).mean())


def _status_table(scores: Sequence[PictureScore]) -> Table:
    rows = []
    for status in dict.fromkeys(score.status for score in scores):
        members = [score for score in scores if score.status is status]
        beyond = sum(score.is_beyond for score in members)
        rows.append((MISSING if status is None else str(status), str(len(members)), str(beyond)))
    return Table("status", ("status", "frames", "beyond a protection level"), rows)


def _figures(groups: dict[str, list[PictureScore]]) -> Figures:
    figures: Figures = {}
    for name, scores in groups.items():
        for band, members in by_band(scores, lambda score: score.range_m, BANDS_M, short=True).items():
            for quantity in QUANTITIES:
                if (found := _size_and_coverage(members, quantity)) is not None:
                    key = f"{name}.{band}.{quantity}"
                    figures[f"{key}.p90"], figures[f"{key}.inside_95"] = found
    return figures
