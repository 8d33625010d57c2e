"""One frame's detected points -> runway lines in the world, or why not."""

from dataclasses import dataclass

import numpy as np

from deckline.localize.config import LocalizeConfig
from deckline.localize.depth import DeckPoints, choose_mode, deck_points
from deckline.localize.line_fit import LineFit, fit_lines
from deckline.localize.ransac import fit_pixel_line
from deckline.localize.runway import (
    centre_line,
    drop_contradictions,
    pixel_contradiction,
    ramp,
    runway_line,
    shifted_line,
)
from deckline.types import SIDES, DepthMode, Detection, Frame, LinePoints, PixelLine, RunwayEstimate, Status


@dataclass(frozen=True, eq=False)
class _World:
    """What could be placed in the world."""

    fits: dict[str, LineFit]
    located: dict[str, DeckPoints]
    reason: str


def localize(frame: Frame, detection: Detection, config: LocalizeConfig, rng: np.random.Generator) -> RunwayEstimate:
    """Where the runway lines are.

    Status OK means both lines were found and agree with each other. Lines that contradict each other are dropped:
    "not seen" is better than wrong. Without pose, depth or deck height the image lines are given alone, in mode NONE,
    with the reason.

    Args:
        frame: camera, pose, and depth or deck height.
        detection: points of both lines in the frame's image.
        config: thresholds and assumed noise.
        rng: RANSAC's draws.

    Source: SPEC section 4.
    """
    points = {"left": detection.left, "right": detection.right}
    fitted = {side: fit_pixel_line(points[side], frame.camera, config.ransac, rng) for side in SIDES}
    pixel_lines = {side: line for side, line in fitted.items() if line is not None}
    contradiction = pixel_contradiction(pixel_lines)
    if contradiction:
        return _nothing(contradiction)
    if not pixel_lines:
        return _nothing("no line in the image")
    mode, reason = choose_mode(
        frame, [points[side].points_px[line.inliers] for side, line in pixel_lines.items()], config
    )
    if mode is DepthMode.NONE:
        return RunwayEstimate(_status(pixel_lines), mode, pixel_lines, {}, reason=reason)
    world = _place(frame, points, pixel_lines, mode, config)
    pixel_lines = {side: line for side, line in pixel_lines.items() if side in world.fits}
    if not pixel_lines:
        return _nothing(world.reason)
    return _estimate(frame, detection, pixel_lines, world, mode, config)


def _place(
    frame: Frame,
    points: dict[str, LinePoints],
    pixel_lines: dict[str, PixelLine],
    mode: DepthMode,
    config: LocalizeConfig,
) -> _World:
    located = {}
    for side, line in pixel_lines.items():
        index = np.flatnonzero(line.inliers)
        px, sigma = points[side].points_px[index], points[side].sigma_px[index]
        located[side] = deck_points(frame, px, sigma, index, mode, config.noise)
    pose = frame.world_from_camera
    fits = {} if pose is None else fit_lines(located, pose.translation, config.min_points)
    missing = [f"the {side} line has too few points on the deck" for side in pixel_lines if side not in fits]
    kept, reason = drop_contradictions(fits, config.agreement)
    return _World(kept, located, "; ".join([*missing, reason] if reason else missing))


def _estimate(
    frame: Frame,
    detection: Detection,
    pixel_lines: dict[str, PixelLine],
    world: _World,
    mode: DepthMode,
    config: LocalizeConfig,
) -> RunwayEstimate:
    fits, reasons = dict(world.fits), [world.reason] if world.reason else []
    ramp_m = ramp_sigma_m = None
    if set(fits) == set(SIDES):
        fits["centre"] = centre_line(fits["left"], fits["right"], config.agreement.parallel_rad)
        points = {"left": detection.left, "right": detection.right}
        found = ramp(
            frame,
            points,
            pixel_lines,
            world.located,
            fits["centre"],
            detection.region_px,
            config.agreement.max_ramp_step_m,
        )
        if isinstance(found, str):
            reasons.append(f"no ramp: {found}")
        else:
            ramp_m, ramp_sigma_m = found
    else:
        side = next(iter(fits))
        if config.runway_width_m is None:
            reasons.append(f"no centre line: only the {side} line and no runway_width_m")
        else:
            half = config.runway_width_m / 2
            fits["centre"] = shifted_line(fits[side], half if side == "left" else -half)
    lines = {side: runway_line(fit) for side, fit in fits.items()}
    return RunwayEstimate(_status(pixel_lines), mode, pixel_lines, lines, ramp_m, ramp_sigma_m, "; ".join(reasons))


def _nothing(reason: str) -> RunwayEstimate:
    return RunwayEstimate(Status.NOT_SEEN, DepthMode.NONE, {}, {}, reason=reason)


def _status(pixel_lines: dict[str, PixelLine]) -> Status:
    return Status.OK if len(pixel_lines) == len(SIDES) else Status.ONE_LINE
